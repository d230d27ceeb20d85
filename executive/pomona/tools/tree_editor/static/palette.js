// The palette: everything that a node can be, searched by name, purpose, port and failure code, with its help.
import { $, h } from "./shared/dom.js";
import { about, page } from "./model.js";

const ROLES = { skill: "Skills", subtree: "Subtrees of this file", composite: "Words with children", leaf: "Words without children", modifier: "Modifiers" };
const FIRST = ["sequence", "fallback", "retry"]; // what a tree is made of most

// Plain words for what a node does: they find it as its name does.
const PLAIN = {
  sequence: "then, and, steps, order, one after the other", fallback: "else, or, otherwise, alternative, plan b, if that fails", parallel: "both, at once, same time, together, meanwhile", if: "branch, condition, else", switch: "case, choose, select, depending on", check: "if, condition, test, compare", wait_until: "wait for, until", wait: "pause, sleep, delay, timer", set: "assign, variable, remember, store", ask: "question, operator, user, confirm, message, notify, tell", fail: "stop, abort, cancel, exit, end, error, give up", succeed: "end, done, finish, stop",
  speed: "slow, slower, fast, faster", timeout: "deadline, time limit", approve: "confirm, allow, permission", breakpoint: "pause, stop, debug", invert: "not, unless", retry: "try again, again, attempts", repeat: "loop, again, while, forever, times", for_each: "loop, all, every, each", run_once: "once", guard: "while, watch, monitor", when: "if, only if, skip", disabled: "skip, off, comment out",
  Detect: "look, see, find, search, locate, recognise, camera, picture, scan", DetectAll: "look, see, find all, count, scan", Refine: "measure, size, depth", RefineAll: "measure all", FeelFriction: "measure, feel, friction", SampleGrasp: "choose, candidates", ChooseFruit: "choose, select, next, sort", UpdateMap: "obstacle, map, scan", Grasp: "grab, grip, hold, close, squeeze, pick, pick up", SlipAvoidGrasp: "grab, grip, hold, close, squeeze, pick, pick up", Lift: "pick up, pick, raise", Release: "put down, set down, let go, drop, place, put, open", OpenFingers: "open", Approach: "reach, touch, move closer",
  MoveTo: "move, go, go home, home, drive, travel", Follow: "move, drive", Plan: "path, route, avoid", Retreat: "back off, go back, back, undo", KeepTally: "count, log, note, save", WaitSignal: "wait, input, button, plc", SetSignal: "output, lamp, plc", Handshake: "plc, machine",
};

const FAR = 6; // px that an entry is drawn before it is carried

const KEY = { skill: "i", subtree: "i", leaf: "i", composite: "w", modifier: "m" }; // that takes an entry of another role

let entries = [], order = [], shown = [], chosen = 0, done = null, take = null, pressed = null;

const search = $("palette-search"), list = $("palette-list"), dialog = $("palette");

// Ask for an entry of these roles, in this order; resolves with its name, or null. `carry(name, event)`: an entry is dragged out.
export function choose(title, roles, carry = null) {
  take = carry;
  const { skills, words } = page.catalogue;
  const called = page.state.definitions.filter(({ name }) => name).map(({ name }) => about(name));
  order = roles;
  entries = [...Object.values(skills), ...called, ...Object.values(words)].map((entry) => ({ entry, text: textOf(entry) }));
  $("palette-title").textContent = title;
  search.value = "";
  find();
  dialog.showModal();
  search.focus();
  return new Promise((resolve) => { done = resolve; });
}

function textOf({ name, summary, inputs = [], outputs = [], failures = [], fields = [] }) {
  return [name, summary, ...[...inputs, ...outputs, ...fields].map((port) => `${port.name} ${port.type ?? ""}`), ...failures.map(({ code, meaning }) => `${code} ${meaning}`)].join(" ").toLowerCase();
}

function rank({ entry, text }, asked) {
  const name = entry.name.toLowerCase().replaceAll("_", " "), plain = (PLAIN[entry.name] ?? "").split(", ");
  if (!asked) return FIRST.includes(entry.name) ? 0 : 1;
  if (name === asked || plain.includes(asked)) return name === asked ? 0 : 0.5;
  if (name.startsWith(asked) || plain.some((words) => words.startsWith(asked))) return 1;
  if (name.includes(asked)) return 2;
  const all = (where) => asked.split(/\s+/).every((word) => where.includes(word));
  return all(`${name} ${entry.summary}`.toLowerCase()) ? 3 : all(text) ? 4 : 9;
}

