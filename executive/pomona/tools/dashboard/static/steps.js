// The next step as a button: go on after a pause; after the end run again, put down the held fruit, bring the arm home.
import { $, h } from "./dom.js";
import { take } from "./control.js";
import { isClosed, press } from "./link.js";
import { holdsControl, page } from "./page.js";
import { showRuns, startRun } from "./runs.js";

const LASTS = new Set(["real", "emulated"]); // cells that keep their state after a run; a simulated one begins anew
const MOTIONS = { // slow motions of the tree `recover`, after a run or by hand
  down: { label: "Put down the held fruit", release: "true", about: "The hand lowers until the fruit stands, at most 150 mm, and opens. Then the arm moves to its home pose at 10 % of its speed." },
  home: { label: "Home, slowly", release: "false", about: "The arm moves to its home pose at 10 % of its speed. The fingers stay as they are." },
};
const recover = (form, release) => startRun({ ...form, tree: "recover", settings: { ...form.settings, release }, speed: "100 %" });
const stem = (path) => (path ?? "").split(/[\\/]/).at(-1).replace(/\.ya?ml$/, "");

// Options of the cell among a run's settings: they say which devices move.
const optionsOf = ({ settings = {}, parameters = {} }) => Object.fromEntries(Object.entries(settings).filter(([name]) => !(name in parameters)));
const addressesOf = ({ cell_text: text = "", settings = {} }) => [...new Set([...text.matchAll(/^\s+address: *"?([^"\s#]+)/gm)].map(([, at]) => at.replace(/^\{(\w+)\}$/, (all, name) => settings[name] ?? text.match(new RegExp(`^ {2}${name}: *"?([^"\\s#]+)`, "m"))?.[1] ?? all)))].join(", ");

// After a stop: what may be held, what to look at first, and the command that goes on.
export const heldWords = ({ hand }) => hand || (hand === null ? "not known" : "nothing was felt");
const silent = (s) => [...s.links].filter(([, { state }]) => state !== "ok").map(([device]) => device).join(", ");
export const lookFirst = (s) => (silent(s) ? `at the cell: ${silent(s)} reports nothing, so its motion is unknown` : !LASTS.has(s.run.cell_kind) ? "at the failure on this page: the cell begins anew with each run" : s.hand ? "at the hand: what it holds falls when it opens" : "at the arm and its way home");
const quoted = (word) => (/^[\w./:=%+,-]+$/.test(word) ? word : `'${word.replaceAll("'", "'\\''")}'`);
export const commandOf = ({ run }, recovers = LASTS.has(run.cell_kind)) => ["pomona run", quoted(run.tree_path ?? ""), run.cell === "dry" ? `--dry ${run.cell_path && quoted(run.cell_path)}`.trim() : `--cell ${quoted(run.cell_path ?? "")}`, ...Object.entries(run.settings ?? {}).map(([name, value]) => `--set ${quoted(`${name}=${value}`)}`), recovers ? "--recover" : `--seed ${run.seed}`].join(" ");

// The form of a start that repeats this run.
const again = (run) => ({ tree: stem(run.tree_path), cell: stem(run.cell_path), seed: run.seed, settings: run.settings ?? {}, pace: "real", speed: `${Math.round(100 * (run.speed ?? 1))} %` });

// A motion that was asked for and is not confirmed. It is confirmed for the state that was shown: the run and what it holds.
let asked = null;
const stateOf = (s) => JSON.stringify([s.run?.run, s.hand]);
function confirmation(s, mine) {
  const { label, about, release } = asked.motion, leave = () => { asked = null; page.dirty = true; }, form = { ...again(s.run), settings: optionsOf(s.run), after: s.run.run };
  return [h("p", { class: "confirm", role: "alert" }, h("b", {}, label), ` on ${s.run.cell}, ${s.run.cell_kind}, at ${addressesOf(s.run) || "no address"}. ${about} `, h("b", {}, "In the hand: "), `${heldWords(s)}.`),
    h("button", { class: "primary", disabled: !mine, onclick: () => { leave(); recover(form, release); } }, "Move now"), h("button", { onclick: leave }, "Cancel")];
}

function stepsOf(s) {
  if (!page.recorded && !s.ended && s.state === "paused") return [["▶ Resume", "Go on in place", () => press("resume", "", s.pause)], ["❙▶ Step", "Run one tick", () => press("step", "", s.pause)], ["⟳ Reload file", "Take nodes that have not begun over from the changed tree file", () => press("reload", "", s.pause)]];
  if (!s.run) return [[page.control.starts ? "Start or open a run" : "Open a run", page.control.starts ? "The list of runs, and the form that starts one (r)" : "The list of runs (r)", () => showRuns(true)]];
  if (!s.ended || s.safeStop || !page.control.starts || isClosed() || !stem(s.run.cell_path)) return [];
  const lasts = LASTS.has(s.run.cell_kind) && !page.recorded && s.run.tree !== "recover";
  return [
    ...[lasts && s.hand ? MOTIONS.down : null, lasts ? MOTIONS.home : null].filter(Boolean).map((motion) => [motion.label, motion.about, () => { asked = { motion, of: stateOf(s) }; page.dirty = true; }]),
    ["↻ Run again", "The same tree, cell, seed and settings", () => startRun(again(s.run))],
  ].filter(Boolean);
}

// The same motions in the form of a new run, for the cell that is chosen there. `why`: why no run can start now.
let handKey = "";
function sure(button, label, cell, form, release) { // the first click shows what moves
  const words = `Look at the hand, then: ${label} on ${cell.name}, ${cell.options.map(({ name, default: usual }) => `${name} ${form.settings[name] ?? usual}`).join(", ")}`;
  if (button.textContent === words) { button.textContent = label; recover(form, release); } else button.textContent = words;
}
export function drawByHand(cell, form, why) {
  const key = JSON.stringify([cell?.name, cell?.kind, why]);
  if (key === handKey) return;
  handKey = key;
  const lasts = LASTS.has(cell?.kind);
  $("by-hand-about").textContent = lasts ? `Slow motions on ${cell.name}. Each is a short run with its own record; SAFE STOP ends it. Single joints are moved with the robot's teach pendant.` : `A ${cell?.kind ?? "simulated"} cell begins anew with each run: there is nothing to move by hand.`;
  $("by-hand-motions").replaceChildren(...(lasts ? Object.values(MOTIONS) : []).map(({ label, about, release }) => h("div", {}, h("dt", {}, h("button", { type: "button", disabled: Boolean(why), onclick: ({ currentTarget }) => sure(currentTarget, label, cell, form(), release) }, label)), h("dd", {}, about))));
}

let key = "";
export function drawSteps(s) {
  const mine = holdsControl(), steps = stepsOf(s), busy = page.control.start && !page.control.start.problem;
  const watches = mine || !s.run; // no control is needed
  if (asked?.of !== stateOf(s)) asked = null;
  const now = JSON.stringify([asked, steps.map(([label]) => label), watches, busy, s.run?.run, s.pause]);
  if (now === key) return;
  key = now;
  $("steps").replaceChildren(...asked ? confirmation(s, mine) : [
    steps.length && !watches ? h("button", { class: "primary", onclick: take }, "Take control") : null,
    ...steps.map(([label, title, onclick], i) => h("button", { class: i || !watches ? null : "primary", title: watches ? title : `${title}. Take control first.`, disabled: !watches || busy, onclick }, label)),
  ].filter(Boolean));
}
