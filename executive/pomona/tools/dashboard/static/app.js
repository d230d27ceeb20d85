// The page: messages in, state, views. A live run streams over the WebSocket; a recorded one is read. Both can be scrubbed.
import { $, put, seconds } from "./dom.js";
import { apply, emptyState } from "./store.js";
import { isOver, newCursor, newFeed, page, read, readAddress, say, withToken } from "./page.js";
import { connect, isClosed, isStale, link, press, TWICE } from "./link.js";
import { drawTrust } from "./trust.js";
import { closeLarge } from "./layout.js";
import { TreeView } from "./tree.js";
import { CameraView, PlotsView } from "./pictures.js";
import { drawPanels } from "./panels/index.js";
import { SceneView } from "./scene.js";
import { Timeline } from "./timeline.js";
import { drawControl, drawHeader, STATUS_WORD } from "./control.js";
import { drawBeside } from "./beside.js";
import { drawFaults } from "./faults.js";
import { drawLog, drawNode, drawPorts, drawWhy, onMoment } from "./panels.js";
import { openOver, openOverview, recordAddress, wantDetail } from "./record.js";
import { drawStart, loadRuns, showRuns } from "./runs.js";

const WORDS = 80; // ms between two writings while a record is played
const AT_ONCE = 25; // ms of drawing after which presses and messages come first
const REST = 3; // times as long as the last drawing took, nothing is drawn: a slow machine draws less often
const MOST_CHARACTERS = 30e6; // of messages that are kept for scrubbing in a live run; older ones become one state

const toggleBreak = (path, side) => press(`${page.whole.breaks[side].has(path) ? "un" : ""}break${side === "after" ? "_after" : ""}`, path);
const tree = new TreeView((path) => { page.selected = path; page.dirty = true; }, toggleBreak);
const camera = new CameraView();
const plots = new PlotsView();
const scene = new SceneView((path) => { tree.open(path); tree.show(path); });
const timeline = new Timeline(goTo);
onMoment(goTo);

// ------------------------------------------------------------------------------------------ the shown moment

const beginning = () => (page.base ? structuredClone(page.base) : emptyState());

const momentState = () => (page.at === null ? page.whole : momentOf(page.feed, page.at));

function momentOf(feed, at, cursor = "shown", wanted = () => true) {
  if (feed !== page.live && at >= feed.whole.t && !feed.overview?.detail) return feed.whole; // its end, as it was read
  if (feed[cursor].at > at || !feed[cursor].state.run) feed[cursor] = { ...newCursor(), ...(feed.base ? { state: structuredClone(feed.base) } : {}) };
  const here = feed[cursor];
  for (; here.index < feed.messages.length && (feed.messages[here.index].t ?? 0) <= at + 1e-9; here.index++) if (wanted(feed.messages[here.index])) apply(here.state, feed.messages[here.index]);
  here.at = at;
  return here.state;
}

// The samples up to a later moment, for the curves.
const isSample = (m) => m.value?.type === "SeriesView" || m.event === "RunStarted" || m.event === "Overview";
const samplesOf = (feed) => (t) => momentOf(feed, t, "ahead", isSample).series;

// The moment at which an ended run is opened: its end, or the failure; later motions do not explain a failure.
const tellingMoment = (s) => (s.ended?.outcome === "failure" && s.failures.length ? s.failures.at(-1).t : s.t);

// While a record is played the cursors move with every frame; texts and drawings follow less often.
let written = 0, resting = 0;
function render() {
  requestAnimationFrame(render);
  if (page.playing) play();
  if (!page.dirty && !page.playing) return;
  const now = performance.now();
  if (page.drawing || now < resting || (!page.dirty && now - written < WORDS)) { timeline.point(page.at ?? page.whole.t); plots.point(page.at); return; }
  written = now;
  page.dirty = false;
  drawInParts(now);
}

// Draw in parts; pending messages and presses are handled between two of them.
async function drawInParts(began) {
  page.drawing = true;
  let spent = 0, since = began;
  try {
    for (const draw of parts()) {
      draw();
      if (performance.now() - since < AT_ONCE) continue;
      spent += performance.now() - since;
      await new Promise((next) => { setTimeout(next); });
      since = performance.now();
    }
  } finally {
    page.drawing = false;
    if (page.opened || !page.recorded) document.documentElement.classList.remove("opens-record");
    const now = performance.now();
    spent += now - since;
    resting = spent < AT_ONCE ? 0 : now + REST * spent;
  }
}

function parts() {
  if (page.at !== null) wantDetail(page.at);
  const s = momentState(), live = page.live.whole, { whole } = page;
  const { over } = page, other = over && momentOf(over, page.at ?? page.whole.t);
  s.fatal = whole.fatal;
  const follows = page.at !== null; // later samples are known, too
  return [
    () => { drawHeader(s); drawTrust(live); drawControl(live); drawFaults(live); drawStart(); drawPlayback(); },
    () => { drawWhy(whole); drawBeside(whole); }, // first, since the other panels take the remaining space
    () => { tree.update(s); tree.explain(whole); },
    () => camera.update(s, page.at === null && !page.recorded && !s.ended ? page.pictures : null),
    () => { drawOver(over, other); scene.update(s, page.selected, other); },
    () => plots.update(s, page.at, Math.max(page.whole.t, over?.whole.t ?? 0), other, follows ? [samplesOf(page.feed), over && samplesOf(over)] : null),
    () => { drawPanels(s); drawNode(s, toggleBreak); drawPorts(s); drawLog(s); },
    () => timeline.draw(),
  ];
}

