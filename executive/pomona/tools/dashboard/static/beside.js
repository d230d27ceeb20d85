// Processes beside the page: the editor of a tree, and the search for the change that cures a failed simulated run.
import { $, h } from "./dom.js";
import { link } from "./link.js";
import { page, post, read, say } from "./page.js";

const LOOK = 700; // ms between two looks at a search
const STARTING = 60000; // ms that an editor may take to begin
const SIMULATED = new Set(["simulated", "mock"]); // cells on which a run is repeated from the page
const stem = (path) => path.split(/[\\/]/).at(-1).replace(/\.ya?ml$/, "");

// Open the editor of a tree in a page of its own. It is opened at once: browsers block a page that opens later.
async function edit(button, form) {
  const tab = window.open("", "_blank");
  if (tab) tab.opener = null;
  button.disabled = true;
  say("starting the editor …");
  const answer = await post("/api/edit", form, STARTING);
  button.disabled = false;
  if (tab && answer.link) { tab.location.replace(answer.link); say("connected"); return; }
  tab?.close();
  say(answer.error ?? "the browser blocks new pages: allow them for this one", "bad");
}

$("edit-tree").addEventListener("click", () => { const path = page.whole.run.tree_path; edit($("edit-tree"), { tree: stem(path), path }); });
$("start-edit").addEventListener("click", () => edit($("start-edit"), { tree: $("start-tree").value }));

let search = null, asking = false, key = "";

async function look() {
  asking = true;
  try { search = await (await read("/api/why")).json(); } catch { search ??= {}; }
  asking = false;
  page.dirty = true;
  if (search.over === false) setTimeout(look, LOOK);
}

async function begin(run) {
  const answer = await post("/api/why", { run });
  if (answer.error) { say(answer.error, "bad"); return; }
  if (!asking) look();
}

export function drawBeside(s) {
  $("start-edit").hidden = $("edit-tree").hidden = !page.control.starts || !link.armed;
  $("edit-tree").hidden ||= !s.run?.tree_path;
  const run = s.run && s.ended?.outcome === "failure" ? page.recorded ?? s.run.run : "";
  if (run && search === null && !asking) look();
  const now = JSON.stringify([run, s.run?.cell_kind, link.armed, search]);
  if (now === key) return;
  key = now;
  $("cure").replaceChildren(...(run ? cure(run, s.run.cell_kind) : []).filter(Boolean));
}

function cure(run, kind) {
  if (!SIMULATED.has(kind)) return [h("p", { class: "muted" }, "The smallest change that cures it, by simulation: ", h("code", {}, `pomona why ${run}`))];
  const mine = search?.run === run ? search : null, ask = link.armed ? h("button", { onclick: () => begin(run), title: "Repeat the run in simulation with one change at a time, for a minute" }, "Why did it fail?") : null;
  if (!mine) return [ask];
  if (!mine.over) return [h("button", { onclick: () => post("/api/why", { stop: true }), disabled: !link.armed }, "◼ Stop"), h("span", { role: "status" }, mine.line || "Repeating the run in simulation …")];
  return mine.answer ? found(mine.answer) : [ask, h("span", { role: "status" }, mine.line || "The search was ended.")];
}

// The answer of `pomona why --json`.
function found({ original, cures, lucky, sentence }) {
  if (original.repeats === false) return [h("p", { role: "status" }, "The failure does not repeat: without a change the run succeeds now.")];
  if (!cures.length && !lucky.length) return [h("p", { role: "status" }, `In simulation, ${sentence}.`)];
  const more = (value, before, unit) => (value === null || before === null ? "–" : `${value < before ? "−" : "+"}${Math.abs(value - before).toFixed(1)} ${unit}`);
  const row = (one) => h("tr", {}, h("td", { title: one.file || null }, one.file ? one.sentence.replace(one.file, one.file.split(/[\\/]/).at(-1)) : one.sentence), h("td", { class: "number" }, `${one.successes} of ${one.seeds}`), h("td", { class: "number" }, more(one.time_s, original.time_s, "s")), h("td", { class: "number" }, more(one.force_n, original.force_n, "N")), h("td", {}, one.why));
  return [h("table", { "aria-label": "changes that cure the run" }, h("thead", {}, h("tr", {}, ["change", "succeeds", "time", "force", "why"].map((word) => h("th", {}, word)))), h("tbody", {}, [...cures, ...lucky].map(row))), h("p", { class: "muted", role: "status" }, `In simulation; ${sentence}.`)];
}
