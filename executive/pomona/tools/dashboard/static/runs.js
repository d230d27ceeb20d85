// The runs: a list to filter, open, download and compare, and the form that starts a new one.
import { $, h, seconds, show } from "./dom.js";
import { link } from "./link.js";
import { holdsControl, page, post, randomId, read, say, withToken } from "./page.js";
import { STATUS_WORD } from "./control.js";
import { readRecord, recordAddress } from "./record.js";
import { drawByHand } from "./steps.js";
import { drawStatistics } from "./statistics.js";
import { apply, emptyState, leavesOf } from "./store.js";

let runs = [];
let choices = { trees: [], cells: [] };
let unread = "Reading trees and cells …"; // why there are no choices yet
let starting = false;
const chosen = new Set();
const HEADS = { look: "look", tree: "tree-name", cell: "cell-name", seed: "seed", settings: "settings", took: "took", fruit: "fruit", damage: "damage", record: "record" }; // classes of columns that narrow lists leave out
const RESULT = { success: "good", partial: "warn" }, DAMAGE = { bruised: "bruised", drops: "dropped", lost: "lost", collisions: "hit" };
const FILTERS = { result: (r) => r.outcome ?? r.state, tree: (r) => r.tree, cell: (r) => r.cell };

export const runNamed = (name) => runs.find((r) => r.run === name);
export async function loadRuns() {
  try { runs = await (await read("/api/runs")).json(); } catch { return; }
  drawRuns();
}

export function showRuns(on) {
  $("runs-view").hidden = !on;
  $("run-view").hidden = on;
  document.body.classList.toggle("runs", on);
  $("show-runs").setAttribute("aria-pressed", on);
  if (on) { loadRuns(); loadRequests(); if (!choices.trees.length) loadChoices(); }
}

$("show-runs").addEventListener("click", () => showRuns($("runs-view").hidden));
for (const id of ["filter", ...Object.keys(FILTERS)]) $(`runs-${id}`).addEventListener("input", drawRuns);
$("compare").addEventListener("click", compare);
let width = 0; // of the list, for which the statistics are drawn
new ResizeObserver(([{ contentRect }]) => { if (contentRect.width === width) return; ({ width } = contentRect); if (!$("statistics").hidden) drawRuns(); }).observe($("runs"));
$("show-statistics").addEventListener("click", () => { $("statistics").hidden = !$("statistics").hidden; $("show-statistics").setAttribute("aria-pressed", !$("statistics").hidden); drawRuns(); });
document.addEventListener("open-run", () => showRuns(false));

function drawRuns() {
  const wanted = $("runs-filter").value.toLowerCase().split(/\s+/).filter(Boolean);
  const text = (r) => [r.run, r.outcome ?? r.state, r.tree, r.tree_hash, r.cell, r.cell_kind, `seed ${r.seed}`, r.code, r.message].join(" ").toLowerCase();
  const is = Object.entries(FILTERS).map(([id, of]) => [offer(id, of), of]);
  const rows = runs.filter((r) => wanted.every((word) => text(r).includes(word)) && is.every(([one, of]) => !one || of(r) === one));
  const told = (r) => Object.entries(r.settings ?? {}).map(([name, value]) => `${name} ${value}`).join(", ");
  const row = (r) => h("tr", {},
    h("td", {}, h("input", { type: "checkbox", "aria-label": `compare ${r.run}`, checked: chosen.has(r.run), onchange: (e) => { if (e.target.checked) chosen.add(r.run); else chosen.delete(r.run); mayCompare(); } })),
    h("td", { class: "look" }, h("img", { src: withToken(recordAddress(r.run, "thumbnail")).href, alt: "", loading: "lazy", width: 64, height: 48, onerror: (e) => e.target.remove() })),
    h("td", { class: `outcome ${RESULT[r.outcome] ?? "bad"}` }, `${STATUS_WORD[r.outcome] ?? "?"} ${FILTERS.result(r)}`),
    h("td", { class: "when", title: r.run }, h("button", { class: "moment open-run", "aria-label": r.run, onclick: () => { location.hash = `run=${encodeURIComponent(r.run)}`; showRuns(false); } }, whenOf(r)[1])),
    h("td", { class: "tree-name" }, r.tree ?? ""),
    h("td", { class: "cell-name" }, `${r.cell ?? ""}`), h("td", { class: "number seed" }, r.seed ?? ""), h("td", { class: "words settings" }, told(r)),
    h("td", { class: "number took" }, typeof r.time === "number" ? seconds(r.time) : ""), h("td", { class: "number fruit" }, (r.account?.count || r.truth?.put_away) ?? ""), h("td", { class: `damage ${/\d/.test(damageOf(r)) ? "warn" : ""}` }, damageOf(r)), h("td", { class: "words why-ended" }, r.code ? h("code", {}, r.code) : "", ` ${r.message ?? ""}`),
    h("td", { class: "number record" }, h("a", { href: withToken(recordAddress(r.run, "record")), title: "Download the record" }, `${(r.bytes / 1e6).toFixed(1)} MB`)));
  $("runs-count").textContent = `${rows.length} of ${runs.length}`;
  const days = Map.groupBy(rows.slice(0, 300), (r) => whenOf(r)[0]);
  $("runs").replaceChildren(h("table", {}, h("thead", {}, h("tr", {}, ["⇄", "look", "result", "when", "tree", "cell", "seed", "settings", "took", "fruit", "damage", "why", "record"].map((c) => h("th", { class: HEADS[c] ?? null, title: c === "⇄" ? "choose two to compare" : null }, c)))), h("tbody", {}, [...days].flatMap(([day, some]) => [day ? h("tr", { class: "day" }, h("th", { colspan: 13, scope: "rowgroup" }, day)) : null, ...some.map(row)]))));
  if (!$("statistics").hidden) drawStatistics(rows);
  mayCompare();
}

