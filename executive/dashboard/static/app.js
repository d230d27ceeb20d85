// The page: messages in, state, views. A live run streams over the WebSocket; a recorded one is read whole. Both can be scrubbed.
import { $, h, seconds, show } from "./dom.js";
import { apply, emptyState, leavesOf, STATUS } from "./store.js";
import { TreeView } from "./tree.js";
import { CameraView, PlotsView, drawTables } from "./pictures.js";
import { SceneView } from "./scene.js";
import { Timeline } from "./timeline.js";

const page = {
  messages: [], whole: emptyState(), shownState: emptyState(), shownIndex: 0, at: null, live: true, playing: false,
  recorded: null, token: "", viewer: sessionStorage.getItem("pomona-viewer") || crypto.randomUUID(), held: "", heldBy: "",
  selected: null, runs: [], dirty: true, socket: null,
};
sessionStorage.setItem("pomona-viewer", page.viewer);

// ---------------------------------------------------------------------------------------------- the address

function readAddress() {
  const fields = new URLSearchParams(location.hash.slice(1));
  const token = fields.get("token") || sessionStorage.getItem("pomona-token") || "";
  if (fields.get("token")) {
    sessionStorage.setItem("pomona-token", token);
    fields.delete("token"); // the token stays out of links that are shared
    history.replaceState(null, "", fields.size ? `#${fields}` : location.pathname);
  }
  page.token = token;
  return { run: fields.get("run"), t: fields.has("t") ? Number(fields.get("t")) : null };
}

// ---------------------------------------------------------------------------------------------------- views

const tree = new TreeView((path) => { page.selected = path; page.dirty = true; }, (path) => {
  const on = !tree.breaks.has(path);
  act(on ? "break" : "unbreak", path).then((ok) => { if (ok) { if (on) tree.breaks.add(path); else tree.breaks.delete(path); page.dirty = true; } });
});
const camera = new CameraView();
const plots = new PlotsView();
const scene = new SceneView();
const timeline = new Timeline((t) => { page.live = false; page.playing = false; page.at = t; page.dirty = true; });

function momentState() {
  if (page.at === null) return page.whole;
  let { shownState: s, shownIndex: i } = page;
  const next = page.messages[i];
  if (s.t > page.at || !s.run || (next === undefined && i > page.messages.length)) { s = emptyState(); i = 0; }
  while (i < page.messages.length && (page.messages[i].t ?? 0) <= page.at + 1e-9) apply(s, page.messages[i++]);
  page.shownState = s; page.shownIndex = i;
  return s;
}

function render() {
  requestAnimationFrame(render);
  if (page.playing) play();
  if (!page.dirty) return;
  page.dirty = false;
  const s = momentState();
  const now = page.at ?? page.whole.t;
  header(s);
  tree.update(s);
  camera.update(s);
  scene.update(s);
  plots.update(s);
  drawTables(s);
  why(s);
  nodePanel(s);
  ports(s);
  timeline.draw(page.whole, now);
  $("live").classList.toggle("on", page.at === null);
  $("live").hidden = Boolean(page.recorded);
  $("play").textContent = page.playing ? "❚❚" : "▶";
}

function header(s) {
  const kind = s.run?.cell_kind ?? "–";
  $("kind").textContent = { simulated: "SIMULATED", emulated: "EMULATED", real: "REAL", frames: "RECORDED FRAMES", mock: "MOCK" }[kind] ?? kind;
  $("kind").dataset.kind = kind;
  $("run").textContent = s.run ? `${s.run.tree} · seed ${s.run.seed} · ${s.run.cell}` : "no run yet";
  const state = s.ended ? s.ended.outcome : s.state;
  $("state").textContent = state;
  $("state").dataset.state = state;
  $("state").title = s.because;
  $("clock").textContent = `${(page.at ?? s.t).toFixed(1)} s`;
  $("links").replaceChildren(...[...s.links].map(([device, link]) => h("span", { class: link === "ok" ? "link ok" : "link bad", title: link }, `${link === "ok" ? "●" : "▲"} ${device}${link === "ok" ? "" : `: ${link}`}`)));
  const stopped = page.whole.safeStop;
  $("latched").hidden = !stopped;
  if (stopped) $("latched").textContent = `SAFE STATE, latched: ${stopped}. The arm holds, the gripper keeps its grip. Start a new run to acknowledge. This is not the hardware emergency stop.`;
  document.title = s.run ? `${STATUS_WORD[state] ?? ""} ${s.run.tree} – Pomona` : "Pomona";
}

