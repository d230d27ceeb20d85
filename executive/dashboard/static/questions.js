// What the tree asks a person now, with a button for each answer. Who holds control answers.
import { $, h } from "./dom.js";
import { press } from "./link.js";
import { holdsControl, page } from "./page.js";

export function drawQuestions(s) {
  const open = s.ended ? [] : s.nodes.filter((node) => (node.kind === "ask" || isApproval(s, node)) && s.node.get(node.path)?.status === "RUNNING");
  document.body.classList.toggle("approving", open.some((node) => node.kind === "approve") && !page.recorded); // what is planned is seen in large
  const mine = holdsControl();
  const key = JSON.stringify([open.map((node) => [node.path, s.node.get(node.path).feedback]), mine]);
  if ($("questions").dataset.key === key) return;
  $("questions").dataset.key = key;
  $("questions").hidden = !open.length;
  $("questions").replaceChildren(...open.map((node) => h("div", { class: "question" },
    h("b", {}, s.node.get(node.path).feedback || node.name),
    ...choicesOf(node).map((choice) => h("button", { disabled: !mine, title: mine ? "" : "Take control to answer.", onclick: () => press("answer", `${choice} ← ${node.path}`) }, choice === "approve" ? "✓ Approve" : choice === "refuse" ? "✗ Refuse" : choice)),
    mine ? null : h("span", { class: "muted" }, "Take control to answer."))));
}

// It asks as long as what it wraps has not been started.
function isApproval(s, node) {
  return node.kind === "approve" && !s.nodes.some((other) => other.parent === node.path && s.node.get(other.path)?.status === "RUNNING");
}

// The file says them as a list, "[red, green]"; unless it does they are yes and no.
function choicesOf(node) {
  if (node.kind === "approve") return ["approve", "refuse"];
  const written = node.settings?.choices;
  return written ? written.replace(/^\[|\]$/g, "").split(",").map((word) => word.trim().replace(/^(["'])(.*)\1$/, "$2")) : ["yes", "no"];
}