// What the simulated world counts of a run, or else the robot: its damage in words.
const damageOf = ({ truth, account }) => (truth ? Object.keys(DAMAGE).filter((what) => truth[what]).map((what) => `${truth[what]} ${DAMAGE[what]}`).join(", ") || "none" : account?.pressed ?? "");

// The values of a column, with the number of runs of each; returns the chosen one.
function offer(id, of) {
  const { value } = $(`runs-${id}`), counts = [...Map.groupBy(runs, of)].filter(([one]) => one).sort(([a], [b]) => (a < b ? -1 : 1));
  $(`runs-${id}`).replaceChildren(h("option", { value: "" }, `any ${id}`), ...counts.map(([one, some]) => h("option", { value: one, selected: one === value }, `${one} (${some.length})`)));
  return $(`runs-${id}`).value;
}

// Day and time of a run from the beginning of its name; of another name the name itself.
function whenOf(r) {
  const [, day, time] = /^(\d{4}-\d\d-\d\d)_(\d\d-\d\d-\d\d)/.exec(r.run) ?? [];
  return time ? [day, time.replaceAll("-", ":")] : ["", r.run];
}

function mayCompare() { $("compare").disabled = chosen.size !== 2; }

// ------------------------------------------------------------------------------------------------- comparing

async function summary(name) {
  const s = emptyState();
  const skills = new Map();
  await readRecord(name, (m) => {
    if (m.event !== "Published") apply(s, m);
  });
  for (const span of s.spans) {
    const skill = s.byPath.get(span.path)?.name ?? span.path;
    const sum = skills.get(skill) ?? { starts: 0, time: 0, failures: 0 };
    sum.starts += span.of ?? 1; sum.time += (span.end ?? s.t) - span.start; sum.failures += span.status === "FAILURE" ? 1 : 0;
    skills.set(skill, sum);
  }
  return { s, skills, entry: runNamed(name) ?? {} };
}

async function compare() {
  $("comparison").hidden = false;
  $("comparison").replaceChildren(h("p", { class: "muted" }, "reading …"));
  let a, b;
  try { [a, b] = await Promise.all([...chosen].sort().map(summary)); } catch (error) { $("comparison").replaceChildren(h("p", { class: "bad" }, String(error.message))); return; }
  const row = (what, x, y) => h("tr", { class: x === y ? "" : "differs" }, h("th", {}, what), h("td", {}, x), h("td", {}, y), h("td", {}, x === y ? "" : "≠"));
  const both = (what, of) => row(what, of(a), of(b));
  const settings = ({ s }) => ({ ...s.run?.parameters, ...s.run?.parameter_texts, ...s.run?.settings }); // as written, with units
  const why = (reason) => { const leaves = reason ? leavesOf(reason) : []; const last = leaves.at(-1); return last ? `${last.code} ${last.message}${leaves.length > 1 ? ` (and ${leaves.length - 1} before it)` : ""}` : "–"; };
  const given = [...new Set([a, b].flatMap((x) => Object.keys(settings(x))))];
  const skill = (name) => (x) => { const k = x.skills.get(name); return k ? `${k.starts}×, ${seconds(k.time)}${k.failures ? `, ${k.failures} failed` : ""}` : "–"; };
  $("comparison").replaceChildren(h("div", { class: "head" }, h("h2", {}, "Comparison"), h("label", { class: "check" }, h("input", { type: "checkbox", class: "only", checked: true }), " only differences"), h("button", { class: "primary", onclick: () => { const [one, two] = [...chosen].sort(); location.hash = `run=${encodeURIComponent(one)}&over=${encodeURIComponent(two)}&t=0`; showRuns(false); } }, "Over each other"), h("button", { onclick: () => { $("comparison").hidden = true; } }, "Close")), h("table", {}, h("thead", {}, h("tr", {}, ["of the run", a.s.run?.run ?? "?", b.s.run?.run ?? "?", "same?"].map((c) => h("th", {}, c)))), h("tbody", {},
    both("outcome", (x) => x.s.ended?.outcome ?? "cut off"), both("why", (x) => why(x.s.ended?.reason)),
    both("tree", (x) => `${x.s.run?.tree} ${x.s.run?.tree_hash}`), both("cell", (x) => x.s.run?.cell ?? "–"), both("seed", (x) => String(x.s.run?.seed ?? "–")), ...given.map((name) => both(name, (x) => show(settings(x)[name]))),
    both("duration", (x) => seconds(x.s.ended?.time ?? x.s.t)), both("failures on the way", (x) => String(x.s.failures.length)), both("operator", (x) => x.s.acts.map((m) => `${m.who}: ${m.action}`).join(", ") || "–"),
    [...new Set([...a.skills.keys(), ...b.skills.keys()])].map((name) => both(name, skill(name))))));
  $("comparison").parentElement.scrollTop = 0;
}