const STATUS_WORD = { success: "✓", failure: "✗", stopped: "■", error: "■", running: "▶", paused: "❚❚" };

function reasonTree(reason, s) {
  const name = s.byPath.get(reason.node_path)?.name ?? reason.node_path;
  const facts = Object.entries(reason.data ?? {});
  return h("li", {}, h("strong", {}, name || "run"), " ", h("code", {}, reason.code), ` ${reason.message} `,
    facts.length ? h("dl", { class: "facts" }, facts.flatMap(([k, v]) => [h("dt", {}, k), h("dd", {}, show(v))])) : null,
    reason.causes?.length ? h("ol", {}, reason.causes.map((cause) => reasonTree(cause, s))) : null);
}

let whyKey = "";
function why(s) {
  const latest = s.failures.at(-1);
  const chain = s.ended?.reason ?? latest?.reason ?? null;
  const key = `${s.run?.run}|${s.failures.length}|${latest?.next}|${s.ended?.outcome}`;
  if (key === whyKey) return;
  whyKey = key;
  if (!chain) { $("why").replaceChildren(h("p", { class: "muted" }, s.ended ? "Nothing failed." : "Nothing has failed so far.")); return; }
  const parts = [];
  if (s.ended && s.ended.outcome === "success") parts.push(h("p", {}, h("b", { class: "good" }, "✓ The task succeeded"), ` after ${s.failures.length} failure${s.failures.length === 1 ? "" : "s"} on the way. The latest:`));
  else if (s.ended) parts.push(h("p", {}, h("b", { class: "bad" }, `✗ The run ended: ${s.ended.outcome}.`)));
  parts.push(h("ol", { class: "chain" }, reasonTree(chain, s)));
  if (latest?.next) parts.push(h("p", {}, `${seconds(latest.t)} into the run. Then the tree went on with `, h("strong", {}, s.byPath.get(latest.next)?.name ?? latest.next), "."));
  if (s.failures.length > 1) {
    parts.push(h("details", {}, h("summary", {}, `All ${s.failures.length} failures`), h("ol", {}, s.failures.map((f) => h("li", {}, h("button", { class: "moment", onclick: () => goTo(f.t) }, seconds(f.t)), ` ${s.byPath.get(f.path)?.name}: `, leavesOf(f.reason).map((l) => `${l.code} ${l.message}`).join("; "))))));
  }
  $("why").replaceChildren(...parts);
}

