// The editor's page: edits, keys, undo, saving, and what comes back from the disk and from a run.
import { $, h } from "./shared/dom.js";
import { Drawing } from "./drawing.js";
import { History, stretch } from "./history.js";
import { showKeys } from "./keys.js";
import { openMenu } from "./menu.js";
import { about, bare, children, holdsNodes, labelOf, node, page, siblings, take, yaml } from "./model.js";
import { NodePane } from "./node.js";
import { choose } from "./palette.js";
import { askRun } from "./run.js";
import { get, mayAct, me, post } from "./talk.js";
import { TextPane } from "./text.js";
import { follow, NAMES, sentence } from "./trial.js";

const SETTLED = 150; // ms without a key after which the text is judged
const KEPT = 400; // ms after a change until its draft is kept
const WATCH = 1000, WATCH_RUN = 250; // ms between two looks at the disk, and at a run

const past = new History();
const bars = new Map(); // what must not be overlooked, by name
let judged = 0, judging = null, keeping = null, busy = Promise.resolve(), lost = false;

const drawing = new Drawing({ select: (id) => select(id), open: () => pane.focusFirst(), menu: (id, x, y) => menu(x, y), drop, bring, mayDrag: (id) => editable() && Boolean(node(id)?.parent) });
const text = new TextPane({ typed, place: (id) => select(id, false), mend });
const pane = new NodePane({ edit: (said, words) => edit(said, words), mend, act: (name) => ACTIONS[name].run(), leave: () => drawing.root.focus() });
drawing.blank = () => h("div", { class: "blank" }, h("b", {}, page.text.trim() ? "There is no tree that can be drawn." : "This file is empty."),
  page.text.trim() ? h("span", {}, page.state.problem || "The text beside has no root.") : [h("span", {}, "Insert the first node: press ", h("kbd", {}, "i"), " or the button. Most trees begin with a sequence."), h("button", { class: "primary", onclick: () => ACTIONS.insert.run(), disabled: !page.mayAct }, "Insert the first node")]);

const editable = () => page.mayAct && !page.small && !page.old;
const dirty = () => page.text !== page.disk;

// ------------------------------------------------------------------------------------------------ the text

// Every change of the text comes here: from the drawing, from the keys, from the disk.
function change(after, words, more = {}) {
  past.add(page.text, after, words, { selected: page.selected, ...more });
  put(after);
}

function put(after) {
  page.text = after;
  page.version = (page.version ?? 0) + 1;
  text.set(after);
  keep();
  head();
}

function show(state) {
  take(state);
  drawing.update();
  text.update();
  pane.update();
  $("stale").hidden = !page.old;
  $("stale").textContent = page.old ? `The text cannot be read, so the drawing shows the last one that could: ${page.state.problem || "correct the error"}` : "";
  const found = page.state.findings.filter(({ severity }) => severity === "error").length, warnings = page.state.findings.filter(({ severity }) => severity === "warning").length;
  const errors = found || (page.old ? 1 : 0);
  $("problems").textContent = [errors && `${errors} error${errors > 1 ? "s" : ""}`, warnings && `${warnings} warning${warnings > 1 ? "s" : ""}`].filter(Boolean).join(", ") || "no findings";
  $("problems").className = `quiet ${errors ? "bad" : warnings ? "warn" : "good"}`;
  for (const button of document.querySelectorAll("[data-start]")) button.title = errors ? "Correct the errors first: a tree with errors is saved, but not run" : button.dataset.about;
  head();
}

function typed(after) {
  change(after, "typing", { typed: true });
  clearTimeout(judging);
  judging = setTimeout(judge, SETTLED);
}

async function judge() {
  const number = judged += 1;
  const answer = await post("state", { text: page.text });
  if (number !== judged) return;
  if (answer.error) { say(answer.error); return; }
  show(answer);
}

