// What the page knows of itself: the messages, the moment that is shown, the token, and how it acts.
import { $ } from "./dom.js";
import { emptyState } from "./store.js";

export const page = {
  messages: [], size: 0, whole: emptyState(), base: null, shownState: emptyState(), shownIndex: 0, at: null, playing: false,
  recorded: null, overview: null, stream: "", token: "", reading: "", viewer: "", grant: Number(sessionStorage.getItem("pomona-grant") ?? -1),
  control: { held_by: "", grant: 0, viewers: 0, starts: false }, beat: null, selected: null, dirty: true, socket: null,
};

page.viewer = sessionStorage.getItem("pomona-viewer") || [...crypto.getRandomValues(new Uint8Array(16))].map((b) => b.toString(16).padStart(2, "0")).join("");
sessionStorage.setItem("pomona-viewer", page.viewer);

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
  return { run: fields.get("run"), t: fields.has("t") ? Number(fields.get("t")) : null };
}

export function say(text, rank = "ok") { $("connection").textContent = text; $("connection").dataset.rank = rank; }

export function read(path) { return fetch(path, { headers: page.token ? { "x-pomona-token": page.token } : {} }); }

// For what the browser opens by itself, a download, the stream: such addresses are kept and shared, so what acts is not in them.
export function withToken(address) {
  const url = new URL(address, location.href);
  if (page.reading) url.searchParams.set("token", page.reading);
  return url;
}

export async function post(path, body) {
  if (!page.token) { say("this page may watch but not act: open the link that was printed", "bad"); return null; }
  const who = $("who").value.trim() || "operator";
  try {
    const answer = await fetch(path, { method: "POST", headers: { "content-type": "application/json", "x-pomona-token": page.token }, body: JSON.stringify({ ...body, viewer: page.viewer, who }) });
    const content = await answer.json();
    if (answer.ok) return content;
    say(content.error, "bad");
  } catch { say("the run cannot be reached", "bad"); }
  return null;
}

export async function act(action, detail = "") {
  const answer = await post("/api/act", { action, detail });
  if (answer === null) return false;
  if (answer.yours) { page.grant = answer.grant; sessionStorage.setItem("pomona-grant", page.grant); }
  page.control = { ...page.control, held_by: answer.held_by, grant: answer.grant };
  page.dirty = true;
  return true;
}
