// Texts about the run: reason of a failure, details of a node, values, events.
import { $, h, percent, put, quantity, seconds, show } from "./dom.js";
import { wordsOf } from "./control.js";
import { isClosed, link, press } from "./link.js";
import { ageOf, hasNoEnd, holdsControl, page, read } from "./page.js";
import { runNamed } from "./runs.js";
import { commandOf, drawSteps, heldWords, lookFirst } from "./steps.js";
import { DECIDED, expected, lastResult, leavesOf, resolved, standing, STATUS } from "./store.js";

let goTo = () => {};
export function onMoment(handler) { goTo = handler; }

const moment = (t) => h("button", { class: "moment", title: "Show this moment", onclick: () => goTo(t) }, seconds(t));
const ago = (s, t) => `${seconds(Math.max(0, ageOf(s, t)))} ago`;

const figures = (facts) => (facts.length ? h("dl", { class: "data" }, facts.map(([name, value]) => quantity(name, value)).map(([name, text]) => h("div", {}, h("dt", {}, name), h("dd", {}, text)))) : null);

// A parent that adds nothing to its only cause becomes a crumb before it.
function reasonTree(reason, s, crumbs = []) {
  const name = s.byPath.get(reason.node_path)?.name ?? reason.node_path;
  const causes = reason.causes ?? [];
  if (causes.length === 1 && causes[0].code === reason.code && reason.message.includes(causes[0].message)) return reasonTree(causes[0], s, [...crumbs, name]);
  return h("li", { class: "said" },
    crumbs.length ? h("span", { class: "crumbs" }, crumbs.filter(Boolean).map((crumb) => `${crumb} › `)) : null,
    h("strong", {}, name || "run"), " ", h("code", {}, reason.code), ` ${reason.message} `,
    figures(Object.entries(reason.data ?? {})),
    causes.length ? h("ol", {}, reasonTree(causes.at(-1), s)) : null,
    causes.length > 1 ? h("details", {}, h("summary", {}, causes.length === 2 ? "The cause before it" : `The ${causes.length - 1} causes before it`), h("ol", {}, causes.slice(0, -1).map((cause) => reasonTree(cause, s)))) : null);
}

const MOST_FACTS = 8; // figures beside the reason; the others are among the causes
const ENDED = { success: ["good", "✓ Succeeded"], failure: ["bad", "✗ Failed"], partial: ["warn", "◐ Done in part"], stopped: ["bad", "■ Stopped"], error: ["bad", "■ Ended by an error"] };

// One sentence with the last failure and its reason; earlier causes unfold.
function verdict(leaf, s) {
  const words = leaf.message.replace(/[.\s]*$/, "");
  return [leaf.node_path ? [h("strong", {}, s.byPath.get(leaf.node_path)?.name ?? leaf.node_path), " "] : null, h("code", {}, leaf.code), ` ${words}.`,
    s.fatal < Infinity && figures(Object.entries(leaf.data ?? {}).slice(0, MOST_FACTS))];
}

// The remedy of a failure code, or null; the server has the list.
let remedies = null;
// Where this tree or cell has a word of a remedy.
function placed(word, s, path) {
  const at = [s.byPath.get(path), ...s.nodes].find((node) => word in { ...node?.inputs, ...node?.settings });
  if (!/^[a-z_]+$/.test(word)) return "";
  if (at) return ` (${resolved(at.inputs?.[word] ?? at.settings[word], s)} at ${at.name}, line ${at.line})`;
  return word in (s.run.parameters ?? {}) ? " (a parameter of the tree)" : s.links.has(word) ? " (a device of this cell)" : " (not set in this tree)";
}
function remedyOf(code, s, path) {
  if (!code) return null;
  if (!remedies) {
    remedies = {};
    const tried = (found) => { remedies = found; whyKey = ""; page.dirty = true; };
    read("/api/remedies").then((answer) => answer.json()).then(tried, () => setTimeout(tried, 3000, null));
  }
  const words = remedies[code];
  return words ? h("p", { class: "remedy" }, h("b", {}, "Remedy: "), words.split("`").map((part, i) => (i % 2 ? [h("kbd", {}, part.startsWith("pomona run …") ? commandOf(s, true) : part.replace("--cell …", `--cell ${s.run.cell_path}`)), h("span", { class: "muted" }, placed(part, s, path))] : part)), ".") : null;
}