// Carry a change out, one after the other; `then` is the node to select after it.
function carryOut(request, asked, words, then) {
  const turn = busy.then(async () => {
    text.area.readOnly = true;
    judged += 1;
    const answer = await post(request, { text: page.text, ...asked });
    text.area.readOnly = !page.mayAct;
    if (answer.error) { say(answer.error); return false; }
    change(answer.text, words, { then: then ?? page.selected });
    if (then) page.selected = then;
    show(answer);
    drawing.select();
    text.select();
    return true;
  });
  busy = turn.catch(() => {});
  return turn;
}

function edit(said, words, then) { return carryOut("edit", { edit: said }, words, then); }
function mend(number) { return carryOut("mend", { number }, "hint applied"); }

async function step(back) {
  await busy;
  const found = back ? past.undo(page.text) : past.redo(page.text);
  if (!found) { say(back ? "Nothing to undo." : "Nothing to redo."); return; }
  put(found.text);
  page.selected = (back ? found.step.selected : found.step.then) || page.selected;
  say(`${back ? "Undone" : "Done again"}: ${found.step.words}`);
  await judge();
  drawing.select();
}

// ------------------------------------------------------------------------------------------------ selection

function select(id, reveal = true) {
  if (!page.nodes.has(id)) return;
  const same = id === page.selected;
  page.selected = id;
  drawing.select();
  text.select(reveal);
  if (!same) pane.update();
}

function jump(by) {
  const { findings } = page.state;
  if (!findings.length) { say("No findings."); return; }
  page.finding = ((page.finding ?? -1) + by + findings.length) % findings.length;
  const finding = findings[page.finding];
  if (finding.node) select(finding.node);
  text.reveal(finding.line || 1);
  say(`${finding.message}${finding.hint ? ` ${finding.hint}` : ""}`);
}

function search() {
  const asked = $("find").value.trim().toLowerCase();
  drawing.found = new Set(asked ? page.state.nodes.filter((one) => `${one.name} ${one.type} ${one.comment} ${one.ports.map((port) => `${port.name} ${port.text}`).join(" ")}`.toLowerCase().includes(asked)).map(({ id }) => id) : []);
  drawing.update();
  const first = [...drawing.found][0];
  if (first && !drawing.found.has(page.selected)) select(first);
}

// ------------------------------------------------------------------------------------------------ what a node can become

const listed = (one) => Boolean(one?.parent) && one.index >= 0 && holdsNodes(node(one.parent).type);

// YAML of a new node, with the wires and outputs that follow from the types.
async function snippet(name) {
  const kind = about(name);
  if (kind.role === "skill" || kind.role === "subtree") {
    const { ports = {} } = await post("offers", { text: page.text, definition: node()?.tree ?? "", kind: name });
    const wired = kind.inputs.filter(({ required }) => required).map((port) => {
      const fitting = ports[port.name] ?? [], own = fitting.find(({ word }) => word === `{${port.name}}`) ?? (port.units || port.choices || port.type === "text" ? null : fitting[0]);
      return own ? `${port.name}: "${own.word}"` : port.choices?.length === 1 ? `${port.name}: ${port.choices[0]}` : "";
    });
    return `${name}: {${[...wired, ...kind.outputs.map((port) => `${port.name}: "{${port.name}}"`)].filter(Boolean).join(", ")}}`;
  }
  const fields = kind.fields.filter(({ required }) => required).map((field) => `${field.name}:${field.nodes ? field.type === "nodes by word" ? "\n  first:\n    succeed: {}" : "\n  succeed: {}" : ` ${first(field)}`}`);
  return [`${name}: ${first(kind.value)}`.trim(), ...fields].join("\n");
}

function first({ type, choices, units, default: given }) {
  const known = { nodes: "[]", nothing: "{}", condition: '"true"', "nodes by word": "{}", assignments: "{done: true}", int: "1", number: "1", bool: "true", name: "value", list: "[1]", "list of texts": "[yes, no]", text: "" };
  return given || (choices ? choices[0] : units ? `1 ${units[0]}` : known[type] ?? ""); // a text is a person's: `check` refuses an empty one
}