let nodeKey = "";
function nodePanel(s) {
  const path = page.selected;
  const node = path && s.node.get(path);
  const key = `${path}|${node?.tick}|${node?.status}|${node?.feedback}|${s.run?.run}|${s.ports.size}`;
  if (key === nodeKey) return;
  nodeKey = key;
  const about = path && s.byPath.get(path);
  if (!about) { $("node").replaceChildren(h("p", { class: "muted" }, "Choose a node in the tree. b sets a breakpoint.")); return; }
  const { icon, word } = STATUS[node?.status ?? "INVALID"];
  const { line: from, end_line: to } = about;
  const source = from && s.run.tree_text ? s.run.tree_text.split("\n").slice(from - 1, Math.min(to ?? from, from + 14)).join("\n") : "";
  const wiring = [...Object.entries(about.inputs ?? {}), ...Object.entries(about.outputs ?? {})].map(([port, wired]) => {
    const name = wired.match(/^\{\s*([A-Za-z_]\w*)/)?.[1];
    const entry = name && [...s.ports].find(([key]) => key.endsWith(`/${name}`))?.[1];
    return [h("dt", {}, port), h("dd", {}, wired, entry ? h("span", { class: "muted" }, ` ${entry.sentence || show(entry.value).slice(0, 120)}, ${seconds(Math.max(0, s.t - entry.t))} ago`) : "")];
  });
  $("node").replaceChildren(
    h("p", {}, h("strong", {}, about.name), ` ${about.type === about.name ? about.kind : about.type} `, h("span", { class: "muted" }, path)),
    about.description || about.comment ? h("p", {}, about.description || about.comment) : "",
    h("p", {}, `${icon} ${word}`, node?.starts ? `, started ${node.starts}×` : "", node?.feedback ? `: ${node.feedback}` : ""),
    wiring.length ? h("dl", { class: "facts" }, wiring) : "",
    node ? h("ol", { class: "history" }, node.history.slice(-8).reverse().map((e) => h("li", {}, h("button", { class: "moment", onclick: () => goTo(e.t) }, seconds(e.t)), ` ${STATUS[e.status].icon} ${STATUS[e.status].word}`, e.reason ? ` ${e.reason.code}` : ""))) : "",
    source ? h("pre", {}, source) : "");
}

let portsKey = "";
function ports(s) {
  const key = `${s.run?.run}|${[...s.ports.values()].map((p) => p.t).join()}|${s.t.toFixed(0)}`;
  if (key === portsKey) return;
  portsKey = key;
  $("ports").replaceChildren(h("dl", { class: "facts" }, [...s.ports].flatMap(([name, p]) => [h("dt", { title: `written by ${s.byPath.get(p.writer)?.name ?? p.writer}` }, name), h("dd", {}, p.sentence || h("details", {}, h("summary", {}, p.value?.type ?? show(p.value).slice(0, 40)), h("pre", {}, show(p.value))), h("span", { class: "muted" }, ` ${seconds(Math.max(0, s.t - p.t))} ago`))])));
}

// ------------------------------------------------------------------------------------------------- playback

let lastFrame = 0;
function play() {
  const now = performance.now();
  const dt = lastFrame ? (now - lastFrame) / 1000 : 0;
  lastFrame = now;
  page.at = Math.min(page.whole.t, (page.at ?? 0) + dt * Number($("speed").value));
  if (page.at >= page.whole.t) { page.playing = false; lastFrame = 0; if (!page.recorded) page.at = null; }
  page.dirty = true;
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

function receive(message) {
  if (message.event === "Lagged") return;
  if (message.event === "RunStarted") { page.messages = []; page.shownState = emptyState(); page.shownIndex = 0; page.at = null; }
  else if (message.seq && message.seq <= page.whole.seq) return;
  page.messages.push(message);
  apply(page.whole, message);
  page.dirty = true;
  if (message.event === "RunEnded") { loadRuns(); drawControl(); }
  if (message.event === "StateChanged" || message.event === "RunStarted") drawControl();
}

let retry = 250;
function connect() {
  const socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/live?since=${page.whole.seq}`);
  page.socket = socket;
  socket.addEventListener("open", () => { retry = 250; connection("connected", "ok"); });
  socket.addEventListener("message", (event) => receive(JSON.parse(event.data)));
  socket.addEventListener("close", (event) => {
    if (page.recorded) return;
    if (event.code === 4408) page.whole = emptyState();
    connection(`connection lost; what you see is ${page.whole.run ? "old" : "nothing"}`, "bad");
    setTimeout(connect, retry);
    retry = Math.min(5000, retry * 2);
  });
}

function connection(text, rank) { $("connection").textContent = text; $("connection").dataset.rank = rank; document.body.classList.toggle("offline", rank === "bad"); }

async function openRecord(name, t) {
  page.recorded = name;
  page.socket?.close();
  connection(`reading ${name} …`, "ok");
  const answer = await fetch(`/api/runs/${encodeURIComponent(name)}/messages`);
  if (!answer.ok) { connection(`no record ${name}`, "bad"); return; }
  page.messages = []; page.whole = emptyState(); page.shownState = emptyState(); page.shownIndex = 0;
  const reader = answer.body.pipeThrough(new TextDecoderStream()).getReader();
  let rest = "";
  for (;;) {
    const { value, done } = await reader.read();
    rest += value ?? "";
    const lines = rest.split("\n");
    rest = lines.pop();
    for (const line of lines) { const m = JSON.parse(line); page.messages.push(m); apply(page.whole, m); }
    if (done) break;
  }
  page.at = t ?? page.whole.t;
  connection(`recorded run`, "ok");
  page.dirty = true;
  drawControl();
}

// ---------------------------------------------------------------------------------------------------- acting

async function act(action, detail = "") {
  if (!page.token) { connection("this page may watch but not act: open the link that was printed", "bad"); return false; }
  const who = localStorage.getItem("pomona-who") || "operator";
  try {
    const answer = await fetch("/api/act", { method: "POST", headers: { "content-type": "application/json", "x-pomona-token": page.token }, body: JSON.stringify({ action, detail, viewer: page.viewer, who }) });
    const body = await answer.json();
    if (!answer.ok) { connection(body.error, "bad"); return false; }
    page.heldBy = body.held_by; page.held = body.viewer;
    drawControl();
    return true;
  } catch { connection("the run cannot be reached", "bad"); return false; }
}

function drawControl() {
  const s = page.whole;
  const mine = page.held === page.viewer;
  const name = h("input", { class: "who", value: localStorage.getItem("pomona-who") || "", placeholder: "your name", "aria-label": "your name", maxlength: "60", onchange: (e) => localStorage.setItem("pomona-who", e.target.value) });
  const button = (label, action, enabled, title) => h("button", { onclick: () => act(action), disabled: !(mine && enabled), title, "data-action": action }, label);
  const running = s.state === "running", paused = s.state === "paused";
  $("control").replaceChildren(
    page.recorded ? h("span", {}, "recorded run ", h("a", { href: `/api/runs/${encodeURIComponent(page.recorded)}/record` }, "download"), " ", h("button", { onclick: () => { location.hash = ""; location.reload(); } }, "back to live"))
      : h("span", {}, name, " ", mine ? h("button", { onclick: () => act("release") }, "give control back") : h("button", { onclick: () => act("take"), "data-action": "take" }, "take control"),
        ` ${page.heldBy ? (mine ? "you hold control" : `${page.heldBy} holds control`) : ""} `,
        button("❚❚ pause", "pause", running, "Stop motions on their paths"), button("▶ resume", "resume", paused, "Go on in place"),
        button("❙▶ step", "step", paused, "Run one tick"), button("◼ stop", "stop", running || paused, "Halt every skill, then end"),
        h("span", { class: "ack", id: "ack" }, `state: ${s.ended ? s.ended.outcome : s.state}`)));
}

// ------------------------------------------------------------------------------------------------------ runs

async function loadRuns() {
  try { page.runs = await (await fetch("/api/runs")).json(); } catch { return; }
  drawRuns();
}

function drawRuns() {
  const wanted = $("runs-filter").value.toLowerCase();
  const rows = page.runs.filter((r) => JSON.stringify(r).toLowerCase().includes(wanted)).slice(0, 200);
  $("runs").replaceChildren(h("table", {}, h("tbody", {}, rows.map((r) =>
    h("tr", {}, h("td", {}, STATUS_WORD[r.outcome] ?? "?", " ", r.outcome ?? "cut off"), h("td", {}, h("button", { class: "moment", onclick: () => { location.hash = `run=${encodeURIComponent(r.run)}`; } }, r.run)), h("td", {}, r.code ?? ""), h("td", {}, r.time ? seconds(r.time) : ""))))));
}

// -------------------------------------------------------------------------------------------------- the rest

$("safe-stop").addEventListener("click", () => act("safe_stop"));
$("play").addEventListener("click", togglePlay);
$("live").addEventListener("click", goLive);
$("runs-filter").addEventListener("input", drawRuns);
$("share").addEventListener("click", () => {
  const run = page.recorded ?? page.whole.run?.run ?? "";
  const link = `${location.origin}/#run=${encodeURIComponent(run)}&t=${(page.at ?? page.whole.t).toFixed(2)}`;
  navigator.clipboard?.writeText(link).then(() => connection("link copied", "ok"), () => connection(link, "ok"));
});
document.addEventListener("keydown", (event) => {
  if (event.key === "Escape") { act("safe_stop"); event.preventDefault(); return; }
  if (/^(INPUT|SELECT|TEXTAREA)$/.test(event.target.tagName)) return;
  if (event.key === "/") { $("search").focus(); event.preventDefault(); }
  else if (event.key === " ") { togglePlay(); event.preventDefault(); }
  else if (event.key === "l") goLive();
  else if (event.key === "j") { const running = [...page.whole.node].find(([p, n]) => n.status === "RUNNING" && page.whole.byPath.get(p)?.leaf); if (running) tree.select(running[0]); }
});
window.addEventListener("hashchange", () => { const { run, t } = readAddress(); if (run) openRecord(run, t); });

const { run, t } = readAddress();
drawControl();
loadRuns();
if (run) openRecord(run, t); else connect();
setInterval(() => { page.dirty = true; }, 500);
render();