// Failures of a run that goes on or succeeded. A condition that did not hold is a decision of the tree.
const onTheWay = (s) => s.failures.filter(({ reason }) => reason.code !== DECIDED);

// The run's state, its reason, the next step: always those of the whole run, whatever moment is looked at.
let whyKey = "";
export function drawWhy(s) {
  drawSteps(s);
  const latest = s.ended && s.ended.outcome !== "success" ? s.failures.at(-1) : onTheWay(s).at(-1);
  const doing = s.ended ? "" : s.nodes.filter((node) => s.byPath.get(node.path).leaf && s.node.get(node.path)?.status === "RUNNING").map((node) => `${node.name} ${percent(s.node.get(node.path).feedback)}`.trim()).join(", ");
  const { progress } = s;
  const key = `${progress?.number}|${progress?.of}|${s.run?.run}|${s.failures.length}|${latest?.t}|${latest?.next}|${s.ended?.outcome}|${s.state}|${s.because}|${s.acts.length}|${s.hand}|${doing}|${page.recorded}|${page.opened}|${page.problem}|${isClosed()}|${page.control.starts}`;
  for (const element of $("why").querySelectorAll(".hand-age")) put(element, ` ${ago(s, s.handAt)}`);
  if (key === whyKey) return;
  whyKey = key;
  document.body.classList.toggle("failed", Boolean(s.ended && s.ended.outcome !== "success"));
  $("why-bar").dataset.rank = s.ended ? ENDED[s.ended.outcome]?.[0] ?? "bad" : page.problem || hasNoEnd() || (page.opened && page.recorded && !s.run) ? "bad" : s.state === "running" ? "busy" : s.state === "idle" ? "" : "warn";
  $("why").replaceChildren(...[...(s.ended ? endedWords(s, latest) : goingWords(s, doing, latest)), closedWords()].flat().filter(Boolean));
}

const progressOf = ({ progress }) => (progress ? `${progress.what} ${progress.number} of ${progress.of}` : "");

const listedWords = (r) => (r?.code ? [h("div", { class: "verdict" }, h("b", {}, r.outcome), ": ", h("code", {}, r.code), ` ${r.message}.`), h("p", { class: "muted" }, "From the list of runs; the record itself is being read.")] : []);

function goingWords(s, doing, latest) {
  if (!page.recorded && !s.run) {
    const how = page.control.starts ? "The button opens the form that starts one, and the list of recorded runs." : "It appears when the program begins it. The button opens the list of recorded runs.";
    return [h("p", {}, "No run yet."), h("p", { class: "muted" }, `A run is shown here live: its tree, the camera, the robot in space, and curves of forces and width. ${how}`)];
  }
  if (!s.run) return !page.opened ? listedWords(runNamed(page.recorded)) : [h("div", { class: "verdict" }, h("b", { class: "bad" }, "✗ This record cannot be shown"), `: ${page.problem || "it holds no run; it was cut off, or has just begun"}.`)];
  if (hasNoEnd()) return [h("div", { class: "verdict" }, h("b", { class: "bad" }, "■ No end"), `: the record ends at ${seconds(s.t)}${doing ? ` in ${doing}` : ""}. The run was cut off, or still goes on.`)];
  const runs = s.state === "running", state = runs ? "▶ " : s.state === "paused" ? "❚❚ Paused, at rest" : `❚❚ ${s.state}`;
  const reason = s.because === "at rest" ? s.pausedBy : s.because, because = reason && s.acts.some((act) => act.action === "pause" && act.who === reason) ? `by ${reason}` : reason;
  const about = [runs || !because ? "" : wordsOf(s, because), progressOf(s), runs ? doing || "between two nodes" : ""].filter(Boolean).join(" · ");
  return [h("div", { class: "verdict" }, h("b", {}, state), runs ? h("b", { class: "doing" }, about) : about ? `: ${about}` : ""),
    latest ? h("p", { class: "muted" }, "Failed on the way: ", moment(latest.t), " ", leavesOf(latest.reason).map((leaf) => `${s.byPath.get(leaf.node_path)?.name ?? ""} ${leaf.code}`).at(-1), latest.next ? [", then ", s.byPath.get(latest.next)?.name ?? latest.next] : "") : null];
}