function find() {
  const asked = search.value.trim().toLowerCase().replaceAll("_", " "), found = entries.map((one) => ({ ...one, rank: rank(one, asked) })).filter((one) => one.rank < 9);
  shown = found.filter(({ entry }) => order.includes(entry.role));
  shown.sort((a, b) => (asked ? a.rank - b.rank : 0) || order.indexOf(a.entry.role) - order.indexOf(b.entry.role) || a.rank - b.rank || a.entry.name.localeCompare(b.entry.name));
  let group = "";
  chosen = 0;
  const others = asked ? found.filter((one) => !shown.includes(one) && one.rank <= (shown[0]?.rank ?? 9)).slice(0, 3) : [];
  list.replaceChildren(...shown.flatMap(({ entry }, i) => {
    const heading = !asked && entry.role !== group ? h("div", { class: "group-name", role: "presentation" }, ROLES[group = entry.role]) : null;
    const option = h("div", { role: "option", id: `option-${i}`, "aria-selected": "false", onclick: () => end(entry.name), onpointerdown: ({ button, clientX: x, clientY: y }) => { pressed = button === 0 && take ? { name: entry.name, x, y } : null; }, onpointermove: () => mark(i, false) },
      h("span", { "aria-hidden": "true" }, entry.symbol), h("b", {}, entry.name), h("small", {}, entry.summary));
    return heading ? [heading, option] : [option];
  }));
  if (others.length || !shown.length) list.prepend(h("p", { class: "muted" }, shown.length ? "" : "Nothing here has all of these words.",
    others.map(({ entry: { name, role } }) => h("span", {}, " ", h("b", {}, name), " is among the others: Esc, then ", h("kbd", {}, KEY[role]), " at a node."))));
  mark(0);
}

function mark(i, into = true) {
  list.querySelector('[aria-selected="true"]')?.setAttribute("aria-selected", "false");
  chosen = Math.max(0, Math.min(shown.length - 1, i));
  const option = $(`option-${chosen}`);
  $("palette-about").replaceChildren(...(shown[chosen] ? help(shown[chosen].entry) : []));
  if (!option) { search.removeAttribute("aria-activedescendant"); return; }
  option.setAttribute("aria-selected", "true");
  search.setAttribute("aria-activedescendant", option.id);
  if (into) option.scrollIntoView({ block: "nearest" });
}

function end(name) {
  const answer = done;
  done = null;
  if (dialog.open) dialog.close();
  answer?.(name);
}

search.addEventListener("input", find);
search.addEventListener("keydown", (event) => {
  const by = { ArrowDown: 1, ArrowUp: -1, PageDown: 8, PageUp: -8 }[event.key];
  if (by) mark(chosen + by);
  else if (event.key === "Enter" && shown[chosen]) end(shown[chosen].entry.name);
  else return;
  event.preventDefault();
});
dialog.addEventListener("close", () => end(null));
list.addEventListener("pointermove", (event) => {
  if (!pressed || Math.hypot(event.clientX - pressed.x, event.clientY - pressed.y) < FAR) return;
  const { name } = pressed; pressed = null;
  end(null);
  take(name, event);
});
addEventListener("pointerup", () => { pressed = null; });

// Help on an entry: purpose, ports, failure codes.
export function help(entry) {
  return [
    h("h3", {}, `${entry.symbol ?? ""} ${entry.name}`), h("p", {}, capital(entry.summary)),
    ports("Inputs", entry.inputs), ports("Outputs", entry.outputs),
    entry.value && entry.role !== "composite" && entry.value.type !== "nothing" ? ports("Value", [entry.value]) : null,
    ports("Beside it", entry.fields), entry.devices?.length ? h("p", { class: "muted" }, `Devices: ${entry.devices.join(", ")}`) : null,
    entry.failures?.length ? [h("h3", {}, "Fails with"), h("ul", { class: "codes" }, entry.failures.map((one) => h("li", {}, h("code", {}, one.code), one.meaning ? ` ${one.meaning}` : "")))] : null,
  ].flat().filter(Boolean);
}

function ports(title, given) {
  if (!given?.length) return null;
  return [h("h3", {}, title), h("dl", { class: "facts" }, given.map((port) => [h("dt", {}, port.name), h("dd", {}, facts(port), port.help ? h("div", { class: "muted" }, port.help) : null)]))];
}

// "length, needed, 2 cm to 1 m"
export function facts(port) {
  const { min = "", max = "" } = port, range = min !== "" && max !== "" ? `${min} to ${max}` : min !== "" ? `at least ${min}` : max !== "" ? `at most ${max}` : "";
  return [port.type, port.required ? "needed" : port.default !== undefined && port.default !== "" ? `default ${port.default}` : "", range, port.choices?.length ? `one of ${port.choices.slice(0, 8).join(", ")}${port.choices.length > 8 ? " …" : ""}` : ""].filter(Boolean).join(", ");
}

export const capital = (text = "") => (text ? text[0].toUpperCase() + text.slice(1) : "");
