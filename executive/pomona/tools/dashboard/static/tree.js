// The behaviour tree as rows: one row a node, updated in place so that a thousand nodes stay smooth.
import { $, h, percent, put, seconds } from "./dom.js";
import { leavesOf, resolved, standing } from "./store.js";

export class TreeView {
  constructor(onSelect, onBreak) {
    this.root = $("tree");
    this.rows = new Map();
    this.closed = new Set();
    this.opened = new Set(); // rows whose passed-over branches are shown
    this.selected = null;
    this.onSelect = onSelect;
    this.onBreak = onBreak;
    this.shown = null;
    this.running = null;
    $("search").addEventListener("input", () => this.filter());
    $("expand").addEventListener("click", () => { this.closed.clear(); for (const path of this.rows.keys()) this.opened.add(path); this.filter(); });
    $("collapse").addEventListener("click", () => this.collapseDone());
    this.root.addEventListener("keydown", (event) => this.key(event));
    new ResizeObserver(() => this.show(this.selected ?? ($("follow").checked ? this.running : null))).observe(this.root);
  }

  build(state) {
    this.rows.clear();
    this.closed.clear();
    this.opened.clear();
    this.state = state;
    this.shown = state.run;
    const byPath = new Map(state.nodes.map((node) => [node.path, node]));
    const nodes = state.nodes.filter((node) => !isModifier(node));
    const parentOf = new Map(nodes.map((node) => { // the row above: modifiers have none of their own
      let above = node.parent;
      while (byPath.has(above) && isModifier(byPath.get(above)) && bare(byPath.get(above)) === node.path) above = byPath.get(above).parent;
      return [node.path, byPath.has(above) ? bare(byPath.get(above)) : null];
    }));
    const parents = new Set(parentOf.values());
    const children = nodes.map((node, number) => {
      const parent = parentOf.get(node.path), level = parent === null ? 0 : (this.rows.get(parent)?.level ?? 0) + 1;
      const inner = parents.has(node.path);
      const [icon, detail, time, stop, more] = ["icon", "detail", "time", "break", "more"].map((name) => h("span", { class: name }));
      more.addEventListener("click", (e) => { e.stopPropagation(); this.opened.add(node.path); this.filter(); });
      const chips = state.nodes.filter((other) => isModifier(other) && bare(other) === node.path).map((other) => ({ node: other, chip: h("button", { class: "chip", tabindex: "-1", title: titleOf(other), onclick: (e) => { e.stopPropagation(); this.select(other.path); } }) }));
      const fold = h("button", { class: "fold", tabindex: "-1", "aria-label": "fold", onclick: (e) => { e.stopPropagation(); this.toggle(node.path); } }, inner ? "▾" : "");
      const lead = node.path.match(/:(\w+)$/)?.[1].replaceAll("_", " "); // a part of its parent that has a name: on failure
      const row = h("div", { class: "row", id: `node-${number}`, role: "treeitem", "aria-expanded": inner ? "true" : null, "data-path": node.path, "aria-level": level + 1, title: node.description || node.comment || node.kind, onclick: () => this.select(node.path) },
        fold, icon, h("span", { class: "name" }, lead ? h("i", {}, `${lead}: `) : null, node.name), h("span", { class: "type" }, node.type === node.name || node.kind === node.name ? "" : node.type), chips.map(({ chip }) => chip), more, stop, detail, time);
      row.style.setProperty("--level", level);
      this.rows.set(node.path, { node, row, level, parent, icon, detail, time, stop, more, fold, chips, text: node.name.toLowerCase(), last: "", spare: false });
      return row;
    });
    this.root.replaceChildren(...children);
    this.filter();
  }

  update(state) {
    if (this.shown !== state.run) { if (state.run) this.build(state); else return; }
    this.state = state;
    let running = null;
    this.foldSpare(state);
    for (const [path, row] of this.rows) {
      const node = state.node.get(path);
      const status = node?.status ?? "INVALID";
      const { icon, rank, words } = standing(node, state);
      const fresh = node && node.tick === state.tick && status !== "INVALID";
      const leaf = state.byPath.get(path).leaf;
      if (status === "RUNNING" && leaf) running = path;
      const age = status === "RUNNING" ? seconds(Math.max(0, state.t - node.since)) : duration(node);
      const paths = [path, ...row.chips.map((of) => of.node.path)];
      const stops = ["before", "after"].filter((side) => paths.some((of) => state.breaks[side].has(of))).join(", ");
      const chosen = paths.includes(this.selected);
      const chips = row.chips.map(({ node: of }) => [chipText(of, state), standing(state.node.get(of.path), state).rank, this.selected === of.path]);
      const signature = `${status}|${icon}|${rank}|${fresh}|${node?.feedback}|${age}|${stops}|${chosen}|${row.hidden}|${chips}|${row.spares}`;
      if (signature === row.last) continue;
      row.last = signature;
      row.row.className = `row ${rank}${leaf ? " leaf" : ""}${fresh ? " fresh" : ""}${chosen ? " selected" : ""}${row.hidden ? " hidden" : ""}`;
      row.row.setAttribute("aria-selected", chosen);
      put(row.icon, icon);
      row.icon.setAttribute("aria-label", words);
      row.icon.title = `${words}${fresh ? " in this tick" : ""}`;
      put(row.detail, percent(node?.feedback ?? ""));
      row.detail.title = node?.feedback ?? "";
      put(row.time, age);
      put(row.stop, stops ? `◉ ${stops}` : "");
      put(row.more, row.spares ? `+${row.spares}` : "");
      row.more.title = `${row.spares} that were not needed: show them`;
      row.chips.forEach(({ chip }, i) => { const [words, of, here] = chips[i]; put(chip, words); chip.className = `chip ${of}${here ? " here" : ""}`; });
    }
    if (running && running !== this.running && $("follow").checked) this.show(running);
    this.running = running;
  }

