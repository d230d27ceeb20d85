// Words about the run: why something failed, what a node does, what was written.
import { $, h, seconds, show } from "./dom.js";
import { page } from "./page.js";
import { lastResult, leavesOf, STATUS } from "./store.js";

let goTo = () => {};
export function onMoment(handler) { goTo = handler; }

const moment = (t) => h("button", { class: "moment", title: "Show this moment", onclick: () => goTo(t) }, seconds(t));

function reasonTree(reason, s) {
  const name = s.byPath.get(reason.node_path)?.name ?? reason.node_path;
  const facts = Object.entries(reason.data ?? {});
  return h("li", {}, h("strong", {}, name || "run"), " ", h("code", {}, reason.code), ` ${reason.message} `,
    facts.length ? h("dl", { class: "facts" }, facts.flatMap(([k, v]) => [h("dt", {}, k.replaceAll("_", " ")), h("dd", {}, show(v))])) : null,
    reason.causes?.length ? h("ol", {}, reason.causes.map((cause) => reasonTree(cause, s))) : null);
}

let whyKey = "";
export function drawWhy(s) {
  const latest = s.failures.at(-1);
  const chain = s.ended?.reason ?? latest?.reason ?? null;
  const key = `${s.run?.run}|${s.failures.length}|${latest?.t}|${latest?.next}|${s.ended?.outcome}`;
  if (key === whyKey) return;
  whyKey = key;
  if (!chain) { $("why").replaceChildren(h("p", { class: "muted" }, s.ended ? "✓ The task succeeded; nothing failed on the way." : s.run ? "Nothing has failed so far." : "No run yet. Start one below Runs, or open a recorded one.")); return; }
  const parts = [];
  if (s.ended?.outcome === "success") parts.push(h("p", {}, h("b", { class: "good" }, "✓ The task succeeded"), ` after ${s.failures.length} failure${s.failures.length === 1 ? "" : "s"} on the way. The latest:`));
  else if (s.ended) parts.push(h("p", {}, h("b", { class: "bad" }, `✗ The run ended: ${s.ended.outcome}.`)));
  parts.push(h("ol", { class: "chain" }, reasonTree(chain, s)));
  if (latest) parts.push(h("p", {}, "At ", moment(latest.t), latest.next ? [". Then the tree went on with ", h("strong", {}, s.byPath.get(latest.next)?.name ?? latest.next), "."] : s.ended ? ". Then the run ended." : "."));
  if (s.failures.length > 1) {
    parts.push(h("details", {}, h("summary", {}, `All ${s.failures.length} failures`), h("ol", {}, s.failures.slice(-100).map((f) => h("li", {}, moment(f.t), ` ${s.byPath.get(f.path)?.name}: `, leavesOf(f.reason).map((l) => `${l.code} ${l.message}`).join("; "))))));
  }
  $("why").replaceChildren(...parts);
}

function written(s, wired) {
  const name = String(wired).match(/^\{\s*([A-Za-z_]\w*)/)?.[1];
  const entry = name && [...s.ports].findLast(([key]) => key.endsWith(`/${name}`))?.[1];
  return entry ? h("span", { class: "muted" }, ` ${entry.sentence || show(entry.value).slice(0, 120)}, ${seconds(Math.max(0, s.t - entry.t))} ago`) : null;
}

let nodeKey = "";
export function drawNode(s, onBreak) {
  const path = page.selected;
  const node = path && s.node.get(path);
  const key = `${path}|${node?.tick}|${node?.status}|${node?.feedback}|${s.run?.run}|${s.ports.size}|${s.breaks.has(path)}|${s.t.toFixed(0)}`;
  if (key === nodeKey) return;
  nodeKey = key;
  const about = path && s.byPath.get(path);
  if (!about) { $("node").replaceChildren(h("p", { class: "muted" }, "Choose a node in the tree: arrow keys move, b sets a breakpoint.")); return; }
  const { icon, word } = STATUS[node?.status ?? "INVALID"];
  const last = lastResult(node);
  const { line: from, end_line: to } = about;
  const source = from && s.run.tree_text ? s.run.tree_text.split("\n").slice(from - 1, Math.min(to ?? from, from + 14)).map((text, i) => `${String(from + i).padStart(4)}  ${text}`).join("\n") : "";
  const wiring = [...Object.entries(about.inputs ?? {}), ...Object.entries(about.outputs ?? {})].flatMap(([port, wired]) => [h("dt", {}, port), h("dd", {}, String(wired), written(s, wired))]);
  $("node").replaceChildren(
    h("p", {}, h("strong", {}, about.name), ` ${about.type === about.name ? about.kind : about.type} `, h("span", { class: "muted" }, path)),
    about.description || about.comment ? h("p", {}, about.description || about.comment) : "",
    h("p", {}, `${icon} ${word}`, last ? ` (last result: ${STATUS[last.status].word}, ${seconds(Math.max(0, s.t - last.t))} ago)` : "", node?.starts ? `, started ${node.starts}×` : "", node?.feedback ? `: ${node.feedback}` : ""),
    about.leaf && !page.recorded ? h("button", { onclick: () => onBreak(path) }, s.breaks.has(path) ? "Remove breakpoint (b)" : "Set breakpoint (b)") : "",
    wiring.length ? h("dl", { class: "facts" }, wiring) : "",
    node ? h("ol", { class: "history" }, node.history.slice(-8).reverse().map((e) => h("li", {}, moment(e.t), ` ${STATUS[e.status].icon} ${STATUS[e.status].word}`, e.reason ? ` ${e.reason.code}: ${e.reason.message}` : ""))) : "",
    source ? h("pre", {}, source) : "");
}

let portsKey = "";
export function drawPorts(s) {
  const key = `${s.run?.run}|${[...s.ports.values()].map((p) => p.t).join()}|${s.t.toFixed(0)}`;
  if (key === portsKey || $("ports").querySelector("details[open]")) return;
  portsKey = key;
  if (!s.ports.size) { $("ports").replaceChildren(h("p", { class: "muted" }, "Nothing is written yet.")); return; }
  $("ports").replaceChildren(h("dl", { class: "facts" }, [...s.ports].flatMap(([name, p]) => [
    h("dt", { title: `written by ${s.byPath.get(p.writer)?.name ?? p.writer}` }, name),
    h("dd", {}, p.sentence || compact(p.value), h("span", { class: "muted" }, ` ${seconds(Math.max(0, s.t - p.t))} ago`))])));
}

function compact(value) {
  const text = show(value);
  if (typeof value !== "object" || value === null || text.length < 60) return text.replace(/^<.*\.(\w+) object.*$/s, "$1");
  return h("details", {}, h("summary", {}, value.type ?? text.slice(0, 40)), h("pre", {}, text));
}
