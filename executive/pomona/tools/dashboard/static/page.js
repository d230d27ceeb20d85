// State of the page: messages, shown moment, tokens.
import { $ } from "./dom.js";
import { emptyState } from "./store.js";

// A state that follows the messages up to a moment.
export const newCursor = () => ({ state: emptyState(), index: 0, at: -Infinity });

// The messages of one run, and the states that they give: of the whole, of the shown moment, of the samples that follow it.
export const newFeed = () => ({ messages: [], size: 0, whole: emptyState(), base: null, overview: null, shown: newCursor(), ahead: newCursor() });

export const page = {
  live: newFeed(), record: null, over: null, at: null, playing: false,
  recorded: null, stream: "", token: "", reading: "", viewer: "", grant: Number(sessionStorage.getItem("pomona-grant") ?? -1),
  control: { held_by: "", grant: 0, viewers: 0, starts: false, start: null }, heardControl: 0, heard: 0, beat: null, silent: null, pictures: new Map(), selected: null, dirty: true, drawing: false, opened: false, problem: "",
  get feed() { return this.record ?? this.live; }, // the record, or the live run
};
for (const name of Object.keys(newFeed())) Object.defineProperty(page, name, { get() { return this.feed[name]; }, set(value) { this.feed[name] = value; } });

page.viewer = sessionStorage.getItem("pomona-viewer") || randomId();
sessionStorage.setItem("pomona-viewer", page.viewer);

export function randomId() { return [...crypto.getRandomValues(new Uint8Array(16))].map((b) => b.toString(16).padStart(2, "0")).join(""); }

// A record that was read and has no end of its run: cut off, or the run goes on in another process.
export const hasNoEnd = () => Boolean(page.recorded && page.opened && page.whole.run && !page.whole.ended) && !(page.live.whole.run?.run === page.whole.run.run && !page.live.whole.ended);

// Age of a value of time t of the run [s]: it grows on after the end, and while nothing is heard. At a moment that is looked at: its age then.
export function ageOf(s, t) {
  const { run, ended } = s, live = page.at === null && !page.recorded && run;
  return s.t - t + (!live ? 0 : Math.max(0, ended && run.wall_time ? Date.now() / 1000 - run.wall_time - ended.wall : (performance.now() - page.heard) / 1000));
}
// The run on the page is over, or in the safe state: nothing that is shown of it is of now.
export const isOver = (s) => Boolean(s.ended || s.safeStop) && !page.recorded && page.at === null;

export const holdsControl = () => page.control.grant === page.grant && Boolean(page.control.held_by);

// The token travels behind the '#', which no server sees; it is taken out of the address at once, so that links can be shared.
export function readAddress() {
  const fields = new URLSearchParams(location.hash.slice(1));
  page.token = fields.get("token") || sessionStorage.getItem("pomona-token") || "";
  page.reading = fields.get("read") || sessionStorage.getItem("pomona-read") || "";
  if (fields.has("token") || fields.has("read")) {
    sessionStorage.setItem("pomona-token", page.token);
    sessionStorage.setItem("pomona-read", page.reading);
    fields.delete("token");
    fields.delete("read");
    history.replaceState(null, "", fields.size ? `#${fields}` : location.pathname);
  }
  return { run: fields.get("run"), over: fields.get("over"), t: fields.has("t") && Number.isFinite(Number(fields.get("t"))) ? Math.max(0, Number(fields.get("t"))) : null };
}

// The state of the connection, or the answer to a press; the usual states are "quiet": narrow pages leave them out.
export function say(text, rank = "ok") { $("connection").textContent = text; $("connection").dataset.rank = /^(connected|recorded run)$/.test(text) ? "quiet" : rank; }

// Where the page's own server is: behind a proxy that may be below a path. "./" keeps each address on that server.
const here = (path) => new URL(`./${path.replace(/^\//, "")}`, location.href.split("#")[0]);

// A server with too many open reads answers 503 with the time to wait.
export async function read(path, answer = fetch(here(path), { headers: page.token ? { "x-pomona-token": page.token } : {} })) {
  const { status, headers } = await answer;
  if (status !== 503) return answer;
  await new Promise((done) => { setTimeout(done, 1000 * (Number(headers.get("retry-after")) || 1)); });
  return read(path);
}

// Address of a download, an image or the stream. It may be stored or shared, so it has only the token to read.
export function withToken(address) {
  const url = here(address);
  if (page.reading) url.searchParams.set("token", page.reading);
  return url;
}

export const me = () => ({ viewer: page.viewer, who: $("who").value.trim() || "operator" });

// Returns the answer, or { error, status } after the deadline [ms].
export async function post(path, body, deadline = 5000) {
  try {
    const answer = await fetch(here(path), { method: "POST", signal: AbortSignal.timeout(deadline), headers: { "content-type": "application/json", "x-pomona-token": page.token }, body: JSON.stringify({ ...body, ...me() }) });
    return { ...await answer.json(), status: answer.status };
  } catch (error) { return { error: error.name === "TimeoutError" ? `no answer within ${deadline / 1000} s` : "the server cannot be reached", status: 0 }; }
}
