// What the tree asks a person now, with a button for each answer. Who holds control answers.
import { $, h } from "./dom.js";
import { press } from "./link.js";
import { holdsControl } from "./page.js";

export function drawQuestions(s) {
  const open = s.ended ? [] : s.nodes.filter((node) => node.kind === "ask" && s.node.get(node.path)?.status === "RUNNING");
  const mine = holdsControl();
  const key = JSON.stringify([open.map((node) => [node.path, s.node.get(node.path).feedback]), mine]);
  if ($("questions").dataset.key === key) return;
  $("questions").dataset.key = key;
  $("questions").hidden = !open.length;
  $("questions").replaceChildren(...open.map((node) => h("div", { class: "question" },
    h("b", {}, s.node.get(node.path).feedback || node.name),
    ...choicesOf(node).map((choice) => h("button", { disabled: !mine, title: mine ? "" : "Take control to answer.", onclick: () => press("answer", `${choice} ← ${node.path}`) }, choice)),
    mine ? null : h("span", { class: "muted" }, "Take control to answer."))));
}

// The file says them as a list, "[red, green]"; unless it does they are yes and no.
function choicesOf(node) {
  const written = node.settings?.choices;
  return written ? written.replace(/^\[|\]$/g, "").split(",").map((word) => word.trim().replace(/^(["'])(.*)\1$/, "$2")) : ["yes", "no"];
}
