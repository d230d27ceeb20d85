// Sizes of the panels: handles between them, and one enlarged picture at a time. Stored in this browser.
import { $, h } from "./dom.js";
import { page } from "./page.js";

const STEP = 24; // px that an arrow key moves a handle
const kept = JSON.parse(localStorage.getItem("pomona-layout") || "{}");

function keep(name, value) {
  if (value === null) delete kept[name]; else kept[name] = value;
  localStorage.setItem("pomona-layout", JSON.stringify(kept));
  apply();
}

function apply() {
  for (const name of ["left", "lanes"]) {
    if (Number.isFinite(kept[name])) document.body.style.setProperty(`--${name}`, `${kept[name]}px`); else document.body.style.removeProperty(`--${name}`);
  }
  document.body.dataset.large = kept.large ?? "";
  page.dirty = true;
  for (const button of document.querySelectorAll("[data-enlarge]")) {
    const on = kept.large === button.dataset.enlarge;
    button.setAttribute("aria-pressed", on);
    button.textContent = on ? "Small" : "Large";
  }
}

// A handle on a panel's edge; `size` returns the panel's size for a position of the pointer.
function handle(panel, name, label, vertical, size) {
  const element = h("div", { class: `handle ${name}`, role: "separator", tabindex: "0", "aria-orientation": vertical ? "vertical" : "horizontal", "aria-label": label, title: `${label}: drag, arrow keys; double click as at first` });
  const now = () => (vertical ? panel.getBoundingClientRect().width : $("timeline").parentElement.clientHeight);
  const most = () => (vertical ? innerWidth * 0.55 : innerHeight * 0.6);
  const set = (px) => { keep(name, Math.round(Math.max(vertical ? 200 : 40, Math.min(most(), px)))); element.setAttribute("aria-valuenow", kept[name]); };
  element.setAttribute("aria-valuenow", "0");
  element.addEventListener("pointerdown", (e) => { element.setPointerCapture(e.pointerId); e.preventDefault(); });
  element.addEventListener("pointermove", (e) => { if (element.hasPointerCapture(e.pointerId)) set(size(e)); });
  element.addEventListener("dblclick", () => keep(name, null));
  element.addEventListener("keydown", (e) => {
    const way = { ArrowLeft: name === "left" ? -1 : 1, ArrowRight: name === "left" ? 1 : -1, ArrowUp: 1, ArrowDown: -1 }[e.key];
    if (!way || (/Left|Right/.test(e.key) !== vertical)) return;
    set(now() + way * STEP);
    e.preventDefault(); e.stopPropagation();
  });
  panel.append(element);
}

const [tree, time] = [".tree-panel", ".timeline-panel"].map((name) => document.querySelector(name));
handle(tree, "left", "width of the tree", true, (e) => e.clientX - tree.getBoundingClientRect().left);
handle(time, "lanes", "height of the timeline", false, (e) => $("timeline").parentElement.getBoundingClientRect().bottom - e.clientY - 40);

// Make the enlarged picture small again; returns whether there was one.
export function closeLarge() {
  const open = Boolean(kept.large) && !$("run-view").hidden;
  if (open) keep("large", null);
  return open;
}
for (const button of document.querySelectorAll("[data-enlarge]")) button.addEventListener("click", () => keep("large", kept.large === button.dataset.enlarge ? null : button.dataset.enlarge));
apply();