// Where a new node goes: the first one, inside the selected node, or after it. Null after the reason was shown.
function gap(inside) {
  const one = node(), root = !page.state.nodes.length;
  if (!editable()) return null;
  if (root) return { into: "", index: 0, id: "root", where: "the first node" };
  inside = inside || (one && !one.parent && holdsNodes(one.type));
  const wrong = !one ? "Select a node first." : inside && !holdsNodes(one.type) ? `${one.type} has no list of children: insert after it, or wrap it first.` : !inside && !listed(one) ? "Only one node has its place here: wrap it in a sequence first (w)." : "";
  if (wrong) { say(wrong); return null; }
  const into = inside ? one.id : one.parent, index = inside ? children(one.id).filter((child) => child.index >= 0).length : one.index + 1;
  return { into, index, id: `${into}/${index}`, where: `${inside ? "into" : "after"} ${labelOf(one)}` };
}

async function insert(inside) {
  const at = gap(inside);
  if (!at) return;
  const name = await choose(`Insert ${at.where}`, at.into ? ["skill", "subtree", "composite", "leaf"] : ["composite", "skill", "subtree", "leaf"], carry);
  drawing.root.focus();
  if (name) await edit({ do: "insert", into: at.into, index: at.index, node: await snippet(name) }, `insert ${name}`, at.id);
}

// Copy, cut and paste: a node is YAML, so it goes into another tree, and a text from elsewhere into this one.
let copied = "";
function copy(cut) {
  const one = node();
  if (!one) return;
  const lines = page.text.split("\n").slice(one.line - 1, one.end_line).map((line, i) => (i ? line.replace(new RegExp(`^ {0,${one.column - 1}}`), "") : line.slice(one.column - 1)));
  copied = [...(one.comment ? [`# ${one.comment}`] : []), ...lines].join("\n");
  if (cut) ACTIONS.remove.run(); else say(`Copied: ${labelOf(one)}`);
}

async function paste(words = copied) {
  const at = words.trim() && gap(false), taken = new Set(page.state.nodes.map(({ name }) => name));
  const fresh = (name) => { let n = 2; while (taken.has(`${name} ${n}`)) n += 1; return taken.has(name) ? `${name} ${n}` : name; };
  if (at) await edit({ do: "insert", into: at.into, index: at.index, node: words.replace(/^(\s*name: +)(.+?)\s*$/gm, (line, key, name) => (taken.has(bare(name)) ? key + yaml(fresh(bare(name))) : line)) }, "paste", at.id);
}

// Words beside a node that hold a node and have none: else, default, on_failure.
function places(one) {
  const owners = [about(one.type), ...one.modifiers.map(({ name }) => page.catalogue.words[name])];
  return owners.flatMap((owner) => owner?.fields ?? []).filter((field) => field.type === "node" && !children(one.id).some(({ slot }) => slot === field.name)).map(({ name }) => name);
}

async function fill() {
  const one = node(), slot = one && places(one)[0];
  if (!editable() || !slot) return;
  const name = await choose(`Insert as ${slot.replaceAll("_", " ")} of ${labelOf(one)}`, ["skill", "subtree", "composite", "leaf"]);
  drawing.root.focus();
  if (!name) return;
  await edit({ do: "insert", into: one.id, index: 0, slot, node: await snippet(name) }, `insert ${name}`);
  const made = children(one.id).find((child) => child.slot === slot);
  if (made) select(made.id);
}

async function wrap(roles, title) {
  const one = node();
  if (!editable() || !one) return;
  const name = await choose(`${title} ${labelOf(one)}`, roles);
  drawing.root.focus();
  if (!name) return;
  const modifier = about(name).role === "modifier";
  const made = modifier && !one.modifiers.some((entry) => entry.name === name) ? { do: "set_modifier", node: one.id, modifier: name, value: starting(name) } : { do: "wrap", node: one.id, in: name };
  if (await edit(made, `${name} around ${labelOf(one)}`)) { const field = pane.root.querySelector(`[data-key="modifier ${CSS.escape(name)}"]`); if (modifier && field) { field.focus(); field.select(); } }
}

const starting = (name) => { const { value } = about(name); return value.type === "condition" ? '"true"' : value.units ? `5 ${value.units.includes("s") ? "s" : value.units[0]}` : value.type === "int" ? "3" : first(value); };

