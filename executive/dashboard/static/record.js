// A recorded run: first what a screen can show of the whole, then everything around the moment that is looked at.
import { newFeed, page, read } from "./page.js";
import { apply, emptyState } from "./store.js";

const AROUND = 20; // seconds of a long record that are read on each side of a moment
const MARGIN = 6; // of these, what must be left ahead before more is read

export const recordAddress = (run, what) => `/api/runs/${encodeURIComponent(run)}/${what}`;

// Hand over each message of a record as it comes.
export async function readRecord(name, take, query = "?overview") {
  const answer = await read(recordAddress(name, `messages${query}`));
  if (!answer.ok) throw new Error(`there is no record ${name}`);
  const text = await answer.text();
  for (let from = 0; from < text.length;) { // line by line, without a second copy of the whole
    let to = text.indexOf("\n", from);
    if (to < 0) to = text.length;
    if (to > from) take(JSON.parse(text.slice(from, to)));
    from = to + 1;
  }
}

// Read a record's overview into the page; returns what is wrong with it, or "".
export async function openOverview(name) {
  let problem = "";
  try {
    await readRecord(name, (message) => {
      if (page.recorded !== name) return; // another one was opened meanwhile
      if (message.event === "Unreadable") problem = message.message;
      if (message.event === "Overview") page.overview = { all: [], detail: null, reading: null };
      page.overview?.all.push(message);
      page.messages.push(message);
      apply(page.whole, message);
    });
  } catch (error) { problem = error.message; }
  return problem;
}

// A second record, to be seen over the first: { name, problem } and a feed of its own. What a screen shows of the whole is enough.
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

// Of a long record: everything around this moment, once it has been read.
export async function wantDetail(t) {
  const { overview, recorded } = page;
  if (!overview || overview.reading) return;
  const { detail } = overview;
  if (detail && t >= detail[0] && (t <= detail[1] - MARGIN || detail[1] >= page.whole.t)) return;
  const [begin, end] = [Math.max(0, t - AROUND), t + AROUND];
  overview.reading = [begin, end];
  const inside = [];
  try { await readRecord(recorded, (message) => inside.push(message), `?begin=${begin}&end=${end}`); } catch { overview.reading = null; return; }
  if (page.overview !== overview) return;
  Object.assign(overview, { detail: [begin, end], reading: null });
  page.messages = [...overview.all.filter((m) => !(m.t >= begin)), ...inside, ...overview.all.filter((m) => m.t > end)];
  Object.assign(page, { shownState: emptyState(), shownIndex: 0, dirty: true });
}