function drawPlayback() {
  $("live").classList.toggle("on", page.at === null && !isOver(page.whole));
  $("live").hidden = Boolean(page.recorded);
  put($("play"), page.playing ? "❚❚" : "▶");
  $("play").setAttribute("aria-label", page.playing ? "pause the playback" : "play");
  document.body.classList.toggle("no-run", !page.whole.run);
  document.body.classList.toggle("past", page.at !== null && !page.recorded);
  document.body.classList.toggle("over", isOver(page.whole));
}

// The second run at this moment in words; curves and path show the rest.
function drawOver(over, s) {
  $("over").hidden = !over;
  if (!over) return;
  const doing = s.nodes.filter((node) => s.byPath.get(node.path)?.leaf && s.node.get(node.path)?.status === "RUNNING").map((node) => node.name).join(", ");
  put($("over-words"), over.problem || `${over.name}: ${s.ended ? `${STATUS_WORD[s.ended.outcome] ?? ""} ${s.ended.outcome} after ${seconds(s.ended.t)}` : `${doing || s.state}, ${seconds(s.t)}`}`);
}

let lastFrame = 0;
function play() {
  const now = performance.now();
  const dt = lastFrame ? (now - lastFrame) / 1000 : 0;
  lastFrame = now;
  const length = Math.max(page.whole.t, page.over?.whole.t ?? 0);
  page.at = Math.min(length, (page.at ?? 0) + dt * Number($("speed").value));
  if (page.at >= length) { page.playing = false; page.dirty = true; if (!page.recorded) page.at = null; }
}

function togglePlay() {
  if (!page.playing && (page.at === null || page.at >= page.whole.t)) page.at = 0;
  page.playing = !page.playing;
  lastFrame = 0;
  page.dirty = true;
}

function goTo(t) { page.at = t; page.playing = false; page.dirty = true; }
function goLive() { if (!page.recorded) { page.at = null; page.playing = false; page.dirty = true; } }

// ----------------------------------------------------------------------------------------------- connection

function forget() {
  page.live = newFeed();
  if (!page.recorded) Object.assign(page, { at: null, playing: false });
}

function receive(message, size) {
  if (message.v !== 1) { say("the server speaks another version: reload the page", "bad"); return; }
  const { live } = page;
  if (message.event === "Hello") {
    if (page.stream && page.stream !== message.stream) forget(); // another process numbers its messages anew
    Object.assign(page, { stream: message.stream, silent: null });
    if (!page.recorded) say("connected");
  } else if (message.event === "Control") {
    page.control = message; page.heardControl = performance.now();
    if (message.start && !message.start.problem) leaveNewest(); else if (unasked && message.starts && !live.whole.run) openNewest();
    unasked = false;
  }
  else if (message.event === "Picture") page.pictures.set(message.device, { ...message, received: performance.now() });
  else if (message.event === "Silent") page.silent = message.seconds ? performance.now() - 1000 * message.seconds : null;
  else if (message.event === "Beat") {
    const now = performance.now();
    page.beat = { tick: message.tick, wall: message.wall ?? 0, ages: message.ages ?? {}, received: now, moved: page.beat?.tick === message.tick ? page.beat.moved : now };
    if (live.whole.run && !live.whole.ended) { live.whole.t = Math.max(live.whole.t, message.t); page.heard = now; }
  } else if (message.event !== "Lagged") {
    if (message.event === "RunStarted") { forget(); page.beat = null; page.pictures.clear(); leaveNewest(); }
    else if (message.seq <= live.whole.seq) return;
    page.live.messages.push(message);
    page.live.size += size;
    apply(page.live.whole, message);
    if (message.event !== "OperatorActed") page.heard = performance.now();
    if (page.live.size > MOST_CHARACTERS) shorten(page.live);
    if (message.event === "RunEnded" && !$("runs-view").hidden) loadRuns();
    if (message.event === "RunEnded" && !page.recorded && page.at === null && message.outcome === "failure") goTo(tellingMoment(live.whole));
  }
  page.dirty = true;
}

// The older half of the messages becomes the state from which scrubbing begins.
function shorten(feed) {
  const base = feed.base ? structuredClone(feed.base) : emptyState();
  for (const message of feed.messages.splice(0, feed.messages.length / 2)) apply(base, message);
  Object.assign(feed, { base, size: feed.size / 2, shown: newCursor(), ahead: newCursor() });
}