// After a node was taken out, addresses behind it count one less.
function without(address, gone) {
  const [, parent, index] = gone.match(/^(.*)\/(\d+)$/) ?? [];
  if (!parent || !address.startsWith(`${parent}/`)) return address;
  const rest = address.slice(parent.length + 1).split("/");
  if (Number(rest[0]) > Number(index)) rest[0] = String(Number(rest[0]) - 1);
  return `${parent}/${rest.join("/")}`;
}

function carry(name, event) {
  say(`Let ${name} go at its place; Esc leaves.`);
  drawing.carry(name, event);
}

// A node that was dragged out of the palette.
async function bring(name, into, index) {
  if (into) select(into);
  await edit({ do: "insert", into, index, node: await snippet(name) }, `insert ${name}`, into ? `${into}/${index}` : "root");
}

function drop(id, into, index) {
  const one = node(id), same = one.parent === into, at = same && index > one.index ? index - 1 : index;
  if (same && at === one.index) return;
  edit({ do: "move", node: id, into, index: at }, `move ${labelOf(one)}`, `${without(into, id)}/${at}`);
}

function move(by) {
  const one = node();
  if (!editable() || !listed(one)) return;
  const at = one.index + by;
  if (at >= 0 && at < siblings(one).filter(({ index }) => index >= 0).length) edit({ do: "move", node: one.id, into: one.parent, index: at }, `move ${labelOf(one)}`, `${one.parent}/${at}`);
}

function moveOut() {
  const one = node(), parent = one && node(one.parent);
  if (editable() && listed(one) && listed(parent)) drop(one.id, parent.parent, parent.index + 1);
}

function moveIn() {
  const one = node(), before = one && siblings(one).find(({ index }) => index === one.index - 1);
  if (editable() && listed(one) && before && holdsNodes(before.type)) drop(one.id, before.id, children(before.id).length);
}

async function rename() {
  const one = node();
  if (!editable() || !one) return;
  const name = await ask("Rename", "The name is shown instead of the type; it is unique in its tree. Empty removes it.", "name", one.name);
  if (name !== null) edit({ do: "rename", node: one.id, name }, "rename");
}

async function comment() {
  const one = node();
  if (!editable() || !one) return;
  const words = await ask("Comment", "A line above the node. The operator sees it as well. Empty removes it.", "comment", one.comment);
  if (words !== null) edit({ do: "comment", node: one.id, text: words }, "comment");
}

const simple = (kind, words, then) => () => { const one = node(); if (editable() && one) edit({ do: kind, node: one.id }, `${words} ${labelOf(one)}`, then?.(one)); };

// Every edit once: for the menu, the keys and the help.
const ACTIONS = {
  insert: { words: "Insert after …", key: "i", run: () => insert(false) },
  inside: { words: "Insert inside …", key: "a", run: () => insert(true), fits: (one) => holdsNodes(one.type) },
  place: { words: "Insert as else, default, on failure …", key: "o", run: fill, fits: (one) => places(one).length > 0, line: true },
  wrap: { words: "Wrap in …", key: "w", run: () => wrap(["composite"], "Wrap") },
  modifier: { words: "Add a modifier …", key: "m", run: () => wrap(["modifier"], "Modifier of") },
  unwrap: { words: "Unwrap", key: "u", run: simple("unwrap", "unwrap"), fits: (one) => holdsNodes(one.type) && children(one.id).length > 0, line: true },
  rename: { words: "Rename …", key: "F2", run: rename },
  comment: { words: "Comment …", key: "c", run: comment },
  duplicate: { words: "Duplicate", key: "d", run: simple("duplicate", "duplicate", (one) => `${one.parent}/${one.index + 1}`), fits: listed },
  copy: { words: "Copy", key: "Ctrl+C", run: () => copy(false) },
  cut: { words: "Cut", key: "Ctrl+X", run: () => copy(true) },
  paste: { words: "Paste after", key: "Ctrl+V", run: () => paste(), line: true },
  up: { words: "Move up", key: "Alt+↑", run: () => move(-1), fits: listed },
  down: { words: "Move down", key: "Alt+↓", run: () => move(1), fits: listed },
  out: { words: "Move out of its parent", key: "Alt+←", run: moveOut, fits: listed },
  in: { words: "Move into the one before", key: "Alt+→", run: moveIn, fits: listed, line: true },
  remove: { words: "Delete", key: "Del", run: simple("delete", "delete") },
};

