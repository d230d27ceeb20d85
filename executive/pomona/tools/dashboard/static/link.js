// The live link: messages, their age, permission to act, and presses until they are answered.
import { me, page, post, randomId, say, withToken } from "./page.js";

const PING = 300; // ms between two pings
const STALE = 1300; // ms without an answer after which the shown state counts as old
const DEAD = 4000; // ms without an answer after which the page connects anew
const OPENING = 2000; // ms that a connection may take to open
const CONFIRM = 500; // ms after which a press is shown as not confirmed
export const TWICE = 1500; // ms within which Esc must be pressed again, or held, to stop
const RETRY = 400; // ms between two tries
const CLOSED = 1012; // close code of a server that ends in good order
const PATIENCE = { safe_stop: 10000 }; // ms for which a press is tried; the server refuses a later one
const FACED = new Set(["pause", "resume", "step", "stop", "acknowledge", "break", "unbreak", "break_after", "unbreak_after", "answer", "change", "reload", "speed"]); // the run itself confirms them

// `known`: time (performance.now) up to which all messages have arrived; `clock`: offset of the server's time [s]; `closed`: date at which the program closed.
export const link = { socket: null, known: -Infinity, knownAt: null, armed: null, clock: null, press: null, opened: 0, closed: null, escaped: -Infinity };

// Time that has passed, also while the machine slept: its wall clock went on then.
const elapsed = () => Math.max(performance.now() - link.known, link.knownAt === null ? Infinity : Date.now() - link.knownAt);
// `page.silent`: time of the last message of the run's process. It may be silent while it prepares a run: nothing moves then.
export const runIsSilent = () => page.silent !== null && Boolean(page.live.whole.run) && !page.live.whole.ended && !page.control.start;
export const age = () => (runIsSilent() ? performance.now() - page.silent : elapsed()) / 1000;
// The program was closed after its run had ended, with the cell at rest: the last state is final.
export const isClosed = () => { const { ended, safeStop, unrest } = page.live.whole; return Boolean(link.closed && ended) && !safeStop && !unrest && !page.control.start; };
export const isStale = () => !isClosed() && (elapsed() > STALE || runIsSilent());
export const canAct = () => link.armed === true && !isStale();

let receive = () => {};
let pings = new Map();
let number = 0, refused = 0;
let retry = 250;

export function connect(handler) {
  if (handler) receive = handler;
  const url = withToken(`/live?since=${page.live.whole.seq}&stream=${page.stream}`);
  url.protocol = location.protocol === "https:" ? "wss:" : "ws:";
  const socket = new WebSocket(url);
  Object.assign(link, { socket, armed: null, opened: performance.now() });
  pings = new Map();
  const tooLong = setTimeout(() => { if (socket.readyState === WebSocket.CONNECTING) leave(socket); }, OPENING);
  socket.addEventListener("open", () => { clearTimeout(tooLong); retry = 250; link.opened = performance.now(); socket.send(JSON.stringify({ token: page.token, viewer: page.viewer })); ping(); });
  socket.addEventListener("message", (event) => { if (socket === link.socket) for (const line of event.data.split("\n")) take(JSON.parse(line), line.length); });
  socket.addEventListener("close", (event) => { clearTimeout(tooLong); if (socket === link.socket) lost(event.code); });
}

function lost(code) {
  if (code === 4408) page.stream = "";
  Object.assign(link, { socket: null, armed: null, closed: code === CLOSED ? new Date() : link.closed });
  const blocked = link.knownAt === null && (code === 1006 || !code) && (refused += 1) > 2; // the page came through, the stream does not
  if (isClosed()) say("program closed");
  else say(blocked ? "no live stream: does a proxy in between pass WebSockets?" : code === 4429 ? "too many viewers already" : `connection lost; ${page.live.whole.run ? "the data shown is old" : "no data"}`, "bad");
  page.dirty = true;
  setTimeout(connect, retry);
  retry = Math.min(1500, retry * 2);
}

function leave(socket) { // a silent server does not answer the closing handshake, either
  socket.close();
  if (socket === link.socket) lost(0);
}

