// The next step as a button: go on after a pause; after the end run again, put down what is held, bring the arm home.
import { $, h } from "./dom.js";
import { take } from "./control.js";
import { press } from "./link.js";
import { holdsControl, page } from "./page.js";
import { startRun } from "./runs.js";

const LASTS = new Set(["real", "emulated"]); // cells that are after a run as it has left them; simulated ones begin anew
const stem = (path) => (path ?? "").split(/[\\/]/).at(-1).replace(/\.ya?ml$/, "");

// The form of a start that repeats this run.
const again = (run) => ({ tree: stem(run.tree_path), cell: stem(run.cell_path), seed: run.seed, settings: run.settings ?? {}, pace: "real", speed: `${Math.round(100 * (run.speed ?? 1))} %` });

function stepsOf(s) {
  if (!page.recorded && !s.ended && s.state === "paused") return [["▶ Resume", "Go on in place", () => press("resume", "", s.pause)], ["❙▶ Step", "Run one tick", () => press("step", "", s.pause)]];
  if (!s.ended || !s.run || s.safeStop || !page.control.starts || !stem(s.run.cell_path)) return [];
  const recover = (release) => ({ ...again(s.run), tree: "recover", settings: { release }, speed: "100 %" });
  const lasts = LASTS.has(s.run.cell_kind) && !page.recorded && s.run.tree !== "recover";
  return [
    lasts && s.hand ? ["Put down what is held", "Lower the hand until the fruit stands, open, then bring the arm home, slowly", () => startRun(recover("true"))] : null,
    lasts ? ["Home, slowly", "Bring the arm home at 10 % of its speed; the fingers stay as they are", () => startRun(recover("false"))] : null,
    ["↻ Run again", "The same tree, cell, seed and settings", () => startRun(again(s.run))],
  ].filter(Boolean);
}

let key = "";
export function drawSteps(s) {
  const mine = holdsControl(), steps = stepsOf(s), busy = page.control.start && !page.control.start.problem;
  const now = JSON.stringify([steps.map(([label]) => label), mine, busy, s.run?.run, s.pause]);
  if (now === key) return;
  key = now;
  $("steps").replaceChildren(...[
    steps.length && !mine ? h("button", { class: "primary", onclick: take }, "Take control") : null,
    ...steps.map(([label, title, onclick]) => h("button", { title: mine ? title : `${title}. Take control first.`, disabled: !mine || busy, onclick }, label)),
  ].filter(Boolean));
}
