// The tree as boxes, one a line, in the order of execution. Only the boxes in sight are in the document.
import { $, h } from "./shared/dom.js";
import { bare, children, findingsOf, holdsNodes, isCondition, kindOf, labelOf, node, nodeAt, page, siblings } from "./model.js";

const STEP = 22, LINE = 32, MORE = 15, HEADING = 30, AROUND = 500, FAR = 6; // px

export class Drawing {
  // `on`: select(id), open(id), menu(id, x, y), drop(id, into, index), bring(name, into, index)
  constructor(on) {
    Object.assign(this, { on, root: $("tree"), sheet: h("div", { class: "sheet", role: "presentation" }), rows: [], shown: new Map(), found: new Set(), drag: null, dropped: 0 });
    this.line = h("div", { class: "drop", hidden: true });
    this.root.addEventListener("scroll", () => this.show(), { passive: true });
    new ResizeObserver(() => this.show()).observe(this.root);
    this.root.addEventListener("click", (event) => { const id = this.idOf(event); if (id && performance.now() - this.dropped > 100) { this.on.select(id); this.root.focus(); } });
    this.root.addEventListener("dblclick", (event) => { const id = this.idOf(event); if (id) this.on.open(id); });
    this.root.addEventListener("contextmenu", (event) => {
      const id = this.idOf(event);
      if (!id) return;
      event.preventDefault();
      this.on.select(id);
      this.on.menu(id, event.clientX, event.clientY);
    });
    this.root.addEventListener("pointerdown", (event) => this.down(event));
    addEventListener("pointermove", (event) => this.move(event));
    addEventListener("pointerup", () => this.up(true));
    addEventListener("pointercancel", () => this.up(false));
    addEventListener("keydown", (event) => { if (event.key === "Escape" && this.drag) this.up(false); }, true);
  }

  idOf(event) { return event.target.closest?.(".box")?.parentElement.dataset.id ?? ""; }

  // Lay the tree out anew: after a change of the text or of what is known about its nodes.
  update() {
    let top = 4, definition = null;
    this.marks = new Map();
    for (const finding of page.state.findings) {
      const at = finding.node ?? (finding.node = nodeAt(finding.line)?.id ?? "");
      const rank = this.marks.get(at);
      this.marks.set(at, rank === "error" ? rank : finding.severity);
    }
    this.rows = page.state.nodes.map((one) => {
      const row = { one, id: one.id, level: one.parent ? this.levels.get(one.parent) + 1 : 0, heading: null };
      if (!one.parent) this.levels = new Map(), row.level = 0, definition = one.tree;
      this.levels.set(one.id, row.level);
      if (!one.parent && one.tree) row.heading = { top, words: headingOf(definition) }, top += HEADING;
      row.ports = words(one);
      row.note = one.description || one.comment;
      row.height = LINE + (row.ports ? MORE : 0) + (row.note ? MORE : 0);
      row.top = top;
      top += row.height;
      return row;
    });
    this.at = new Map(this.rows.map((row, i) => [row.id, i]));
    const blank = page.state.nodes.length ? null : this.blank;
    this.sheet.style.height = blank ? "auto" : `${top + 40}px`;
    this.root.classList.toggle("old", page.old);
    this.shown.clear();
    this.sheet.replaceChildren(...(blank ? [blank()] : []));
    if (this.sheet.parentElement !== this.root) this.root.replaceChildren(this.sheet);
    this.show();
  }

  levels = new Map();

  // Put the boxes in sight into the document, and take the others out.
  show() {
    if (!this.rows.length) return;
    const from = this.root.scrollTop - AROUND, to = this.root.scrollTop + this.root.clientHeight + AROUND;
    const wanted = new Map();
    for (let i = this.first(from); i < this.rows.length && this.rows[i].top < to; i += 1) wanted.set(this.rows[i].id, this.rows[i]);
    const chosen = this.rows[this.at.get(page.selected)];
    if (chosen) wanted.set(chosen.id, chosen); // the tree names it as its active descendant
    for (const [id, made] of this.shown) if (!wanted.has(id)) { for (const part of made) part.remove(); this.shown.delete(id); }
    for (const [id, row] of wanted) if (!this.shown.has(id)) { const made = this.draw(row); this.sheet.append(...made); this.shown.set(id, made); }
    if (chosen) this.root.setAttribute("aria-activedescendant", `node ${chosen.id}`.replaceAll(/\W/g, "-")); else this.root.removeAttribute("aria-activedescendant");
  }