// -------------------------------------------------------------------------------------------------- starting

const choose = (id, wanted) => { if ([...$(id).options].some((o) => o.value === wanted)) $(id).value = wanted; };
const chooseCell = () => choose("start-cell", choices.trees.find((c) => c.name === $("start-tree").value)?.cell);
async function loadChoices() {
  try {
    const answer = await read("/api/choices");
    if (!answer.ok) throw new Error(`${answer.status} ${answer.statusText}`);
    choices = await answer.json();
  } catch (error) {
    unread = `Trees and cells cannot be read: ${error.message}`;
    return drawStart();
  }
  const options = (list) => list.map((c) => h("option", { value: c.name, disabled: Boolean(c.problem) }, c.problem ? `${c.name} (cannot be used)` : c.name));
  $("start-tree").replaceChildren(...options(choices.trees));
  $("start-cell").replaceChildren(...options(choices.cells));
  choose("start-tree", choices.first); chooseCell();
  unread = choices.trees.length ? "" : "There is no tree to start.";
  drawFields(); drawStart();
}
// An assistant asks for a run; the operator reads tree, difference and cell, and starts it.
let requests = "";
async function loadRequests() {
  const found = await read("/api/requests").then((answer) => answer.json()).catch(() => []);
  if (JSON.stringify(found) === requests || !Array.isArray(found)) return;
  requests = JSON.stringify(found);
  $("requests").hidden = !found.length;
  $("requests-list").replaceChildren(...found.map((r) => r.problem ? h("p", { class: "wrong" }, `${r.name}: ${r.problem}`) : h("details", { class: "more-fields" }, h("summary", {}, `${r.name}: ${r.tree} on a ${r.kind.toUpperCase()} cell`),
    h("p", {}, r.reason), h("p", { class: "muted" }, [`cell ${r.cell}`, `seed ${r.seed}`, ...Object.entries(r.settings).map(([key, value]) => `${key} = ${value}`), `asked ${r.asked}`].join(" · ")),
    h("h3", {}, r.difference_to ? `Difference to the run ${r.difference_to}` : "No tree of this name has run"), h("pre", { tabindex: 0 }, r.difference || "none"),
    h("h3", {}, "The whole tree"), h("pre", { tabindex: 0 }, r.text),
    h("button", { type: "button", class: "start-request", onclick: () => startRun({ request: r.name, version: r.version, pace: "real", speed: $("start-speed").value, after_cut: $("start-after-cut").value }) }, `Start ${r.name}`))));
  drawStart();
}

// Four fields are in sight; parameters and options are folded, each with its help and its problem.
function drawFields() {
  const tree = choices.trees.find((c) => c.name === $("start-tree").value);
  const cell = choices.cells.find((c) => c.name === $("start-cell").value);
  $("start-about").textContent = tree?.problem ?? tree?.description ?? "";
  $("start-fields").replaceChildren(...[
    group("Parameters of the tree", tree?.parameters ?? []), group("Options of the cell", cell?.options ?? []),
  ].filter(Boolean));
  $("start-kind").textContent = cell?.kind ? `on a ${cell.kind.toUpperCase()} cell` : "";
  judge();
}

