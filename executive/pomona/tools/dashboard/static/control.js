// The control bar, the banner of the safe state, and the header: acknowledged states, never mere clicks.
import { $, h, put, seconds } from "./dom.js";
import { hasNoEnd, holdsControl, isOver, page, say } from "./page.js";
import { isClosed, isStale, link, press } from "./link.js";
import { drawQuestions } from "./questions.js";
import { heldWords, lookFirst } from "./steps.js";

export const STATUS_WORD = { success: "✓", failure: "✗", partial: "◐", stopped: "■", error: "■", running: "▶", paused: "❚❚", pausing: "❚❚", preparing: "◌", "no end": "■" };
const KIND = { simulated: "SIMULATED", emulated: "EMULATED", real: "REAL", frames: "RECORDED FRAMES", mock: "MOCK" };
const BEHIND = 2; // seconds by which a simulated run must lag the wall clock for both to be shown
const NARROW = 1500; // px of the window below which devices that answer share one entry
const OLD = 1; // seconds without a message from a device after which it is marked

$("who").value = localStorage.getItem("pomona-who") || "";
$("who").addEventListener("change", (event) => localStorage.setItem("pomona-who", event.target.value));
let shownPause = 0; // number of the pause on the screen: resume and step end this one
for (const button of document.querySelectorAll("[data-action]")) button.addEventListener("click", (click) => { if (button.dataset.action !== "resume" || click.detail < 2) act(button.dataset.action); });

function act(action) {
  if (action === "take") take(); else press(action, "", shownPause);
}

// Control is taken under a name, since the operator of each action is recorded.
export function take() {
  const named = Boolean($("who").value.trim());
  $("who").setAttribute("aria-invalid", !named);
  if (named) { press("take"); return; }
  $("who").focus();
  say("Type your name first: it is recorded with your actions.", "bad");
}

// The confirmed speed; while the slider is dragged, its own value.
let wanted = null;
$("arm-speed").addEventListener("input", (event) => { wanted = Number(event.target.value); page.dirty = true; });
$("arm-speed").addEventListener("change", (event) => { wanted = null; press("speed", `${event.target.value} %`); });

function drawSpeed(s, may) {
  const now = Math.round(100 * s.speed);
  const asked = link.press?.action === "speed" && ["sent", "accepted"].includes(link.press.state) ? parseInt(link.press.detail, 10) : wanted;
  $("arm-speed").disabled = !may;
  $("arm-speed").parentElement.hidden = !may && now === 100; // this page cannot change it, and it is the default
  if (wanted === null) $("arm-speed").value = asked ?? now;
  put($("arm-speed-words"), asked === null || asked === now ? `${now} %` : `${now} % → ${asked} %`);
  $("arm-speed-words").dataset.slow = now < 100;
}

let wasMine = false, taken = ""; // whether this page held control, and how it lost it
export function drawControl(s) {
  drawQuestions(s);
  shownPause = s.pause;
  const live = !page.recorded;
  const mine = holdsControl(), armed = link.armed === true;
  const running = s.state === "running" && !s.ended, paused = s.state === "paused" && !s.ended;
  const enabled = { take: armed && !mine, release: mine, pause: mine && running, resume: mine && paused, step: mine && paused, stop: mine && (running || paused), acknowledge: mine && Boolean(s.ended) };
  for (const button of document.querySelectorAll("[data-action]")) {
    const { action } = button.dataset;
    if (action in enabled) button.disabled = !enabled[action];
    if (action === "take" || action === "release") button.hidden = mine === (action === "take");
  }
  drawSpeed(s, mine && (running || paused));
  $("control").hidden = isClosed() || (!live && $("runs-view").hidden);
  const { held_by: holder, viewers, holder_here: here } = page.control;
  if (mine) taken = ""; else if (wasMine && holder) taken = " It was taken over from you.";
  wasMine = mine;
  put($("holder"), mine ? "You hold control." : holder ? `${holder} holds control${here === false ? ", but that page is not connected" : ""}.${taken}` : "No operator holds control.");
  $("holder").dataset.mine = mine;
  document.body.classList.toggle("mine", mine);
  put($("viewers"), viewers > 1 ? `${viewers} watch.` : "");
  const last = s.acts.findLast((a) => a.action !== "note");
  put($("ack"), last ? `last: ${last.action.replaceAll("_", " ")} by ${last.who}` : "");
  const name = (path) => s.byPath.get(path)?.name ?? path;
  const breaks = [...[...s.breaks.before].map((path) => `before ${name(path)}`), ...[...s.breaks.after].map((path) => `after ${name(path)}`)];
  put($("breaks"), breaks.length && !s.ended ? `◉ Breakpoints: ${breaks.join(", ")}` : "");
  $("latched").hidden = !s.safeStop || !live;
  put($("latched-reason"), s.safeStop ?? "");
  const took = link.press?.action === "safe_stop" && link.press.state === "confirmed" ? `Confirmed after ${link.press.took.toFixed(0)} ms. ` : "";
  put($("latched-rest"), s.safeStop ? took + restWords(s) : "");
}