function menu(x, y) {
  const one = node();
  if (!one || page.small) return;
  openMenu(Object.values(ACTIONS).map((action) => ({ ...action, disabled: !editable() || (action.fits && !action.fits(one)) })), x, y, () => drawing.root.focus());
}

function ask(title, words, label, value) {
  $("ask-title").textContent = title;
  $("ask-about").textContent = words;
  $("ask-label").textContent = label;
  $("ask-input").value = value ?? "";
  const dialog = $("ask");
  dialog.returnValue = "";
  dialog.showModal();
  $("ask-input").select();
  return new Promise((resolve) => {
    dialog.addEventListener("close", () => { drawing.root.focus(); resolve(dialog.returnValue === "ok" ? $("ask-input").value.trim() : null); }, { once: true });
  });
}
$("ask-ok").value = "ok";
$("ask-cancel").addEventListener("click", () => $("ask").close());

// ------------------------------------------------------------------------------------------------ keys

const KEYS = { i: "insert", Insert: "insert", a: "inside", o: "place", w: "wrap", m: "modifier", u: "unwrap", F2: "rename", c: "comment", d: "duplicate", Delete: "remove", Backspace: "remove" };

for (const kind of ["copy", "cut", "paste"]) document.addEventListener(kind, (event) => {
  if (!drawing.root.contains(document.activeElement)) return;
  if (kind === "paste") paste(event.clipboardData.getData("text/plain")); else { copy(kind === "cut"); event.clipboardData.setData("text/plain", copied); }
  event.preventDefault();
});
drawing.root.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey) return;
  const one = node(), { key } = event;
  const walk = { ArrowUp: () => drawing.step(-1), ArrowDown: () => drawing.step(1), PageUp: () => drawing.step(-drawing.inSight), PageDown: () => drawing.step(drawing.inSight), Home: () => drawing.step(-1e6), End: () => drawing.step(1e6), ArrowLeft: () => one?.parent, ArrowRight: () => children(page.selected)[0]?.id };
  const shifted = { ArrowUp: "up", ArrowDown: "down", ArrowLeft: "out", ArrowRight: "in" };
  if (event.altKey && shifted[key]) ACTIONS[shifted[key]].run();
  else if (event.altKey) return;
  else if (walk[key]) select(walk[key]() ?? "");
  else if (key === "Enter") { if (page.state.nodes.length) pane.focusFirst(); else ACTIONS.insert.run(); }
  else if (key === "ContextMenu" || (key === "F10" && event.shiftKey)) menuAtNode();
  else if (key === ".") { const found = page.state.findings.find((finding) => finding.node === page.selected && finding.mends); if (found) mend(found.number); else say("No hint of this node can be applied."); }
  else if (KEYS[key] && !page.small) { const action = ACTIONS[KEYS[key]]; if (!one || !action.fits || action.fits(one)) action.run(); else say(`${action.words.replace(" …", "")} does not fit here.`); }
  else return;
  event.preventDefault();
});

function menuAtNode() {
  const box = drawing.shown.get(page.selected)?.at(-1).querySelector(".box").getBoundingClientRect();
  if (box) menu(box.left + 30, box.bottom);
}

addEventListener("keydown", (event) => {
  const { key } = event, control = event.ctrlKey || event.metaKey, writing = event.target.matches("input, textarea, select");
  if (document.querySelector("dialog[open]")) return;
  if (control && key.toLowerCase() === "s") save();
  else if (control && key.toLowerCase() === "z" && (!writing || event.target === text.area || !changedField(event.target))) { settle(event.target); step(!event.shiftKey); }
  else if (control && key.toLowerCase() === "y") { settle(event.target); step(false); }
  else if (control && key === "Enter") start("dry");
  else if (key === "F8") jump(event.shiftKey ? -1 : 1);
  else if (key === "F6") panes(event.shiftKey ? -1 : 1);
  else if (key === "?" && !writing) showKeys(ACTIONS);
  else if (key === "/" && !writing) $("find").focus();
  else return;
  event.preventDefault();
});

