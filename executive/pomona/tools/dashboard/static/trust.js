// Facts that an operator must be able to see: whether the state is live, whether a press has arrived, whether this page can
// act, the run in preparation, and the state of the live cell beside a record.
import { $, seconds } from "./dom.js";
import { page } from "./page.js";
import { age, isClosed, isStale, isUnconfirmed, link, press, runIsSilent, TWICE } from "./link.js";

const SHOWN = 4000; // ms for which a confirmed stop is shown
const WORD = { running: "▶ running", paused: "❚❚ paused", pausing: "❚❚ pausing", stopping: "■ stopping" };
const KIND = { real: "REAL CELL", simulated: "simulated cell", emulated: "emulated cell", frames: "recorded frames", mock: "mock" };
let dismissed = null; // a start's problem that was read

$("press-again").addEventListener("click", () => press(link.press.action, link.press.detail, link.press.number));
$("press-close").addEventListener("click", () => { link.press = null; drawPress(); });
$("problem-close").addEventListener("click", () => { dismissed = page.control.start; drawStartBar(); });

export function drawTrust(live) {
  drawLink(live);
  drawPress();
  drawStartBar();
  drawStrip(live);
}

const set = (id, text) => { if ($(id).textContent !== text) $(id).textContent = text; };

function drawLink(live) {
  const stale = isStale(), never = link.knownAt === null;
  document.body.classList.toggle("stale", stale && !page.recorded && !never);
  $("not-live").hidden = !stale || never;
  if (stale && !never) {
    const then = new Date(Date.now() - 1000 * age()).toLocaleTimeString();
    set("not-live-words", `${runIsSilent() ? "No message from the run's process" : "No message"} for ${age() < 90 ? `${age().toFixed(1)} s` : seconds(age())}. ${live.run ? `The data of the live run are of ${then}; the cell may have moved since.` : `Last message at ${then}.`}${link.socket ? "" : " Connecting again."}`);
  }
  if (stale && !never && $("connection").textContent === "connected") set("connection", "no answer");
  const button = $("safe-stop"), disarmed = !page.token || link.armed === false; // else it is tried, whatever the link does
  button.classList.toggle("disarmed", disarmed);
  button.classList.toggle("unsure", !disarmed && (stale || link.armed === null));
  button.setAttribute("aria-disabled", disarmed);
  document.body.classList.toggle("disarmed", disarmed);
  const again = performance.now() - link.escaped < TWICE;
  button.classList.toggle("again", again);
  set("safe-stop-words", again ? "Esc again stops" : !page.token ? "this page only watches" : link.armed === false ? "this page is of another start" : isClosed() ? "the program is closed" : !link.socket ? "no connection: a press is tried" : stale ? "the link is silent" : link.armed === null ? "connecting" : page.recorded ? "acts on the live cell" : "not the emergency stop");
}

function drawPress() {
  const made = link.press, bar = $("press");
  if (!made) { bar.hidden = true; return; }
  const what = made.action.replaceAll("_", " ").toUpperCase();
  const stop = made.action === "safe_stop";
  const late = isUnconfirmed(made) || made.state === "lost";
  const fresh = performance.now() - made.ended < SHOWN;
  const told = page.live.whole.safeStop; // the bar of the safe state shows the confirmation
  const shown = late || (made.state === "confirmed" && stop && fresh && !told) || (made.state === "refused" && stop);
  bar.hidden = !shown;
  if (!shown) return;
  bar.dataset.state = made.state;
  $("press-again").hidden = made.state !== "lost" && made.state !== "refused";
  $("press-close").hidden = $("press-again").hidden;
  const emergency = stop ? " If anything moves, press the EMERGENCY STOP." : "";
  const waited = ((performance.now() - made.at) / 1000).toFixed(1);
  if (made.state === "confirmed") { set("press-what", `✓ ${what} confirmed after ${made.took.toFixed(0)} ms`); set("press-words", made.words); }
  else if (made.state === "refused") { set("press-what", `${what} NOT CARRIED OUT`); set("press-words", `${made.words}.${emergency}`); }
  else if (made.state === "lost") { set("press-what", `${what} NOT CONFIRMED`); set("press-words", `Given up after ${(made.took / 1000).toFixed(0)} s: it will not be carried out later. ${came(made)}${emergency}`); }
  else if (made.state === "accepted") { set("press-what", `${what} NOT CONFIRMED`); set("press-words", `The server accepted it ${waited} s ago; the run has not confirmed it.${emergency}`); }
  else { set("press-what", `${what} NOT CONFIRMED`); set("press-words", `No answer for ${waited} s after ${made.tries} tries; trying again. ${came(made)}${emergency}`); }
}

const came = (made) => (made.back ? `Error: ${made.back}.` : "No error was reported.");

function drawStartBar() {
  const { start } = page.control;
  if (!start?.problem) dismissed = null;
  const problem = start?.problem && start !== dismissed && (dismissed?.problem !== start.problem || dismissed?.tree !== start.tree);
  $("problem").hidden = !problem;
  if (problem) set("problem-words", `${start.tree} did not start: ${start.problem}`);
  $("preparing").hidden = !start || Boolean(start.problem);
  if (!start || start.problem) return;
  const since = start.age + (performance.now() - page.heardControl) / 1000;
  set("preparing-what", `◌ Preparing ${start.tree}`);
  set("preparing-words", start.cancelled ? `Cancelled (${start.cancelled}): it will not begin.` : `${start.what}${start.of ? `, ${start.done + 1} of ${start.of}` : ""} · ${seconds(since)}${page.silent === null ? "" : " · busy"} · SAFE STOP cancels it${page.live.whole.run ? ". Below: the run before" : ""}`);
  if (start.of) { $("preparing-bar").max = start.of; $("preparing-bar").value = start.done; } else $("preparing-bar").removeAttribute("value");
}

// Over a record: state of the live cell in words, and the way back to it.
function drawStrip(live) {
  $("strip").hidden = !page.recorded;
  document.body.classList.toggle("recorded", Boolean(page.recorded));
  if (!page.recorded) return;
  const { start } = page.control;
  const going = live.run && !live.ended;
  const state = isClosed() ? "nothing runs, the program is closed" : start && !start.problem ? "◌ preparing a run" : live.safeStop ? "■ safe state, latched" : going ? WORD[live.state] ?? live.state : "nothing runs";
  $("strip").classList.toggle("moving", Boolean(going));
  set("strip-state", `LIVE: ${isStale() ? `? last known: ${state}` : state}`);
  set("strip-words", live.safeStop ? `${live.safeStop}. Go back to live to reset it.` : going ? `${live.run.tree} on ${live.run.cell} (${KIND[live.run.cell_kind] ?? live.run.cell_kind}) · ${live.t.toFixed(1)} s · SAFE STOP acts on it` : "");
}
