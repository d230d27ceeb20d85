// A dry run, scenarios or a simulated run: what its process reported, on the drawing.
import { page } from "./model.js";

const RANK = { failure: 5, running: 4, success: 3, reached: 2, invalid: 1, unreached: 0 };

// `messages` of the present trial, in order; returns the trial as the page shows it.
export function follow(trial, number, messages, text) {
  let now = trial?.number === number ? trial : { number, kind: "", text, states: new Map(), last: new Map(), ids: new Map(), cases: [], words: "", page: "", over: false, problem: "", outcome: "" };
  for (const message of messages) {
    if (message.started) now.kind = message.started;
    if (message.nodes) for (const one of message.nodes) now.ids.set(one.path, idOf(one));
    if (message.path) note(now, message);
    if (message.page) now.page = message.page;
    if (message.outcome) Object.assign(now, { outcome: message.outcome, words: message.words, time: message.time });
    if (message.case) now.cases.push(message);
    if (message.record) now.record = message.record;
    if (message.problem) now.problem = message.problem;
    if (message.outcome || message.ended || message.over) now.done = true;
    if (message.over) now.over = true;
  }
  return now;
}

function note(now, { path, status, words }) {
  const id = now.ids.get(path);
  if (!id) return;
  now.last.set(path, { status: status.toLowerCase(), words });
  let shown = null; // of a node in a subtree that is called more than once, the one that matters most
  for (const [other, one] of now.last) if (now.ids.get(other) === id && (!shown || RANK[one.status] > RANK[shown.status])) shown = one;
  now.states.set(id, shown);
}

// The node of the drawing that stands at the line of a node of the run.
function idOf({ path, kind, type, line, file }) {
  if (path.endsWith(`:${kind}`) || (file && page.path && !file.endsWith(page.name))) return "";
  return page.state.nodes.find((one) => one.line === line && (one.type === type || one.type === kind))?.id ?? "";
}

export function sentence(trial) {
  if (trial.problem) return [`${NAMES[trial.kind]}: not carried out`, trial.problem, "bad"];
  if (trial.kind === "scenarios") {
    const failed = trial.cases.filter(({ passed }) => !passed).length;
    if (!trial.done) return ["Scenarios", "running …", "busy"];
    return [failed ? `${failed} of ${trial.cases.length} cases failed` : `All ${trial.cases.length} cases passed`, "", failed ? "bad" : "good"];
  }
  if (!trial.outcome) return [NAMES[trial.kind], trial.last.size ? "going on" : "preparing …", "busy"];
  return [`${NAMES[trial.kind]}: ${trial.outcome}`, [`${(trial.time ?? 0).toFixed(1)} s`, trial.words].filter(Boolean).join(". "), trial.outcome === "success" ? "good" : "bad"];
}

export const NAMES = { dry: "Dry run", run: "Simulated run", scenarios: "Scenarios" };