const changedField = (field) => field.dataset?.was !== undefined && field.value !== field.dataset.was;
const settle = (field) => { if (field.dataset?.was !== undefined) field.dataset.was = field.value; };

function panes(by) {
  const all = [drawing.root, pane.root, text.area].filter((one) => one.offsetParent), at = all.findIndex((one) => one.contains(document.activeElement));
  all[(at + by + all.length) % all.length].focus();
}

// ------------------------------------------------------------------------------------------------ disk and drafts

function head() {
  const state = lost ? "lost" : !page.stamp && !page.text ? "new" : dirty() || (!page.stamp && page.text) ? "unsaved" : "saved";
  $("saved").dataset.state = state;
  $("saved").textContent = { lost: "no connection", new: "new file", unsaved: page.stamp ? "unsaved changes" : "not yet saved", saved: page.problem ? "read-only" : "saved" }[state];
  document.title = `${state === "unsaved" ? "● " : ""}${page.name ?? ""} – Pomona editor`;
  $("save").disabled = !page.mayAct || Boolean(page.problem) || state === "saved" || state === "new";
  $("undo").disabled = !past.undone;
  $("redo").disabled = !past.redone;
  $("undo").title = past.undone ? `Undo: ${past.undone.words} (Ctrl+Z)` : "Undo (Ctrl+Z)";
  $("insert").disabled = $("menu-button").disabled = !editable();
}

function keep() {
  clearTimeout(keeping);
  keeping = setTimeout(keepNow, KEPT);
}

async function keepNow(keepalive = false) {
  clearTimeout(keeping);
  keeping = null;
  if (!page.mayAct) return;
  const answer = await post(...(dirty() ? ["draft", { text: page.text, stamp: page.stamp }] : ["drop", {}]), keepalive);
  if (answer.error && answer.status) bar("draft", "warn", "The draft is not kept", answer.error);
}
addEventListener("pagehide", () => { if (keeping) keepNow(true); });

async function save() {
  await busy;
  if ($("save").disabled) { say(page.problem ? `Not saved: ${page.problem}` : "Nothing to save."); return; }
  clearTimeout(keeping);
  const answer = await post("save", { text: page.text, stamp: page.stamp });
  if (answer.disk) { if (answer.error) conflict(answer.disk); else saved(answer.disk); return; }
  bar("save", "bad", "Not saved", answer.error);
}

function saved(disk) {
  Object.assign(page, { disk: disk.text, stamp: disk.stamp, problem: disk.problem });
  clear("save", "conflict", "gone");
  const errors = page.state.findings.some(({ severity }) => severity === "error");
  say(errors ? "Saved, with errors: it cannot be run yet." : "Saved.");
  head();
}

// The file has another content than the one that this text was made from.
function conflict(disk) {
  if (disk.text === page.text) { Object.assign(page, { disk: disk.text, stamp: disk.stamp, problem: disk.problem }); clear("conflict"); head(); return; }
  const lines = (words) => words.split("\n").length, [at, mine, theirs] = stretch(page.text, disk.text), from = lines(page.text.slice(0, at));
  bar("conflict", "bad", "Changed on disk", `The file has another content now, and this page has unsaved changes: lines ${from} to ${from + Math.max(lines(mine), lines(theirs)) - 1}.`, [
    ["Keep mine", () => { Object.assign(page, { disk: disk.text, stamp: disk.stamp, problem: disk.problem }); clear("conflict"); keep(); head(); say("Kept: Save writes this text over the one on the disk."); }],
    ["Take the disk's", () => { clear("conflict"); over(disk, "taken from the disk"); say("Taken from the disk. Undo brings your text back."); }],
  ], false);
}

function over(disk, words) {
  Object.assign(page, { disk: disk.text, stamp: disk.stamp, problem: disk.problem });
  change(disk.text, words);
  judge();
}