  first(y) {
    let low = 0, high = this.rows.length - 1;
    while (low < high) { const middle = (low + high) >> 1; if (this.rows[middle].top + this.rows[middle].height < y) low = middle + 1; else high = middle; }
    return low;
  }

  draw(row) {
    const { one, level } = row, kind = kindOf(one), x = 8 + level * STEP, status = page.trial?.text === page.text ? page.trial.states.get(one.id) : null, mark = this.marks.get(one.id);
    const family = siblings(one), middle = row.height / 2, box = h("div", { class: `box${one.parent && !children(one.id).length && (isCondition(one) || !holdsNodes(one.type)) ? " leaf" : ""}` });
    box.style.cssText = `--x:${x}px;--colour:${kind.colour ?? "#444444"}`;
    const named = one.name && one.name !== one.type;
    box.append(
      h("div", { class: "first" },
        one.slot && one.slot !== "root" ? h("span", { class: "lead" }, `${one.slot.replaceAll("_", " ")}:`) : null, h("span", { class: "sign", "aria-hidden": "true" }, kind.symbol),
        h("span", { class: "name" }, labelOf(one)), named ? h("span", { class: "type" }, one.type) : null,
        one.modifiers.map((entry) => pill(`${entry.name} ${bare(entry.text)}`)),
        status ? sign(status.status, SIGNS[status.status], status.status) : null, mark ? sign(mark, mark === "error" ? "✖" : "▲", mark) : null),
      row.ports ? h("div", { class: "ports" }, row.ports) : "",
      row.note ? h("div", { class: "note" }, row.note) : "");
    if (status?.words || mark) box.title = [status?.words, ...findingsOf(one.id).map(({ message }) => message)].filter(Boolean).join("\n");
    const item = h("div", {
      class: ["item", status?.status, mark && (mark === "error" ? "wrong" : "doubtful"), this.found.has(one.id) && "found"].filter(Boolean).join(" "), role: "treeitem", id: `node ${one.id}`.replaceAll(/\W/g, "-"), "data-id": one.id,
      "aria-level": level + 1, "aria-setsize": family.length || 1, "aria-posinset": (family.indexOf(one) + 1) || 1, "aria-selected": String(one.id === page.selected),
    });
    item.style.cssText = `top:${row.top}px;height:${row.height}px`;
    for (let above = one, i = level; above?.parent; above = node(above.parent), i -= 1) { // lines from the ancestors to their later children
      const last = siblings(above).at(-1) === above, own = above === one, left = 8 + (i - 1) * STEP + 11;
      if (own || !last) { const line = h("i", { class: "down" }); line.style.cssText = `left:${left}px;top:-3px;height:${(own && last ? middle : row.height) + 3}px`; item.append(line); }
      if (own) { const line = h("i", { class: "over" }); line.style.cssText = `left:${left}px;top:${middle}px;width:${STEP - 11}px`; item.append(line); }
    }
    item.append(box);
    if (!row.heading) return [item];
    const heading = h("div", { class: "heading", role: "presentation" }, row.heading.words);
    heading.style.cssText = `top:${row.heading.top}px;height:${HEADING}px`;
    return [heading, item];
  }

  // Show which node is selected, and bring it into sight.
  select(into = true) {
    const row = this.rows[this.at?.get(page.selected)];
    for (const item of this.sheet.querySelectorAll("[aria-selected]")) item.setAttribute("aria-selected", String(item.dataset.id === page.selected));
    if (row && into) {
      const { scrollTop, clientHeight } = this.root;
      if (row.top < scrollTop) this.root.scrollTop = row.top - 8;
      else if (row.top + row.height > scrollTop + clientHeight) this.root.scrollTop = row.top + row.height - clientHeight + 8;
    }
    this.show();
  }

  step(by) {
    const i = (this.at?.get(page.selected) ?? -1) + by;
    return this.rows[Math.max(0, Math.min(this.rows.length - 1, i))]?.id ?? "";
  }

