// The behaviour tree as rows: one row a node, updated in place so that a thousand nodes stay smooth.
import { $, h, seconds } from "./dom.js";
import { leavesOf, standing } from "./store.js";

export class TreeView {
  constructor(onSelect, onBreak) {
    this.root = $("tree");
    this.rows = new Map();
    this.closed = new Set();
    this.selected = null;
    this.onSelect = onSelect;
    this.onBreak = onBreak;
    this.shown = null;
    this.scale = 1;
    this.running = null;
    $("search").addEventListener("input", () => this.filter());
    $("expand").addEventListener("click", () => { this.closed.clear(); this.filter(); });
    $("collapse").addEventListener("click", () => this.collapseDone());
    $("smaller").addEventListener("click", () => this.zoom(this.scale / 1.15));
    $("larger").addEventListener("click", () => this.zoom(this.scale * 1.15));
    $("fit").addEventListener("click", () => this.fit());
    this.root.addEventListener("keydown", (event) => this.key(event));
  }

  build(state) {
    this.rows.clear();
    this.closed.clear();
    this.state = state;
    this.shown = state.run;
    const depth = new Map();
    const parents = new Set(state.nodes.map((node) => node.parent));
    const children = state.nodes.map((node, number) => {
      const level = node.parent === null || node.parent === undefined ? 0 : (depth.get(node.parent) ?? 0) + 1;
      depth.set(node.path, level);
      const inner = parents.has(node.path);
      const icon = h("span", { class: "icon" });
      const detail = h("span", { class: "detail" });
      const attempt = h("span", { class: "attempt" });
      const time = h("span", { class: "time" });
      const stop = h("span", { class: "break" });
      const fold = h("button", { class: "fold", tabindex: "-1", "aria-label": "fold", onclick: (e) => { e.stopPropagation(); this.toggle(node.path); } }, inner ? "▾" : "");
      const row = h("div", { class: "row", id: `node-${number}`, role: "treeitem", "aria-expanded": inner ? "true" : null, "data-path": node.path, "aria-level": level + 1, title: node.description || node.comment || node.kind, onclick: () => this.select(node.path) },
        fold, icon, h("span", { class: "name" }, node.name), h("span", { class: "type" }, node.type === node.name || node.kind === node.name ? "" : node.type), stop, attempt, detail, time);
      row.style.setProperty("--level", level);
      this.rows.set(node.path, { node, row, icon, detail, attempt, time, stop, fold, text: node.name.toLowerCase(), last: "" });
      return row;
    });
    this.root.replaceChildren(...children);
    this.filter();
  }

  update(state) {
    if (this.shown !== state.run) { if (state.run) this.build(state); else return; }
    this.state = state;
    let running = null;
    for (const [path, row] of this.rows) {
      const node = state.node.get(path);
      const status = node?.status ?? "INVALID";
      const { icon, rank, words } = standing(node);
      const fresh = node && node.tick === state.tick && status !== "INVALID";
      const leaf = state.byPath.get(path).leaf;
      if (status === "RUNNING" && leaf) running = path;
      const attempts = state.attempts.get(path);
      const n = attempts?.length ? `${attempts.at(-1).number}/${attempts.at(-1).of}` : "";
      const age = status === "RUNNING" ? seconds(Math.max(0, state.t - node.since)) : duration(node);
      const stops = [state.breaks.before.has(path) ? "before" : "", state.breaks.after.has(path) ? "after" : ""].filter(Boolean).join(", ");
      const signature = `${status}|${icon}|${rank}|${fresh}|${node?.feedback}|${n}|${age}|${stops}|${path === this.selected}|${row.hidden}`;
      if (signature === row.last) continue;
      row.last = signature;
      row.row.className = `row ${rank}${leaf ? " leaf" : ""}${fresh ? " fresh" : ""}${path === this.selected ? " selected" : ""}${row.hidden ? " hidden" : ""}`;
      row.row.setAttribute("aria-selected", path === this.selected);
      row.icon.textContent = icon;
      row.icon.setAttribute("aria-label", words);
      row.icon.title = `${words}${fresh ? " in this tick" : ""}`;
      row.detail.textContent = n ? "" : node?.feedback ?? ""; // the feedback of a retry says the same
      row.detail.title = node?.feedback ?? "";
      row.attempt.textContent = n ? `attempt ${n}` : "";
      row.time.textContent = age;
      row.stop.textContent = stops ? `◉ ${stops}` : "";
    }
    if (running && running !== this.running && $("follow").checked) this.show(running);
    this.running = running;
    this.explain(state);
  }