function onDisk(disk) {
  if (!disk.readable || !disk.stamp) clear("conflict");
  if (!disk.readable) { page.problem = disk.problem; bar("gone", "bad", "The file cannot be used", `${disk.problem}. This page keeps its text.`, [], false); return; }
  if (!disk.stamp) { Object.assign(page, { stamp: "", disk: "", problem: disk.problem }); bar("gone", "warn", "The file is gone", "It was removed or renamed. Save writes it again.", [], false); keep(); return; }
  clear("gone");
  if (dirty()) conflict(disk);
  else { over(disk, "changed on disk"); say("The file has changed on disk: taken over."); }
}

// Why the file cannot be saved; said once for each reason.
function limits() {
  if (page.problem === page.limit) return;
  page.limit = page.problem;
  if (page.problem) bar("readonly", "warn", "Read-only", `${page.problem}: changes cannot be saved here.`); else clear("readonly");
}

async function watch() {
  const trial = page.trial;
  const answer = await get("watch", { page: me, stamp: page.stamp, trial: trial?.number ?? 0, count: page.heard ?? 0 });
  if (answer.error) { if (!lost) { lost = true; bar("lost", "bad", "No connection", `${answer.error} Unsaved changes stay in this page.`, [], false); head(); } }
  else {
    if (lost) { lost = false; clear("lost"); keep(); }
    if (answer.disk) onDisk(answer.disk);
    else { page.problem = answer.problem; if (page.stamp) clear("gone", "conflict"); limits(); }
    if (answer.others) bar("others", "warn", "Another page edits this file", "Each sees the other's changes when they are saved, as a conflict if both have some."); else clear("others");
    if (answer.trial) heard(answer);
    if (answer.drafts.some((name) => !offered.has(name))) offerAll((await get("file", { page: me })).drafts?.filter((draft) => !offered.has(draft.page)) ?? []);
    head();
  }
  setTimeout(watch, page.trial && !page.trial.over ? WATCH_RUN : WATCH);
}

// ------------------------------------------------------------------------------------------------ trials

// Returns the problem.
async function start(kind, asked = {}) {
  await busy;
  bar("trial", "busy", NAMES[kind], "starting …");
  const answer = await post("start", { text: page.text, kind, ...asked });
  if (answer.error) bar("trial", "bad", "Not started", answer.error); else page.asked = page.text;
  return answer.error;
}

function heard({ trial, count, messages }) {
  if (!messages.length && page.trial?.number === trial) return;
  const first_ = page.trial?.number !== trial;
  page.trial = follow(page.trial, trial, messages, first_ ? page.asked ?? page.text : page.trial.text);
  page.heard = count;
  const [words, more, rank] = sentence(page.trial), { cases, page: link, done } = page.trial;
  const list = cases.filter(({ passed }) => !passed).map((one) => h("li", {}, `${one.passed ? "✔" : "✘"} ${one.case}`, one.problems.length ? h("span", { class: "muted" }, ` ${one.problems.join("; ")}`) : null));
  bar("trial", rank, words, more, [], true, [
    link && !page.trial.over ? h("a", { href: link, target: "_blank", rel: "noreferrer" }, "Page of the run") : null,
    !done ? h("button", { onclick: () => post("stop", {}) }, "◼ Stop") : null, list.length ? h("ul", {}, list) : null,
  ]);
  drawing.update();
}

// ------------------------------------------------------------------------------------------------ words

function bar(name, rank, title, words, choices = [], closes = true, more = []) {
  const made = h("div", { class: "bar", "data-rank": rank, role: rank === "bad" ? "alert" : "status", "data-bar": name }, h("b", {}, title), h("span", {}, words), more,
    choices.map(([label, run]) => h("button", { onclick: run }, label)), closes ? h("button", { class: "quiet close", onclick: () => clear(name), "aria-label": `Close: ${title}` }, "Close") : null);
  if (bars.get(name)?.outerHTML === made.outerHTML) return;
  bars.set(name, made);
  $("bars").replaceChildren(...bars.values());
}

function clear(...names) {
  for (const name of names) bars.get(name)?.remove(), bars.delete(name);
}

