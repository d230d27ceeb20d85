// Panels of one module each, below the curves. `panels/NAME.js` exports `title`, `draw(box, state)` and, where it has a style
// of its own, `style = true` for `panels/NAME.css`. `draw` fills the box and returns whether there is something to show.
// The state is that of the shown moment; times are in seconds of the run:
//   t, state, speed, run: { run, tree, cell, … }, ended: null or { outcome, t, … }, progress: { what, number, of }
//   nodes: [{ path, parent, name, kind, type }], node: path → { status, since, feedback, reason: { code, message, data }, history: [{ t, status, reason }] }
//   ports: "path/name" → { value, writer, t, sentence }, tables: topic → { columns, rows, caption }, images and scenes: topic → { t, node, … }
//   series: topic → { t: [], values: name → [] }, poses: topic → { t, poses, trace }, bodies: topic → values
//   spans: [{ path, start, end, status }], marks: [{ t, kind, text }], logs: [{ t, path, text, level }], failures: [{ t, path, reason, next }]
//   links: device → { state, t }, acts: [operator's], safeStop: its reason or null, hand, attempts: path → [{ number, … }]: see store.js
// A panel is drawn at each change of the page, so it compares a key before it builds. One word in PANELS adds one.
import { $, h } from "../dom.js";
import * as tables from "./tables.js";

export const PANELS = { tables };
const sections = new Map();

function section(name, { title, style }) {
  if (!sections.has(name)) {
    if (style) document.head.append(h("link", { rel: "stylesheet", href: `static/panels/${name}.css` }));
    const box = h("div", { id: name });
    const made = h("section", { class: "panel wide", id: `${name}-panel`, "aria-labelledby": `${name}-title` }, h("h2", { id: `${name}-title` }, title), box);
    made.hidden = true;
    $("below").append(made);
    sections.set(name, [made, box]);
  }
  return sections.get(name);
}

export function drawPanels(state) {
  for (const [name, panel] of Object.entries(PANELS)) {
    const [made, box] = section(name, panel);
    made.hidden = !panel.draw(box, state);
  }
}