const closedWords = () => (!page.recorded && isClosed() ? h("p", { class: "muted", role: "status" }, `The run has ended. Its program was closed at ${link.closed.toLocaleTimeString()}; this is the last state.`) : null);

function endedWords(s, latest) {
  const [rank, word] = ENDED[s.ended.outcome] ?? ["bad", s.ended.outcome], state = s.ended.reason?.code === "UNVERIFIED" ? "◐ Not verified" : word;
  const chain = s.ended.reason ?? latest?.reason ?? null, failed = s.ended.outcome !== "success";
  const name = (path) => s.byPath.get(path)?.name ?? path;
  const hand = failed ? h("p", {}, h("b", {}, "In the hand: "), heldWords(s), s.hand === null ? null : h("span", { class: "muted hand-age" }), ". ", h("b", {}, "Look first "), lookFirst(s), ". ", h("b", {}, "Go on: "), h("kbd", {}, commandOf(s))) : null;
  const done = s.tables.get("tally")?.caption ?? "", failures = failed ? s.failures : onTheWay(s), count = failures.length;
  const achieved = done ? `: ${done}` : "";
  if (!chain) return [h("div", { class: "verdict" }, h("b", { class: rank }, state), achieved, failed ? "." : ` after ${seconds(s.ended.t)}; nothing failed on the way.`), hand];
  const leaves = leavesOf(chain), leaf = leaves.at(-1);
  const lead = [h("b", { class: rank }, state), failed && s.ended.outcome === "failure" && latest ? [" at ", moment(latest.t), ": "] : failed ? ": " : `${achieved} after ${seconds(s.ended.t)}.`];
  const same = leaves.length === 1 && !chain.causes?.length;
  return [
    h("div", { class: "verdict" }, lead, failed ? verdict(leaf, s) : ""),
    failed && done ? h("p", {}, done) : null,
    failed ? null : h("p", { class: "muted" }, `${count} failure${count === 1 ? "" : "s"} on the way. The latest, at `, moment(latest?.t ?? 0), ": ", verdict(leaf, s), latest?.next ? [" Then the tree went on with ", h("strong", {}, name(latest.next)), "."] : ""),
    remedyOf({ failure: leaf.code, partial: leaf.code, error: "EXCEPTION" }[s.ended.outcome], s, leaf.node_path),
    hand,
    same && leaf.message.length < 400 && Object.keys(leaf.data ?? {}).length <= MOST_FACTS ? null : h("details", {}, h("summary", {}, leaves.length === 1 ? "How it came to this" : `How it came to this: ${leaves.length} causes`), h("ol", { class: "chain" }, reasonTree(chain, s))),
    count > 1 ? h("details", {}, h("summary", {}, `All ${count} failures`), h("ol", { class: "history" }, failures.slice(-100).map((f) => h("li", {}, moment(f.t), h("span", {}, h("b", {}, name(f.path)), " ", leavesOf(f.reason).map((l) => `${l.code} ${l.message}`).join("; ")))))) : null,
  ];
}