function take(message, size) {
  if (message.event === "Pong") {
    const asked = pings.get(message.ping);
    if (!asked) return;
    for (const key of pings.keys()) if (key <= message.ping) pings.delete(key);
    if (isStale()) page.dirty = true;
    if (message.grant) hold(message.grant);
    Object.assign(link, { closed: null, known: asked.at, knownAt: asked.wall, clock: message.now - performance.now() / 1000 });
    if (document.getElementById("connection").textContent.match(/^(conn|program)|^no (answer|live)/)) say(page.recorded ? "recorded run" : "connected");
  } else if (message.event === "Armed") { link.armed = message.armed; page.dirty = true; }
  else if (message.event === "Pressed") answered(message.press, message);
  else {
    receive(message, size);
    if (message.event === "OperatorActed") confirmedByRun(message);
  }
}

// An answer to a ping means that all messages sent before the ping have arrived.
function ping() {
  if (link.socket?.readyState !== WebSocket.OPEN) return;
  if (pings.size && elapsed() > DEAD && performance.now() - link.opened > DEAD) { leave(link.socket); return; }
  if (pings.size > 20) return;
  pings.set(++number, { at: performance.now(), wall: Date.now() });
  link.socket.send(JSON.stringify({ ping: number }));
}
setInterval(ping, PING);
document.addEventListener("visibilitychange", ping);

// -------------------------------------------------------------------------------------------------- presses

// Press a button: { id, action, detail, at, state, words }. States: sent, accepted, confirmed, refused, lost.
// `number`: of the question or pause that was on the screen, which the press answers or ends.
export function press(action, detail = "", number = 0) {
  const made = { id: randomId(), action, detail, number, at: performance.now(), tries: 0, state: "sent", words: "", took: 0, ended: 0 };
  if (link.press?.state === "sent" && link.press.action === "safe_stop" && action !== "safe_stop") return link.press; // a pending stop has priority
  link.press = made;
  page.dirty = true;
  if (link.armed === false || !page.token) { settle(made, "refused", "this page may watch but not act: open the link that was printed"); return made; }
  send(made);
  return made;
}

function send(made) {
  if (made !== link.press || made.state !== "sent") return;
  const { action, detail, number } = made;
  if (performance.now() - made.at > (PATIENCE[action] ?? 2000)) { settle(made, "lost", ""); return; }
  made.tries += 1;
  const body = { press: made.id, action, detail, number, pressed: link.clock === null ? null : made.at / 1000 + link.clock, ...me() };
  const open = link.socket?.readyState === WebSocket.OPEN && link.armed;
  if (open) link.socket.send(JSON.stringify(body));
  if (!open || action === "safe_stop") post("/api/act", body, 1500).then((answer) => { if (answer.status) answered(made.id, answer); else made.back = answer.error; });
  setTimeout(() => send(made), RETRY);
}

// The page holds control, although the answer to its press may have been late or lost.
function hold(grant) {
  if (page.grant === grant) return;
  page.grant = grant;
  sessionStorage.setItem("pomona-grant", grant);
  page.dirty = true;
}

function answered(id, answer) {
  if (answer.yours) hold(answer.grant);
  const made = link.press;
  if (made?.id === id && made.state === "confirmed" && answer.confirmed) { made.words = answer.confirmed; page.dirty = true; } // the run was quicker
  if (made?.id !== id || (made.state !== "sent" && made.state !== "lost")) return;
  if (answer.error) { settle(made, "refused", answer.error); return; }
  if (answer.grant >= page.control.grant) page.control = { ...page.control, held_by: answer.held_by, grant: answer.grant };
  made.words = answer.confirmed;
  if (FACED.has(made.action)) made.state = "accepted"; else settle(made, "confirmed", answer.confirmed);
  page.dirty = true;
}

function confirmedByRun({ action, who, detail }) {
  const made = link.press;
  if (made && action === "too_late" && who === me().who && detail.startsWith(made.action) && made.state !== "refused") {
    settle(made, "refused", `${detail}: not carried out`);
    return;
  }
  if (!made || made.action !== action || who !== me().who || (made.detail && made.detail !== detail)) return;
  if (made.state === "accepted" || made.state === "sent" || made.state === "lost") settle(made, "confirmed", made.words);
}

function settle(made, state, words) {
  const now = performance.now();
  Object.assign(made, { state, words, took: now - made.at, ended: now });
  if (state === "refused") say(words, "bad");
  page.dirty = true;
}

export const isUnconfirmed = (made) => (made.state === "sent" || made.state === "accepted") && performance.now() - made.at > CONFIRM;
