// State of a run from its messages. Live and recorded runs feed the same function, so the page can show any moment.

export const STATUS = {
  SUCCESS: { icon: "✓", word: "success", rank: "good" },
  FAILURE: { icon: "✗", word: "failure", rank: "bad" },
  RUNNING: { icon: "▶", word: "running", rank: "busy" },
  INTERRUPTED: { icon: "■", word: "interrupted", rank: "cut" },
  INVALID: { icon: "·", word: "idle", rank: "idle" },
};

export const DECIDED = "CONDITION_FALSE"; // of a check: the tree goes another way
const STOPS = new Set(["stop", "safe_stop", "interrupt"]); // an interrupted node stays red until it starts again
const MOST_SAMPLES = 40000; // of a series; older ones are thinned, so that an hour of samples stays small
const MOST_KEPT = 4000; // spans, marks, lines of logs, failures, acts
const GROUP = 4; // samples of which thinning leaves two, the least and the greatest
const MOST_TRACE = 900; // points of an executed path

export function emptyState() {
  return {
    t: 0, tick: 0, seq: 0, run: null, changed: 0, nodes: [], byPath: new Map(), state: "idle", because: "", pausedBy: "", pause: 0,
    node: new Map(), attempts: new Map(), ports: new Map(), images: new Map(), scenes: new Map(),
    series: new Map(), tables: new Map(), bodies: new Map(), poses: new Map(), spans: [], marks: [], logs: [], links: new Map(), failures: [], fatal: Infinity, acts: [], ended: null,
    safeStop: null, halted: false, unrest: "", hand: null, handAt: 0, progress: null, speed: 1, gap: 1.5, breaks: { before: new Set(), after: new Set() }, changes: new Map(),
  };
}

export function apply(s, m) {
  if (m.seq) s.seq = Math.max(s.seq, m.seq);
  if (typeof m.t === "number") s.t = Math.max(s.t, m.t);
  if (typeof m.tick === "number") s.tick = m.tick;
  const handler = HANDLERS[m.event];
  if (handler) handler(s, m);
  if ((m.seq & 255) === 0) for (const list of [s.marks, s.logs, s.failures, s.acts]) if (list.length > MOST_KEPT) list.splice(0, MOST_KEPT / 4);
  if (s.spans.length > MOST_KEPT) s.spans = [...summary(s.spans.slice(0, MOST_KEPT / 2)), ...s.spans.slice(MOST_KEPT / 2)];
  return s;
}

// Half as many spans: two after each other of a skill become one, which knows how many it stands for. Ends of runs stay.
function summary(spans) {
  const kept = [], first = new Map();
  for (const span of spans) {
    const before = first.get(span.path), joins = before && span.end !== null && !span.halted;
    if (!joins) kept.push(span); else Object.assign(before, { end: span.end, status: before.status === "FAILURE" ? "FAILURE" : span.status, decided: before.decided && span.decided, of: (before.of ?? 1) + (span.of ?? 1) });
    first.set(span.path, joins || span.end === null || span.halted ? null : span);
  }
  return kept;
}

function setNodes(s, nodes) {
  s.nodes = nodes;
  const parents = new Set(nodes.map((n) => n.parent));
  for (const n of nodes) s.byPath.set(n.path, { ...n, leaf: !parents.has(n.path) });
}