// A port's current value, and below it its wiring.
function wiring(s, port, wired) {
  const text = String(wired), plain = resolved(text, s);
  const name = text.match(/^\{\s*([A-Za-z_]\w*)/)?.[1];
  const entry = name && [...s.ports].findLast(([key]) => key.endsWith(`/${name}`))?.[1];
  const value = entry ? entry.sentence || brief(entry.value) : plain;
  const from = [value === text ? "" : text, entry ? ago(s, entry.t) : ""].filter(Boolean).join(" · ");
  return [h("dt", {}, port), h("dd", {}, value, from ? h("span", { class: "muted" }, from) : null)];
}

const brief = (value) => (typeof value === "object" && value?.type ? value.type : plain(show(value)).replaceAll("\n", ", ").slice(0, 100));
const plain = (text) => text.replace(/^<.*\.(\w+) object.*$/s, "$1"); // default text of a Python object

// Inputs that an operator has changed during the run, and a field to change one before the next start.
function changed(s, about, chosen) {
  const said = [...(s.changes.get(about.path) ?? [])].map(([port, { text, who, t }]) => h("p", { class: "changed" }, h("b", {}, `${port} = ${text}`), " from its next start on, by ", who, " at ", moment(t)));
  if (page.recorded || !chosen || about.kind !== "skill" || s.ended) return said;
  const mine = holdsControl();
  const field = h("input", { "aria-label": "input = value", placeholder: "input = value", maxlength: 200, list: "inputs-known", disabled: !mine });
  const known = h("datalist", { id: "inputs-known" }, Object.keys(about.inputs ?? {}).map((port) => h("option", { value: `${port} = ` })));
  const change = (event) => { event.preventDefault(); if (field.value.includes("=")) press("change", `${field.value.trim().replace(/\s*=\s*/, " = ")} ← ${about.path}`); };
  return [...said, h("form", { class: "change", onsubmit: change }, field, known, h("button", { disabled: !mine, title: mine ? "It counts from the node's next start on, and is recorded." : "Take control to change an input." }, "Change"))];
}

let nodeKey = "";
export function drawNode(s, onBreak) {
  const chosen = Boolean(page.selected), path = page.selected ?? s.spans.at(-1)?.path; // until one is chosen, the skill that started last
  const node = path && s.node.get(path);
  const [before, after] = [s.breaks.before.has(path), s.breaks.after.has(path)];
  const key = `${path}|${chosen}|${node?.tick}|${node?.status}|${node?.feedback}|${s.run?.run}|${s.ports.size}|${s.logs.length}|${s.logs.at(-1)?.t}|${before}|${after}|${(s.t + ageOf(s, s.t)).toFixed(0)}|${page.recorded}|${s.acts.length}|${Boolean(s.ended)}|${holdsControl()}`;
  if (key === nodeKey || $("node").contains(document.activeElement) && document.activeElement.matches("input")) return; // not while the operator types in it
  nodeKey = key;
  const about = path && s.byPath.get(path);
  if (!about) { $("node").replaceChildren(h("p", { class: "empty" }, "Choose a node in the tree.")); return; }
  const { icon, words, rank } = standing(node, s), last = lastResult(node), results = node?.history.filter((e) => e.status !== "INVALID") ?? [];
  const lines = s.logs.filter((e) => e.path === path);
  const { line: from, end_line: to } = about;
  const source = from && s.run.tree_text ? s.run.tree_text.split("\n").slice(from - 1, Math.min(to ?? from, from + 14)).map((text, i) => `${String(from + i).padStart(3)}  ${text}`).join("\n").trimEnd() : "";
  const wires = (title, ports) => (Object.keys(ports ?? {}).length ? [h("h3", {}, title), h("dl", { class: "wires" }, Object.entries(ports).flatMap(([port, wired]) => wiring(s, port, wired)))] : []);
  const breakButton = (side, set, key) => h("button", { "aria-pressed": set, disabled: Boolean(s.ended), title: s.ended ? "The next run has the breakpoints of this one. They are changed while a run goes on." : "", onclick: () => onBreak(path, side) }, `${set ? "◉" : "○"} Break ${side} (${key})`);
  $("node").replaceChildren(...[
    h("p", { class: "about" }, h("strong", {}, about.name), ` ${about.type === about.name ? about.kind : about.type} `, h("span", { class: "muted" }, path)),
    about.description || about.comment ? h("p", {}, about.description || about.comment) : null,
    h("div", { class: `status ${rank}` }, h("b", {}, `${icon} ${words}`), h("span", {}, [percent(node?.feedback ?? ""), last ? ago(s, last.t) : "", node?.starts ? `started ${node.starts}×` : ""].filter(Boolean).join(" · "))),
    page.recorded || !chosen ? null : h("div", { class: "group joined", role: "group", "aria-label": "breakpoints of this node" }, breakButton("before", before, "b"), breakButton("after", after, "a")),
    ...wires("Settings", about.settings), ...wires("Reads", about.inputs), ...changed(s, about, chosen), ...wires("Writes", about.outputs),
    ...(results.length ? [h("h3", {}, "Last results"), h("ol", { class: "history" }, results.slice(-8).reverse().map((e) => h("li", {}, moment(e.t), h("span", { class: e.status !== "FAILURE" ? "" : expected(s, e.t) ? "warn" : "bad" }, `${STATUS[e.status].icon} ${STATUS[e.status].word}`, e.reason ? ` ${e.reason.code}: ${e.reason.message}` : ""))))] : []),
    ...(lines.length ? [h("h3", {}, "Log"), h("ol", { class: "history" }, lines.slice(-20).reverse().map((e) => h("li", {}, moment(e.t), h("span", { class: e.bad ? "bad" : "" }, `${e.level} ${e.text}`))))] : []),
    ...(source ? [h("h3", {}, "In the tree's file"), h("pre", { tabindex: "0" }, source)] : [])].filter(Boolean));
}

let portsKey = "";
export function drawPorts(s) {
  if ($("ports").hidden) return;
  const key = `${s.run?.run}|${[...s.ports.values()].map((p) => p.t).join()}|${(s.t + ageOf(s, s.t)).toFixed(0)}`;
  if (key === portsKey || $("ports").querySelector("details[open]")) return;
  portsKey = key;
  if (!s.ports.size) { $("ports").replaceChildren(h("p", { class: "empty" }, "Nothing is written yet.")); return; }
  $("ports").replaceChildren(h("dl", { class: "wires" }, [...s.ports].flatMap(([name, p]) => [
    h("dt", { title: name }, name.split("/").at(-1)),
    h("dd", {}, p.sentence || compact(p.value), h("span", { class: "muted" }, `${s.byPath.get(p.writer)?.name ?? p.writer} · ${ago(s, p.t)}`))])));
}

function compact(value) {
  const text = show(value);
  if (typeof value !== "object" || value === null || text.length < 60) return plain(text);
  return h("details", {}, h("summary", {}, value.type ?? text.slice(0, 40)), h("pre", { tabindex: "0" }, text));
}

let logKey = "";
export function drawLog(s) {
  if ($("log").hidden) return;
  const key = `${s.run?.run}|${s.marks.length}|${s.marks.at(-1)?.t}|${s.spans.length}|${s.spans.at(-1)?.end}|${s.logs.length}|${s.logs.at(-1)?.t}`;
  if (key === logKey) return;
  logKey = key;
  const name = (path) => s.byPath.get(path)?.name ?? path;
  const turns = s.spans.slice(-200).flatMap((span) => [{ t: span.start, icon: "▶", text: name(span.path) }, ...(span.end === null || span.status === "FAILURE" || span.halted ? [] : [{ t: span.end, icon: STATUS[span.status].icon, text: `${name(span.path)} ${STATUS[span.status].word}, ${seconds(span.end - span.start)}` }])]);
  const events = [...s.marks.slice(-200).map((m) => ({ t: m.t, icon: ICON[m.kind], text: m.text, rank: m.kind === "bad" || (m.kind === "failure" && !expected(s, m.t)) ? "bad" : m.kind === "failure" ? "warn" : "" })), ...turns, ...s.logs.slice(-200).map((e) => ({ ...e, rank: e.bad ? "bad" : "", icon: "✎", text: `${name(e.path)} ${e.level}: ${e.text}` }))].sort((a, b) => b.t - a.t).slice(0, 300);
  if (!events.length) { $("log").replaceChildren(h("p", { class: "empty" }, "Nothing has happened yet.")); return; }
  $("log").replaceChildren(h("ol", { class: "events" }, events.map((e) => h("li", {}, moment(e.t), h("span", { class: e.rank ?? "" }, `${e.icon} ${e.text}`)))));
}

const ICON = { failure: "✗", bad: "✗", good: "✓", act: "◆", state: "▼" };
