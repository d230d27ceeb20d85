// A recorded run: first an overview of the whole, then all messages around the shown moment.
import { newCursor, newFeed, page, read } from "./page.js";
import { apply } from "./store.js";

const AROUND = 20; // seconds of a long record that are read on each side of a moment
const MARGIN = 6; // seconds left ahead below which more is read
const SLICE = 4; // ms for which a record is parsed before the page may draw again

export const recordAddress = (run, what) => `/api/runs/${encodeURIComponent(run)}/${what}`;

// Hand over each message of a record as it comes.
export async function readRecord(name, take, query = "?overview") {
  const answer = await asked(name, query);
  if (!answer.ok) throw new Error(`there is no record ${name}`);
  const text = await answer.text();
  let began = performance.now();
  for (let from = 0; from < text.length;) { // line by line, without a second copy of the whole
    if (performance.now() - began > SLICE) { await new Promise((done) => { setTimeout(done); }); began = performance.now(); }
    let to = text.indexOf("\n", from);
    if (to < 0) to = text.length;
    if (to > from) take(JSON.parse(text.slice(from, to)));
    from = to + 1;
  }
}

// The overview of the record in the address was requested before this script was loaded (early.js).
function asked(name, query) {
  const { early } = window;
  const address = recordAddress(name, `messages${query}`);
  if (query !== "?overview" || early?.run !== name) return read(address);
  window.early = null;
  return read(address, early.answer);
}

// Read a record's overview into the page; returns its problem, or "".
export async function openOverview(name) {
  let problem = "";
  try {
    await readRecord(name, (message) => {
      if (page.recorded !== name) return; // another one was opened meanwhile
      if (message.event === "Unreadable") problem = message.message;
      if (message.event === "Overview") page.overview = { all: [], interval: message.interval, detail: null, reading: null };
      page.overview?.all.push(message);
      page.messages.push(message);
      apply(page.whole, message);
    });
  } catch (error) { problem = error.message; }
  return problem;
}

// A second record to show over the first: { name, problem } and its own feed, from the overview.
export async function openOver(name) {
  const over = { ...newFeed(), name, problem: "" };
  try {
    await readRecord(name, (message) => {
      if (message.event === "Unreadable") over.problem = message.message;
      over.messages.push(message);
      apply(over.whole, message);
    });
  } catch (error) { over.problem = error.message; }
  return over;
}

function upTo(messages, at) {
  const index = messages.findIndex((m) => (m.t ?? 0) > at + 1e-9);
  return index < 0 ? messages.length : index;
}

// Read all messages of a long record around this moment.
export async function wantDetail(t) {
  const { overview, recorded, feed } = page;
  if (!overview || overview.reading) return;
  const { detail } = overview;
  if (detail && t >= detail[0] && (t <= detail[1] - MARGIN || detail[1] >= page.whole.t)) return;
  const begin = Math.floor(Math.max(0, t - AROUND) / overview.interval) * overview.interval, end = t + AROUND;
  overview.reading = [begin, end];
  const inside = [];
  try { await readRecord(recorded, (message) => inside.push(message), `?standing&begin=${begin}&end=${end}`); } catch { overview.reading = null; return; }
  if (page.feed !== feed) return;
  Object.assign(overview, { detail: [begin, end], reading: null });
  feed.messages = [...overview.all.filter((m) => !(m.t >= begin)), ...inside, ...overview.all.filter((m) => m.t > end)];
  const { shown } = feed; // the part that was played stays as it is
  if (detail && shown.at >= begin && shown.at >= detail[0] && shown.at <= detail[1]) shown.index = upTo(feed.messages, shown.at);
  else feed.shown = newCursor();
  feed.ahead = newCursor();
  page.dirty = true;
}
