// The tree's open questions, with a button for each answer; the operator who holds control answers.
import { $, h } from "./dom.js";
import { press } from "./link.js";
import { holdsControl, page } from "./page.js";

export function drawQuestions(s) {
  const open = s.ended ? [] : s.nodes.filter((node) => isOpen(s, node));
  document.body.classList.toggle("approving", open.some((node) => inside(s, node).length) && !page.recorded); // the plan is enlarged
  const mine = holdsControl();
  const key = JSON.stringify([open.map((node) => [node.path, s.node.get(node.path).starts, s.node.get(node.path).feedback]), mine]);
  if ($("questions").dataset.key === key) return;
  $("questions").dataset.key = key;
  $("questions").hidden = !open.length;
  $("questions").replaceChildren(...open.map((node) => question(node, s.node.get(node.path), mine)));
}

// Its buttons carry the question's number, since another one may be shown when the press arrives. Second clicks do not count.
function question(node, { starts, feedback }, mine) {
  return h("div", { class: "question" },
    h("b", {}, feedback || node.name),
    ...node.choices.map((choice) => h("button", { disabled: !mine, title: mine ? "" : "Take control to answer.", onclick: (click) => { if (click.detail < 2) press("answer", `${choice} ← ${node.path}`, starts); } }, choice === "approve" ? "✓ Approve" : choice === "refuse" ? "✗ Refuse" : choice)),
    mine ? null : h("span", { class: "muted" }, "Take control to answer."));
}

// An approval is open until its node has been started.
function isOpen(s, node) {
  return node.choices && s.node.get(node.path)?.status === "RUNNING" && !inside(s, node).some((path) => s.node.get(path)?.status === "RUNNING");
}

function inside(s, node) {
  return s.nodes.filter((other) => other.parent === node.path).map((other) => other.path);
}
