// Panels of one module each, below the curves. `panels/NAME.js` exports `title`, `draw(box, state)` and, where it has a style
// of its own, `style = true` for `panels/NAME.css`. `draw` fills the box and returns whether there is something to show.
// A panel is drawn at each change of the page, so it compares a key before it builds (README.md lists the data). One word in PANELS adds one.
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