async function openRecord(name, t) {
  Object.assign(page, { recorded: name, record: newFeed(), at: null, playing: false, opened: false, problem: "" });
  showRuns(false);
  say(`reading ${name} …`);
  $("download").href = withToken(recordAddress(name, "record"));
  const problem = await openOverview(name);
  if (page.recorded !== name) return;
  page.at ??= Math.min(t ?? tellingMoment(page.whole), page.whole.t); // a moment that was chosen while it was read stays
  Object.assign(page, { opened: true, problem });
  if (problem) say("record not readable", "bad"); else say("recorded run");
  page.dirty = true;
}

// A page that starts runs and shows none opens the newest record; the next run takes its place, unless another one was chosen.
let unasked = false, newest = "";
async function openNewest() {
  const [first] = await read("/api/runs").then((answer) => answer.json()).catch(() => []);
  if (!first || first.state === "running" || location.hash || page.live.whole.run || !$("runs-view").hidden) return;
  location.hash = newest = `#run=${encodeURIComponent(first.run)}`;
}
const leaveNewest = () => { if (newest && location.hash === newest) location.hash = ""; newest = ""; };

function openAddress() {
  const { run, over, t } = readAddress();
  if ((over ?? null) !== (page.over?.name ?? null)) {
    page.over = null;
    if (over && run) openOver(over).then((read) => { page.over = read; page.dirty = true; });
  }
  if (run && run !== page.recorded) openRecord(run, t);
  else if (run && t !== null) goTo(Math.min(t, page.whole.t));
  else if (!run && page.recorded) { Object.assign(page, { recorded: null, record: null, at: null, playing: false, dirty: true }); say(isClosed() ? "program closed" : isStale() ? "connection lost" : "connected", isStale() ? "bad" : "ok"); }
  return run;
}

// -------------------------------------------------------------------------------------------------- tabs, keys

function showTab(name) {
  for (const tab of document.querySelectorAll("[role=tab]")) tab.setAttribute("aria-selected", tab.dataset.tab === name);
  for (const panel of document.querySelectorAll("[role=tabpanel]")) panel.hidden = panel.id !== name;
  page.dirty = true;
}

const tabs = [...document.querySelectorAll("[role=tab]")];
for (const [i, tab] of tabs.entries()) {
  tab.addEventListener("click", () => showTab(tab.dataset.tab));
  tab.addEventListener("keydown", (event) => {
    const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (step) { const next = tabs[(i + step + tabs.length) % tabs.length]; next.focus(); next.click(); event.preventDefault(); }
  });
}
$("safe-stop").addEventListener("click", () => press("safe_stop"));
$("play").addEventListener("click", togglePlay);
$("live").addEventListener("click", goLive);
$("back-to-live").addEventListener("click", () => { location.hash = ""; });
$("over-close").addEventListener("click", () => { location.hash = `run=${encodeURIComponent(page.recorded)}`; });
$("show-keys").addEventListener("click", () => $("keys").showModal());
$("running").addEventListener("click", () => tree.jumpToRunning());
$("share").addEventListener("click", () => {
  const run = page.recorded ?? page.whole.run?.run ?? "";
  const link = `${location.origin}${location.pathname}#run=${encodeURIComponent(run)}&t=${(page.at ?? page.whole.t).toFixed(2)}`;
  const told = `link to ${seconds(page.at ?? page.whole.t)} copied`;
  if (navigator.clipboard) navigator.clipboard.writeText(link).then(() => say(told), () => say(link)); else say(link);
});
// Esc closes an open list, a field, an enlarged picture, a comparison first. With nothing open, two presses or a held key stop.
function closeOpen() {
  const listed = !$("runs-view").hidden, compared = listed && !$("comparison").hidden, over = !listed && page.over;
  if (compared) $("comparison").hidden = true;
  else if (listed) showRuns(false);
  else if (over) $("over-close").click();
  else return closeLarge();
  return true;
}
function escape(event) {
  if ($("keys").open) return;
  if (link.escaped > performance.now() - TWICE) { link.escaped = -Infinity; press("safe_stop"); }
  else if (event.repeat) return;
  else if (event.target.matches("input, select, textarea")) event.target.blur();
  else if (!closeOpen()) link.escaped = performance.now();
}
document.addEventListener("keydown", (event) => {
  if (event.key === "Escape") { escape(event); return; }
  if (/^(INPUT|SELECT|TEXTAREA|BUTTON|SUMMARY)$/.test(event.target.tagName) || event.ctrlKey || event.metaKey || event.altKey) return;
  if (event.key === "/") { $("search").focus(); event.preventDefault(); }
  else if (event.key === " ") { togglePlay(); event.preventDefault(); }
  else if (event.key === "l") goLive();
  else if (event.key === "j") tree.jumpToRunning();
  else if (event.key === "f") $("follow").click();
  else if (event.key === "v") $("arm-speed").focus();
  else if (event.key === "r") $("show-runs").click();
  else if (event.key === "?") $("keys").showModal();
});
window.addEventListener("hashchange", openAddress);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { plots.forget(); scene.repaint(); timeline.key = ""; page.dirty = true; });

unasked = !openAddress();
connect(receive);
setInterval(() => { page.dirty = true; }, 500);
setInterval(() => drawTrust(page.live.whole), 100); // also without messages and frames
render();