const HANDLERS = {
  Overview(s, m) { s.gap = Math.max(s.gap, 3 * m.interval); },
  RunStarted(s, m) {
    Object.assign(s, emptyState(), { run: m, seq: m.seq, gap: s.gap, speed: m.speed ?? 1 });
    setNodes(s, m.nodes);
  },
  TreeChanged(s, m) {
    s.run = { ...s.run };
    s.changed = m.t;
    setNodes(s, m.nodes); // names of nodes that are gone stay known
  },
  StateChanged(s, m) {
    s.state = m.state;
    s.because = m.because;
    if (m.state !== "paused") s.pausedBy = m.state === "pausing" ? m.because : ""; // a pause that is reached says "at rest" only
    s.pause = m.pause ?? 0;
    s.marks.push({ t: m.t, kind: "state", text: m.because ? `${m.state}: ${m.because}` : m.state });
  },
  NodeChanged(s, m) {
    let node = s.node.get(m.path);
    if (!node) { node = { status: "INVALID", history: [], since: m.t, starts: undefined }; s.node.set(m.path, node); }
    const before = { status: node.status, history: node.history };
    const changed = node.status !== m.status || node.starts !== m.starts;
    const result = before.status === "RUNNING" && m.status === "INVALID" ? "INTERRUPTED" : m.status;
    const halted = s.halted && (result === "INTERRUPTED" || result === "FAILURE"); // a skill that starts in the safe state is refused
    node.status = m.status; node.feedback = m.feedback; node.starts = m.starts; node.tick = m.tick; node.reason = m.reason;
    const leaf = s.byPath.get(m.path)?.leaf;
    if (changed) {
      node.since = m.t;
      if (m.status === "RUNNING" || before.status !== "RUNNING") node.computed = 0;
      node.history = [...before.history.slice(-19), { t: m.t, status: result, reason: m.reason, halted }];
      if (m.status === "RUNNING" || (before.status !== "RUNNING" && m.status !== "INVALID")) {
        if (leaf) s.spans.push({ path: m.path, start: m.t, end: null, status: "RUNNING" });
      }
      if (m.status !== "RUNNING") {
        for (let i = s.spans.length - 1; i >= 0; i--) {
          if (s.spans[i].path === m.path && s.spans[i].end === null) {
            s.spans[i].end = m.t;
            Object.assign(s.spans[i], { status: result, halted, decided: m.reason?.code === DECIDED });
            break;
          }
        }
      }
      if (m.status === "FAILURE" && m.reason && leaf) {
        s.failures.push({ t: m.t, path: m.path, reason: m.reason, next: null });
        s.marks.push({ t: m.t, kind: m.reason.code === DECIDED ? "state" : "failure", text: `${m.reason.code}: ${m.reason.message}` });
      } else if (m.status === "RUNNING" && leaf) {
        const last = s.failures[s.failures.length - 1];
        if (last && !last.next && m.path !== last.path) last.next = m.path;
      } else if (halted && leaf) {
        s.marks.push({ t: m.t, kind: "bad", text: `${s.byPath.get(m.path).name} interrupted${m.feedback ? `: ${m.feedback}` : ""}` });
      }
    }
  },
  AttemptEnded(s, m) {
    const list = s.attempts.get(m.path) ?? [];
    s.attempts.set(m.path, [...(m.number === 1 ? [] : list), m]);
    s.marks.push({ t: m.t, kind: m.succeeded ? "good" : "failure", text: `attempt ${m.number} of ${m.of}` });
  },
  Computed(s, m) {
    const node = s.node.get(m.node);
    if (node) node.computed = (node.computed ?? 0) + m.wall;
  },
  Logged(s, m) { s.logs.push({ t: m.t, path: m.node, text: m.text, level: m.level, bad: ["WARNING", "ERROR", "CRITICAL"].includes(m.level) }); },
  PortWritten(s, m) {
    s.ports.set(m.key, { value: m.value, writer: m.writer, t: m.t, sentence: m.sentence });
  },
  Published(s, m) {
    const type = m.value?.type;
    if (type === "ImageView") s.images.set(m.topic, { ...m.value, t: m.t, node: m.node });
    else if (type === "SceneView") s.scenes.set(m.topic, { ...m.value, t: m.t, node: m.node });
    else if (type === "ProgressView") s.progress = m.value;
    else if (type === "TableView") s.tables.set(m.topic, { ...m.value, t: m.t });
    else if (type === "BodiesView") s.bodies.set(m.topic, m.value.bodies);
    else if (type === "PosesView") {
      const trace = s.poses.get(m.topic)?.trace ?? [];
      trace.push(m.value.trace);
      if (trace.length > MOST_TRACE) trace.splice(0, MOST_TRACE / 4);
      s.poses.set(m.topic, { poses: m.value.poses, trace, t: m.t });
    }
    else if (type === "SeriesView") {
      const times = m.value.t;
      if (!Array.isArray(times) || !times.length) return;
      const have = s.series.get(m.topic) ?? { t: [], values: {}, thresholds: {}, last: 0, shift: null, thinned: [] };
      const shift = m.t - times.at(-1); // samples carry the cell's clock, everything else the run's
      if (have.shift === null || Math.abs(shift - have.shift) > 0.1) have.shift = shift;
      const floor = have.t.length ? have.t.at(-1) : -Infinity;
      if (times[0] + have.shift - floor > s.gap && have.t.length) { // a gap without samples: no line joins the two
        have.t.push(floor);
        for (const values of Object.values(have.values)) values.push(null);
      }
      const n = have.t.length;
      for (const t of times) have.t.push(Math.max(floor, t + have.shift));
      for (const [name, values] of Object.entries(m.value.values)) {
        have.values[name] ??= new Array(n).fill(null);
        const own = have.values[name];
        for (const value of values) own.push(value);
      }
      for (const values of Object.values(have.values)) while (values.length < have.t.length) values.push(null);
      if (m.value.thinned) note(have, have.t.at(-times.length), have.t.at(-1));
      if (have.t.length > MOST_SAMPLES) thin(have);
      have.thresholds = m.value.thresholds ?? {};
      have.last = m.t;
      have.writes = (have.writes ?? 0) + 1;
      s.series.set(m.topic, have);
    }
  },
  LinkChanged(s, m) {
    s.links.set(m.device, { state: m.state, t: m.t });
    if (m.state !== "ok") s.marks.push({ t: m.t, kind: "bad", text: `${m.device}: ${m.state}` });
  },
  HandChanged(s, m) { Object.assign(s, { hand: m.what, handAt: m.t }); },
  OperatorActed(s, m) {
    s.acts.push(m);
    if (STOPS.has(m.action)) halt(s, m.tick);
    const [, un, after] = m.action.match(/^(un)?break(_after)?$/) ?? [null];
    const side = s.breaks[after ? "after" : "before"];
    if (un) side.delete(m.detail);
    else if (m.action.startsWith("break")) side.add(m.detail);
    else if (m.action === "acknowledge") s.safeStop = null;
    else if (m.action === "speed") s.speed = parseFloat(m.detail) / 100;
    else if (m.action === "change") {
      const [, port, text, path] = m.detail.match(/^(.*?) = (.*) ← (.*)$/s) ?? [];
      if (path) s.changes.set(path, new Map(s.changes.get(path)).set(port, { text, who: m.who, t: m.t }));
    }
    s.marks.push({ t: m.t, kind: "act", text: `${m.who}: ${m.action.replaceAll("_", " ")} ${s.byPath.get(m.detail)?.name ?? m.detail}`.trim() });
  },
  SafeStopped(s, m) {
    s.safeStop = m.reason;
    halt(s, m.tick);
    s.marks.push({ t: m.t, kind: "bad", text: `safe stop: ${m.reason}` });
  },
  ErrorRaised(s, m) {
    if (m.during === "letting go" || m.during === "the safe stop") s.unrest = m.message;
    s.marks.push({ t: m.t, kind: "bad", text: `${m.error}: ${m.message}${m.place ? ` (${m.place})` : ""}` });
  },
  RunEnded(s, m) {
    Object.assign(s, { ended: m, fatal: m.outcome === "failure" || m.outcome === "error" ? s.failures.at(-1)?.t ?? 0 : s.fatal });
    for (const span of s.spans) if (span.end === null) span.end = m.t;
  },
};