function group(title, fields) {
  if (!fields.length) return null;
  const range = (p) => [p.min ? `from ${p.min}` : "", p.max ? `to ${p.max}` : ""].filter(Boolean).join(" ");
  return h("details", { class: "more-fields" }, h("summary", {}, title, " ", h("span", { class: "changes" })), fields.map((p) => h("label", { class: "field setting" }, h("span", {}, p.name, " ", h("small", {}, [p.type, range(p)].filter(Boolean).join(" "))),
    p.choices?.length ? h("select", { "data-setting": p.name, "data-default": p.default }, p.choices.map((v) => h("option", { selected: v === p.default }, v))) : h("input", { "data-setting": p.name, "data-default": p.default, value: p.default, maxlength: 200, autocomplete: "off" }),
    h("span", { class: "help" }, p.help || ""), h("span", { class: "wrong", role: "alert" }))));
}

const changedFields = () => [...$("start-fields").querySelectorAll("[data-setting]")].filter((input) => input.value !== input.dataset.default);
const settingsNow = () => Object.fromEntries(changedFields().map((input) => [input.dataset.setting, input.value]));

// While the operator types, the run's process checks all changed settings, as it would at the start.
let asked = 0, problems = {};
async function judge() {
  const number = ++asked, settings = settingsNow(), form = { tree: $("start-tree").value, cell: $("start-cell").value, settings };
  for (const details of $("start-fields").querySelectorAll("details")) { const n = changedFields().filter((input) => details.contains(input)).length; details.querySelector(".changes").textContent = n ? `${n} changed` : ""; }
  mark({});
  if (!Object.keys(settings).length || !page.token) return;
  await new Promise((done) => { setTimeout(done, 300); });
  for (let tries = 0; tries < 3 && number === asked; tries++) {
    const answer = await post("/api/judge", form, 20000);
    if (number !== asked) return;
    if (answer.problems) { mark(answer.problems); return; }
  }
}

function mark(found) {
  problems = found;
  for (const input of $("start-fields").querySelectorAll("[data-setting]")) {
    const problem = problems[input.dataset.setting] ?? "";
    input.setAttribute("aria-invalid", Boolean(problem));
    input.parentElement.querySelector(".wrong").textContent = problem;
    if (problem) input.closest("details").open = true;
    if (problem && input === document.activeElement) input.parentElement.scrollIntoView({ block: "nearest" });
  }
  drawStart();
}

$("start-tree").addEventListener("change", chooseCell); // before the fields are drawn
for (const id of ["start-tree", "start-cell"]) $(id).addEventListener("change", drawFields);
$("start-fields").addEventListener("input", judge);
$("start-form").addEventListener("submit", async (event) => {
  event.preventDefault();
  await startRun({ tree: $("start-tree").value, cell: $("start-cell").value, seed: Number($("start-seed").value), pace: $("start-pace").value, speed: $("start-speed").value, dry: $("start-dry").checked, after_cut: $("start-after-cut").value, settings: settingsNow() });
});

// Request a run; the page shows it once it is being prepared.
export async function startRun(form) {
  say("starting …");
  starting = true;
  drawStart();
  const pressed = link.clock === null ? null : performance.now() / 1000 + link.clock;
  const answer = page.token ? await post("/api/start", { press: randomId(), pressed, ...form }) : { error: "this page may watch but not act: open the link that was printed" };
  starting = false;
  drawStart();
  if (answer.error) { say(answer.error, "bad"); return; }
  say("connected");
  if (page.recorded) location.hash = "";
  showRuns(false);
}

export function drawStart() {
  const { starts } = page.control;
  $("start-panel").hidden = !starts;
  const blocked = !holdsControl() ? "Take control to start a run." : page.control.start && !page.control.start.problem ? "A run is being prepared." : page.live.whole.run && !page.live.whole.ended ? "A run is going on." : page.live.whole.safeStop ? "Reset the safe state first." : "";
  const why = blocked || (Object.keys(problems).length ? `${Object.keys(problems).join(", ")} cannot be used.` : unread);
  $("start-button").disabled = starting || Boolean(why);
  for (const button of document.querySelectorAll(".start-request")) Object.assign(button, { disabled: starting || Boolean(blocked), title: blocked });
  $("start-hint").textContent = why;
  const cell = choices.cells.find((c) => c.name === $("start-cell").value);
  $("by-hand").hidden = !choices.trees.some((c) => c.name === "recover");
  drawByHand(cell, () => ({ cell: cell.name, seed: 0, pace: "real", settings: Object.fromEntries(Object.entries(settingsNow()).filter(([name]) => cell.options.some((option) => option.name === name))) }), starting ? "starting" : blocked);
}
