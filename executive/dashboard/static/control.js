// The control bar, the banner of the safe state, and the header: what is acknowledged, never what was clicked.
import { $, h } from "./dom.js";
import { act, holdsControl, page } from "./page.js";

export const STATUS_WORD = { success: "✓", failure: "✗", stopped: "■", error: "■", running: "▶", paused: "❚❚" };
const KIND = { simulated: "SIMULATED", emulated: "EMULATED", real: "REAL", frames: "RECORDED FRAMES", mock: "MOCK" };

$("who").value = localStorage.getItem("pomona-who") || "";
$("who").addEventListener("change", (event) => localStorage.setItem("pomona-who", event.target.value));
for (const button of document.querySelectorAll("[data-action]")) button.addEventListener("click", () => act(button.dataset.action));

export function drawControl(s) {
  const live = !page.recorded;
  const mine = live && holdsControl();
  const running = s.state === "running" && !s.ended, paused = s.state === "paused" && !s.ended;
  const enabled = { take: live && !mine, release: mine, pause: mine && running, resume: mine && paused, step: mine && paused, stop: mine && (running || paused), acknowledge: mine && Boolean(s.ended) };
  for (const button of document.querySelectorAll("[data-action]")) {
    const action = button.dataset.action;
    if (action in enabled) button.disabled = !enabled[action];
  }
  $("live-control").hidden = !live;
  $("record-control").hidden = live;
  const { held_by: holder, viewers } = page.control;
  $("holder").textContent = mine ? "You hold control." : holder ? `${holder} holds control.` : "Nobody holds control.";
  $("viewers").textContent = viewers > 1 ? `${viewers} watch.` : "";
  const last = s.acts.findLast((a) => a.action !== "note");
  $("ack").hidden = !live;
  $("ack").textContent = `Acknowledged: ${s.ended ? s.ended.outcome : s.state}${s.because && !s.ended ? ` (${s.because})` : ""}${last ? ` · last action: ${last.action.replace("_", " ")} by ${last.who}` : ""}`;
  const breaks = [...s.breaks].map((path) => s.byPath.get(path)?.name ?? path);
  $("breaks").textContent = breaks.length ? `Breakpoints: ${breaks.join(", ")}` : "";
  $("latched").hidden = !s.safeStop || !live;
  $("latched-reason").textContent = s.safeStop ?? "";
  $("reset-hint").textContent = mine ? "" : "Take control to reset it.";
}

export function drawHeader(s) {
  const kind = s.run?.cell_kind ?? "";
  $("kind").textContent = KIND[kind] ?? "NO CELL";
  $("kind").dataset.kind = kind;
  $("run").textContent = s.run ? `${s.run.tree} · seed ${s.run.seed} · cell ${s.run.cell}` : "no run yet";
  $("run").title = s.run ? `${s.run.run}\ntree ${s.run.tree_path} (${s.run.tree_hash})\ncell ${s.run.cell_path}` : "";
  const state = s.ended ? s.ended.outcome : s.state;
  $("state").textContent = `${STATUS_WORD[state] ?? ""} ${state}`.trim();
  $("state").dataset.state = state;
  $("state").title = s.because;
  const still = page.beat && !page.recorded && s.state === "running" && !s.ended ? (performance.now() - page.beat.moved) / 1000 : 0;
  $("clock").textContent = `${(page.at ?? s.t).toFixed(1)} s${still > 3 ? ` · no tick for ${still.toFixed(0)} s` : ""}`;
  $("clock").classList.toggle("stale", still > 3);
  const key = [...s.links].join("|");
  if ($("links").dataset.key !== key) {
    $("links").dataset.key = key;
    $("links").replaceChildren(...[...s.links].map(([device, link]) => h("span", { class: link === "ok" ? "link ok" : "link bad", title: `${device}: ${link}` }, `${link === "ok" ? "●" : "▲"} ${device}${link === "ok" ? "" : `: ${link}`}`)));
  }
  document.title = s.run ? `${STATUS_WORD[state] ?? ""} ${s.run.tree} – Pomona` : "Pomona";
}