// A failure in the tick of the stop is due to it: the devices had refused already.
function halt(s, tick) {
  Object.assign(s, { halted: true, fatal: Math.min(s.fatal, s.t) });
  for (const node of s.node.values()) if (node.status === "FAILURE" && node.tick === tick && node.history.length) node.history.at(-1).halted = true;
}

// The older half of a series with half as many samples: of every few the least and the greatest, so that no peak is lost.
function thin(have) {
  const half = Math.floor(have.t.length / 2 / GROUP) * GROUP;
  note(have, have.t[0], have.t[half - 1]);
  const times = [];
  for (let i = 0; i < half; i += GROUP) times.push(have.t[i], have.t[i + GROUP - 1]);
  have.t = [...times, ...have.t.slice(half)];
  for (const [name, values] of Object.entries(have.values)) {
    const kept = [];
    for (let i = 0; i < half; i += GROUP) kept.push(...extremes(values, i, i + GROUP));
    have.values[name] = [...kept, ...values.slice(half)];
  }
}

// Least and greatest of a stretch in their order; null without samples.
export function extremes(values, from, to) {
  let low = null, high = null, first = null;
  for (let i = from; i < to; i++) {
    const v = values[i];
    if (v === null || v === undefined) continue;
    if (low === null || v < low) { low = v; first = "low"; }
    if (high === null || v > high) { high = v; if (low !== v) first = "high"; }
  }
  return first === "high" ? [low, high] : [high, low];
}

// Where a series is thinned: stretches of time, joined where they touch.
function note(have, from, to) {
  const last = have.thinned.at(-1);
  if (last && from <= last[1] + 5) { last[0] = Math.min(last[0], from); last[1] = Math.max(last[1], to); } else have.thinned.push([from, to]);
}

export function leavesOf(reason) {
  return reason.causes?.length ? reason.causes.flatMap(leavesOf) : [reason];
}

// A setting or an input as it is written, with the values of the tree's parameters in it.
export const resolved = (text, s) => String(text).replace(/\{\s*([A-Za-z_]\w*)\s*\}/g, (whole, name) => s.run?.parameter_texts?.[name] ?? s.run?.parameters?.[name] ?? whole);

// The last result of a node that is idle again, or null.
export function lastResult(node) {
  return node?.status === "INVALID" ? node.history.findLast((e) => e.status !== "RUNNING" && e.status !== "INVALID") ?? null : null;
}

// A failure before the one with which the run ended was part of the plan: the tree went on.
export const expected = (s, t) => t < s.fatal - 1e-9;

// Display of a node: its state, or while idle its last result, dimmed. An interruption by a stop is not dimmed.
export function standing(node, s) {
  const last = lastResult(node), shown = STATUS[last?.status ?? node?.status ?? "INVALID"];
  const past = Boolean(last) && !last.halted;
  return { ...shown, rank: past ? "past" : node?.status === "FAILURE" && expected(s, node.since) ? "warn" : shown.rank, words: past ? `idle, last result ${shown.word}` : shown.word };
}