  get inSight() { return Math.max(1, Math.floor(this.root.clientHeight / 45)); }

  // ------------------------------------------------------------------------------------------------ dragging

  down(event) {
    const id = this.idOf(event);
    if (!id || event.button !== 0 || page.small || !this.on.mayDrag(id)) return;
    this.drag = { id, x: event.clientX, y: event.clientY, moving: false, to: null };
  }

  // Carry a new node from here on: it is brought where the pointer is let go.
  carry(name, { clientX: x, clientY: y }) { this.drag = { id: "", name, x, y, moving: false, to: null }; }

  move(event) {
    const { drag } = this;
    if (!drag) return;
    if (!drag.moving && Math.hypot(event.clientX - drag.x, event.clientY - drag.y) < FAR) return;
    if (!drag.moving) { drag.moving = true; this.sheet.append(this.line); this.shown.get(drag.id)?.at(-1).classList.add("dragged"); }
    const area = this.root.getBoundingClientRect(), edge = 30;
    if (event.clientY < area.top + edge) this.root.scrollTop -= 12; else if (event.clientY > area.bottom - edge) this.root.scrollTop += 12;
    const over = event.clientX >= area.left && event.clientX <= area.right && event.clientY >= area.top && event.clientY <= area.bottom;
    drag.to = over || !drag.name ? this.target(event.clientY - area.top + this.root.scrollTop, drag.id) : null;
    for (const item of this.sheet.querySelectorAll(".into")) item.classList.remove("into");
    this.line.hidden = drag.to?.y === undefined;
    if (drag.to?.y !== undefined) this.line.style.cssText = `top:${drag.to.y - 1.5}px;left:${drag.to.x}px`;
    else if (drag.to) this.shown.get(drag.to.into)?.at(-1).classList.add("into");
    event.preventDefault();
  }

  // Where a node would go: { into, index } with the line's place, or into a box.
  target(y, dragged) {
    const row = this.rows[this.first(y)];
    if (!row && !dragged) return { into: "", index: 0 };
    if (!row || row.id === dragged || row.id.startsWith(`${dragged}/`)) return null;
    const { one } = row, part = (y - row.top) / row.height, inside = holdsNodes(one.type), below = children(one.id), x = 8 + row.level * STEP;
    if (inside && (part > 0.3 || !one.parent)) {
      if (below.length && part > 0.7) return { into: one.id, index: 0, y: row.top + row.height, x: x + STEP };
      return { into: one.id, index: below.length };
    }
    if (!one.parent || !holdsNodes(node(one.parent).type)) return null;
    return part < 0.5 ? { into: one.parent, index: one.index, y: row.top, x } : { into: one.parent, index: one.index + 1, y: row.top + row.height, x };
  }

  up(done) {
    const { drag } = this;
    this.drag = null;
    if (!drag?.moving) return;
    this.line.remove();
    for (const item of this.sheet.querySelectorAll(".into, .dragged")) item.classList.remove("into", "dragged");
    this.dropped = performance.now();
    if (!done || !drag.to) return;
    if (drag.name) this.on.bring(drag.name, drag.to.into, drag.to.index); else this.on.drop(drag.id, drag.to.into, drag.to.index);
  }
}

const pill = (words) => h("span", { class: words.length < 20 ? "pill short" : "pill" }, words);
const sign = (rank, shown, words) => h("span", { class: `mark ${rank}` }, h("span", { "aria-hidden": "true" }, shown ?? words), h("span", { class: "visually-hidden" }, words));

const SIGNS = { success: "✔", failure: "✘", running: "▶", invalid: "·", reached: "✔ reached", unreached: "not reached" };

function words(one) { return one.ports.filter(({ text }) => text !== "{}").map(({ name, text }) => (name === one.type ? bare(text) : `${name}: ${bare(text)}`)).join(", "); }

function headingOf(name) {
  const found = page.state.definitions.find((one) => one.name === name), list = (ports) => ports.map((port) => port.name).join(", ");
  const ports = found ? [found.inputs.length && `in ${list(found.inputs)}`, found.outputs.length && `out ${list(found.outputs)}`].filter(Boolean).join("; ") : "";
  return `subtree ${name}${ports ? ` (${ports})` : ""}`;
}