// State of the devices after a safe stop, as far as they have reported it.
function restWords(s) {
  const silent = [...s.links].filter(([, link]) => link.state !== "ok").map(([device]) => device);
  if (silent.length) return `No feedback from ${silent.join(", ")}: its motion is unknown. Look at the cell: if anything moves, press the emergency stop.`;
  if (s.unrest) return `Standstill not confirmed: ${s.unrest}. Look at the cell: if anything moves, press the emergency stop.`;
  const hand = ` In the hand: ${heldWords(s)}.`;
  return s.ended ? `The cell reports standstill.${hand} Look first ${lookFirst(s)}. Acknowledging moves nothing; nothing resumes by itself.` : "Stop requested; standstill not yet reported.";
}

// A pause at a breakpoint has the node's path; the page shows its name.
export function wordsOf(s, because) {
  const [, side, path] = because.match(/^breakpoint (before|after) (.+)$/) ?? [];
  return side ? `breakpoint ${side} ${s.byPath.get(path)?.name ?? path}` : because;
}

export function drawHeader(s) {
  const kind = s.run?.cell_kind ?? "";
  put($("kind"), `${page.recorded ? "RECORD · " : ""}${KIND[kind] ?? "NO CELL"}`);
  $("kind").dataset.kind = kind;
  put($("run"), s.run ? `${s.run.tree} · seed ${s.run.seed}` : page.recorded ?? "no run yet");
  put($("run-facts"), s.run ? `${s.speed < 1 ? `speed ${Math.round(100 * s.speed)} % · ` : ""}cell ${s.run.cell} · ${s.run.run}` : "");
  $("run").parentElement.title = s.run ? `${s.run.run}\ntree ${s.run.tree_path} (${s.run.tree_hash})\ncell ${s.run.cell_path}` : "";
  const start = page.recorded ? null : page.control.start;
  const preparing = Boolean(start && !start.problem);
  const ended = page.whole.ended; // an outcome is the whole run's, whatever moment is looked at
  const state = preparing ? "preparing" : ended ? ended.outcome : hasNoEnd() ? "no end" : s.state;
  const old = !page.recorded && isStale() && (s.run || preparing);
  if (preparing) {
    put($("kind"), KIND[start.cell_kind] ?? "CELL");
    $("kind").dataset.kind = start.cell_kind;
    put($("run"), start.tree);
    put($("run-facts"), start.what);
  }
  put($("state"), old ? `? last known: ${state}` : `${STATUS_WORD[state] ?? ""} ${state}`.trim());
  $("state").dataset.state = old ? "old" : state;
  $("state").title = s.because;
  const still = page.beat && !page.recorded && !old && s.state === "running" && !s.ended ? (performance.now() - page.beat.moved) / 1000 : 0;
  const wall = page.beat && !page.recorded && page.at === null && kind === "simulated" && !s.ended ? page.beat.wall + (performance.now() - page.beat.received) / 1000 : 0;
  const here = wall > s.t + BEHIND ? ` (${seconds(wall)} real)` : "";
  document.body.classList.toggle("preparing", preparing);
  put($("clock"), preparing ? "" : `${(page.at ?? s.t).toFixed(1)} s${here}${ended && page.at !== null ? ` of ${page.whole.t.toFixed(1)} s` : ""}${still > 3 ? ` · no tick for ${still.toFixed(0)} s` : ""}`);
  $("clock").classList.toggle("stale", still > 3);
  drawLinks(s);
  document.title = s.run ? `${STATUS_WORD[state] ?? ""} ${s.run.tree} – Pomona` : "Pomona";
}

// Each device: state of its link and age of its last message; in a record, time of the state.
function drawLinks(s) {
  const over = isOver(s), live = !page.recorded && page.at === null && page.beat && (!s.ended || s.safeStop); // the safe state holds the devices open
  const since = live ? (performance.now() - page.beat.received) / 1000 : 0;
  const links = [...s.links].map(([device, { state, t }]) => {
    const age = live && device in page.beat.ages ? page.beat.ages[device] + (since > 1.5 ? since : 0) : null;
    const rank = state !== "ok" ? "bad" : over ? "still" : age !== null && age > OLD ? "old" : "ok";
    const words = over && !live && state === "ok" ? ": closed" : state !== "ok" ? `: ${state}, for ${seconds(Math.max(0, s.t - t))}` : "";
    return { device, rank, words, seconds: age, age: age === null ? "" : seconds(age), title: `${device}: link ${state} since ${seconds(t)}${age === null ? "" : `, last message ${seconds(age)} ago`}` };
  });
  const fine = links.filter((l) => l.rank === "ok" || l.rank === "still");
  if (innerWidth < NARROW && fine.length > 2) { // those that answer share one entry where room is scarce
    const oldest = Math.max(...fine.map((l) => l.seconds ?? -1));
    links.splice(0, links.length, { device: `${fine.length} devices`, rank: fine[0].rank, words: fine[0].words, age: oldest < 0 ? "" : seconds(oldest), title: fine.map((l) => l.title).join("\n") }, ...links.filter((l) => !fine.includes(l)));
  }
  const key = JSON.stringify(links);
  if ($("links").dataset.key === key) return;
  $("links").dataset.key = key;
  $("links").replaceChildren(...links.map((l) => h("span", { class: `link ${l.rank}`, title: l.title }, l.device, l.words, l.age ? h("span", { class: "age" }, ` ${l.age}`) : null)));
}
