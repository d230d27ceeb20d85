// Faults that can be injected into a simulated or emulated cell. Real cells offer none.
import { h } from "./dom.js";
import { holdsControl, page } from "./page.js";
import { press } from "./link.js";

const choice = h("select", { "aria-label": "fault" });
const breaks = h("button", {}, "Let it fail");
const mends = h("button", {}, "Works again");
const panel = h("details", { id: "faults", class: "group", title: "Faults on purpose: simulated and emulated cells only" }, h("summary", {}, "⚡ Faults"), choice, breaks, mends);
document.querySelector("nav.control").append(panel);
breaks.addEventListener("click", () => press("fail", choice.value));
mends.addEventListener("click", () => press("fail", choice.value.split(" ")[0]));

export function drawFaults(s) {
  const known = page.recorded || s.ended ? {} : page.control.faults ?? {};
  const key = JSON.stringify(known);
  if (panel.dataset.key !== key) {
    panel.dataset.key = key;
    panel.hidden = !Object.keys(known).length;
    choice.replaceChildren(...Object.entries(known).map(([name, kinds]) => h("optgroup", { label: name }, ...kinds.map((kind) => h("option", { value: `${name} ${kind}` }, `${name}: ${kind.replaceAll("_", " ")}`)))));
  }
  breaks.disabled = mends.disabled = !holdsControl();
}