  // The leaf that a failed run ended with, once: chosen, unfolded and in sight.
  explain(state) {
    if (!state.ended || state.ended.outcome === "success") { this.explained = null; return; }
    if (this.explained === state.run) return;
    this.explained = state.run;
    const leaf = state.ended.reason ? leavesOf(state.ended.reason).at(-1).node_path : null;
    const path = this.rows.has(leaf) ? leaf : state.failures.at(-1)?.path;
    if (!this.rows.has(path)) return;
    this.open(path);
    requestAnimationFrame(() => this.show(path)); // rows that were never in sight have now their real height
  }

  open(path) {
    for (let above = this.rows.get(path).node.parent; above; above = this.rows.get(above)?.node.parent) this.closed.delete(above);
    this.filter();
    this.select(path);
  }

  // In sight in its panel, with what stands around it; the page itself stays where it is.
  show(path) {
    const row = this.rows.get(path)?.row;
    if (!row || !this.root.clientHeight) return;
    const top = row.getBoundingClientRect().top - this.root.getBoundingClientRect().top;
    const margin = Math.min(2 * row.offsetHeight, (this.root.clientHeight - row.offsetHeight) / 2);
    if (top < margin) this.root.scrollTop += top - margin;
    else if (top + row.offsetHeight + margin > this.root.clientHeight) this.root.scrollTop += top + row.offsetHeight + margin - this.root.clientHeight;
  }

  jumpToRunning() {
    if (this.running) this.open(this.running);
  }

  zoom(scale) {
    this.scale = Math.max(0.5, Math.min(1.8, scale));
    this.root.style.setProperty("--scale", this.scale);
  }

  fit() {
    const visible = [...this.rows.values()].filter((row) => !row.hidden).length;
    this.zoom(this.root.clientHeight / Math.max(1, visible * 25.5));
  }

  select(path) {
    if (path === undefined) return;
    this.selected = path;
    this.show(path);
    this.root.setAttribute("aria-activedescendant", this.rows.get(path)?.row.id ?? "");
    this.onSelect(path);
  }

  toggle(path) {
    if (this.closed.has(path)) this.closed.delete(path); else this.closed.add(path);
    this.filter();
  }

  collapseDone() {
    for (const [path, row] of this.rows) {
      const status = this.state?.node.get(path)?.status;
      if (row.fold.textContent && status === "SUCCESS") this.closed.add(path);
    }
    this.filter();
  }

  filter() {
    const wanted = $("search").value.trim().toLowerCase();
    const hiddenBelow = new Set();
    for (const [path, row] of this.rows) {
      const parent = row.node.parent;
      const folded = parent !== null && parent !== undefined && (hiddenBelow.has(parent) || this.closed.has(parent));
      if (folded) hiddenBelow.add(path);
      row.hidden = wanted ? !row.text.includes(wanted) : folded;
      row.row.classList.toggle("hidden", row.hidden);
      row.fold.textContent = row.fold.textContent && (this.closed.has(path) ? "▸" : "▾");
      if (row.fold.textContent) row.row.setAttribute("aria-expanded", !this.closed.has(path));
    }
  }

  key(event) {
    const visible = [...this.rows.entries()].filter(([, row]) => !row.hidden).map(([path]) => path);
    const index = visible.indexOf(this.selected);
    if (event.key === "ArrowDown") this.select(visible[Math.min(index + 1, visible.length - 1)]);
    else if (event.key === "ArrowUp") this.select(visible[Math.max(index - 1, 0)]);
    else if (event.key === "ArrowLeft" && this.selected) { this.closed.add(this.selected); this.filter(); }
    else if (event.key === "ArrowRight" && this.selected) { this.closed.delete(this.selected); this.filter(); }
    else if ((event.key === "b" || event.key === "a") && this.selected) this.onBreak(this.selected, event.key === "b" ? "before" : "after");
    else return;
    event.preventDefault();
  }
}

// What a skill computed takes none of a simulated run's time: then its own time is told.
function duration(node) {
  const history = node?.history ?? [];
  const took = lasted(history);
  return took !== null && node.computed > took + 0.05 ? `computed ${seconds(node.computed)}` : took === null ? "" : seconds(took);
}

function lasted(history) {
  for (let i = history.length - 1; i > 0; i--) {
    if (history[i].status !== "RUNNING" && history[i - 1].status === "RUNNING") return history[i].t - history[i - 1].t;
  }
  return null;
}