let quiet = null;
function say(words) {
  $("said").textContent = words;
  clearTimeout(quiet);
  quiet = setTimeout(() => { $("said").textContent = ""; }, 4000);
}

// ------------------------------------------------------------------------------------------------ the beginning

for (const [id, run] of Object.entries({ save, undo: () => step(true), redo: () => step(false), insert: () => ACTIONS.insert.run(), problems: () => jump(1), "show-keys": () => showKeys(ACTIONS) })) $(id).addEventListener("click", run);
$("menu-button").addEventListener("click", (event) => { const at = event.currentTarget.getBoundingClientRect(); menu(at.left, at.bottom + 2); });
for (const button of document.querySelectorAll("[data-start]")) { button.dataset.about = button.title; button.addEventListener("click", () => (button.dataset.start === "run" ? askRun((asked) => start("run", asked)) : start(button.dataset.start))); }
$("run-cancel").addEventListener("click", () => $("run-ask").close());
$("find").addEventListener("input", search);
$("find").addEventListener("keydown", (event) => { if (event.key === "Enter" || event.key === "Escape") { if (event.key === "Escape") { $("find").value = ""; search(); } drawing.root.focus(); event.preventDefault(); } });
const narrow = matchMedia("(max-width: 720px)");
const resized = () => { page.small = narrow.matches; pane.update(); head(); };
narrow.addEventListener("change", resized);

async function open() {
  const [opened, catalogue] = await Promise.all([get("file", { page: me }), get("catalogue")]);
  const problem = opened.error ?? catalogue.error;
  if (problem) { bar("open", "bad", "The file cannot be opened", problem, [], false); return; }
  const { disk } = opened;
  Object.assign(page, { catalogue, name: opened.name, path: opened.path, cell: opened.cell, options: opened.options, scenarios: opened.scenarios, mayAct: mayAct && opened.may_act, small: narrow.matches, text: disk.text, disk: disk.text, stamp: disk.stamp, problem: disk.problem });
  $("name").textContent = opened.name;
  $("path").textContent = opened.link ? `a link to ${opened.path}` : opened.path;
  $("path").title = opened.path;
  $("start-run").title = $("start-run").dataset.about = `Run on the simulated cell '${opened.cell}', with a page of its own`;
  $("start-scenarios").disabled = !opened.scenarios.length;
  if (!opened.scenarios.length) $("start-scenarios").title = "No scenario file below the tree's folder tests it";
  limits();
  if (!page.mayAct) bar("watch", "warn", "This page only shows", "open the link that was printed to edit");
  text.set(page.text);
  text.area.readOnly = !page.mayAct;
  offerAll(opened.drafts);
  await judge();
  if (page.state.nodes.length) select(page.state.nodes[0].id);
  drawing.root.focus();
  document.body.dataset.ready = "yes";
  watch();
}

// Each is offered once; a page that was closed just now is known later than this one opens.
const offered = new Set([me]);
function offerAll(drafts) {
  for (const draft of drafts) { offered.add(draft.page); offer(draft); }
}

// An unsaved text of a page that was closed: this page's own comes back, another one is offered.
function offer(draft) {
  const when = new Date(draft.time * 1000).toLocaleString(), drop_ = () => post("drop", { page: draft.page });
  if (draft.text === page.text) { drop_(); return; }
  const back = () => {
    const disk = page.disk, stamp = page.stamp;
    change(draft.text, "draft restored");
    if (draft.stamp !== stamp) { page.stamp = draft.stamp; conflict({ text: disk, stamp, problem: page.problem, readable: true }); }
    judge();
  };
  if (draft.page === me) { back(); bar("restored", "warn", "Unsaved changes are back", `They are of ${when}. Undo removes them.`); return; }
  bar(`draft ${draft.page}`, "warn", "An unsaved draft was found", `A page was closed without saving, at ${when}.`, [
    ["Restore it", () => { clear(`draft ${draft.page}`); back(); drop_(); }], ["Delete it", () => { clear(`draft ${draft.page}`); drop_(); }],
  ], false);
}

open();