  // A branch that was passed over is folded into its parent: one that has not started although its parent has ended, or
  // although a later branch has started.
  foldSpare(state) {
    const started = new Set([...this.rows.keys()].filter((path) => state.node.get(path)?.history.length));
    const ended = (path) => started.has(path) && state.node.get(path).status !== "RUNNING";
    let changed = false;
    const later = new Set(), spares = new Map();
    for (const [path, row] of [...this.rows].reverse()) {
      const spare = row.parent !== null && !started.has(path) && (later.has(row.parent) || ended(row.parent)) && started.has(row.parent);
      if (started.has(path) && !row.node.path.includes(":on_")) later.add(row.parent);
      if (spare) spares.set(row.parent, (spares.get(row.parent) ?? 0) + 1);
      if (spare !== row.spare) { row.spare = spare; changed = true; }
    }
    for (const [path, row] of this.rows) row.spares = this.opened.has(path) ? 0 : spares.get(path) ?? 0;
    if (changed) this.filter();
  }

  // Select the leaf with which a failed run ended, unfolded and in sight; once.
  explain(state) {
    if (!state.ended || state.ended.outcome === "success") { this.explained = null; return; }
    if (this.explained === state.run) return;
    this.explained = state.run;
    const leaf = state.ended.reason ? leavesOf(state.ended.reason).at(-1).node_path : null;
    const path = this.rowOf(leaf) ? leaf : state.failures.at(-1)?.path;
    if (!this.rowOf(path)) return;
    this.open(path);
    requestAnimationFrame(() => this.show(path)); // now hidden rows have their real height
  }

  open(path) {
    for (let row = this.rowOf(path); row; row = this.rows.get(row.parent)) { this.closed.delete(row.parent); if (row.spare) this.opened.add(row.parent); }
    this.filter();
    this.select(path);
  }

  rowOf(path) { return this.rows.get(path) ?? this.rows.get(path?.replace(/(:\w+)+$/, "")); }

  // Scroll a row into sight within its panel, with its neighbours; the page itself does not scroll.
  show(path) {
    const row = this.rowOf(path)?.row;
    if (!row || !this.root.clientHeight) return;
    const top = row.getBoundingClientRect().top - this.root.getBoundingClientRect().top;
    const margin = Math.min(2 * row.offsetHeight, (this.root.clientHeight - row.offsetHeight) / 2);
    if (top < margin) this.root.scrollTop += top - margin;
    else if (top + row.offsetHeight + margin > this.root.clientHeight) this.root.scrollTop += top + row.offsetHeight + margin - this.root.clientHeight;
  }

  jumpToRunning() {
    if (this.running) this.open(this.running);
  }

  select(path) {
    if (path === undefined) return;
    this.selected = path;
    this.show(path);
    this.root.setAttribute("aria-activedescendant", this.rowOf(path)?.row.id ?? "");
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
      const { parent } = row;
      const folded = parent !== null && (hiddenBelow.has(parent) || this.closed.has(parent) || (row.spare && !this.opened.has(parent)));
      if (folded) hiddenBelow.add(path);
      row.hidden = wanted ? !row.text.includes(wanted) : folded;
      row.row.classList.toggle("hidden", row.hidden);
      row.fold.textContent = row.fold.textContent && (this.closed.has(path) ? "▸" : "▾");
      if (row.fold.textContent) row.row.setAttribute("aria-expanded", !this.closed.has(path));
      row.more.hidden = this.closed.has(path);
    }
  }

  key(event) {
    const visible = [...this.rows.entries()].filter(([, row]) => !row.hidden).map(([path]) => path);
    const index = visible.indexOf(this.rowOf(this.selected)?.node.path);
    if (event.key === "ArrowDown") this.select(visible[Math.min(index + 1, visible.length - 1)]);
    else if (event.key === "ArrowUp") this.select(visible[Math.max(index - 1, 0)]);
    else if (event.key === "ArrowLeft" && this.selected) { this.closed.add(this.selected); this.filter(); }
    else if (event.key === "ArrowRight" && this.selected) { this.closed.delete(this.selected); this.filter(); }
    else if ((event.key === "b" || event.key === "a") && this.selected) this.onBreak(this.selected, event.key === "b" ? "before" : "after");
    else return;
    event.preventDefault();
  }
}

// A modifier has the path of its node and its kind: fetch/Attempt:retry.
const isModifier = (node) => node.path.endsWith(`:${node.kind}`);
const bare = (node) => { let { path } = node; if (isModifier(node)) path = path.slice(0, -node.kind.length - 1); return path.replace(/(:(?!on_)\w+)+$/, ""); };
const titleOf = (node) => Object.entries(node.settings ?? {}).map(([name, value]) => `${name}: ${value}`).join("\n") || node.kind;

// Text of a modifier's chip: its setting, and its progress while it runs.
function chipText(node, state) {
  const attempts = state.attempts.get(node.path), setting = node.settings?.[node.kind] ?? "";
  if (attempts?.length) return `${node.kind} ${attempts.at(-1).number}/${attempts.at(-1).of}`;
  if (node.kind === "when") return "when";
  const value = resolved(setting, state);
  return value.length > 14 || value === "true" ? node.kind : `${node.kind} ${value}`.trim();
}

// Computing takes none of a simulated run's time, so its processor time is shown instead.
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
