// Many runs at a glance: success, force and time over the runs, failures by code with a picture of the newest. Of a day, a
// campaign, a tree: whatever the list's filter leaves.
import uPlot from "./vendor/uplot.js";
import { $, h, seconds } from "./dom.js";
import { withToken } from "./page.js";
import { recordAddress } from "./record.js";

const WINDOW = 20; // runs over which a rate is taken
const MOST_PICTURES = 4; // of one code
const CHARTS = [
  { title: `success, of the last ${WINDOW} runs`, unit: "%", line: true, of: (_run, i, ended) => { const some = judged(ended.slice(0, i + 1)).slice(-WINDOW); return some.length ? (100 * some.filter((r) => r.outcome === "success").length) / some.length : null; } },
  { title: "peak force", unit: "N", of: (run) => known(run.truth?.peak_force_n) ?? known(Object.entries(run.peaks ?? {}).find(([name]) => name.endsWith("[N]"))?.[1]) },
  { title: "time of the run", unit: "s", of: (run) => known(run.time) },
];
let charts = [];

// An operator's stop is no result of the task.
function judged(ended) { return ended.filter((run) => run.outcome !== "stopped"); }

function known(v) { return typeof v === "number" && Number.isFinite(v) ? v : null; }

export function drawStatistics(runs) {
  const panel = $("statistics");
  for (const chart of charts) chart.destroy();
  charts = [];
  const ended = runs.filter((run) => run.outcome).sort((a, b) => a.wall_time - b.wall_time || (a.run < b.run ? -1 : 1));
  if (!ended.length) { panel.replaceChildren(h("p", { class: "empty" }, "No run that has ended.")); return; }
  const good = ended.filter((run) => run.outcome === "success").length;
  const { length } = judged(ended), stops = ended.length - length, [low, high] = wilson(good, Math.max(1, length));
  const figures = [
    ["success", length ? `${((100 * good) / length).toFixed(0)} %` : "–", `${good} of ${length}; 95 % interval ${low.toFixed(0)} to ${high.toFixed(0)} %${stops ? `; ${stops} stopped by an operator not counted` : ""}`],
    ["peak force", figure(median(ended.map(CHARTS[1].of)), "N"), "median; the true one of simulated cells, of others the first measured force"],
    ["time", figure(median(ended.map(CHARTS[2].of)), "s"), "median of a run"],
  ];
  const boxes = CHARTS.map(() => h("div"));
  panel.replaceChildren(
    h("div", { class: "figures" }, figures.map(([what, value, words]) => h("div", { class: "figure" }, h("span", { class: "muted" }, what), h("b", {}, value), h("span", { class: "muted" }, words)))),
    h("div", { class: "trends" }, CHARTS.map((chart, i) => h("section", {}, h("h3", {}, `${chart.title} [${chart.unit}], by run`), boxes[i]))),
    failures(judged(ended)));
  CHARTS.forEach((chart, i) => charts.push(draw(chart, ended, boxes[i])));
}

function draw(chart, ended, box) {
  const css = getComputedStyle(document.documentElement), colour = (name) => css.getPropertyValue(name).trim();
  const axis = { stroke: colour("--muted"), grid: { stroke: colour("--floor"), width: 1 }, ticks: { show: false }, font: "11px system-ui, sans-serif" };
  const values = ended.map((run, i) => chart.of(run, i, ended));
  return new uPlot({
    width: box.clientWidth || 300, height: 120, padding: [8, 12, 0, 0], legend: { show: false }, cursor: { sync: { key: "runs" }, drag: { x: false, y: false } },
    scales: { x: { time: false }, y: { range: chart.unit === "%" ? [0, 100] : (_u, low, high) => [0, (high ?? 1) * 1.1 || 1] } },
    axes: [{ ...axis, size: 24, values: (_u, v) => v.map((x) => (Number.isInteger(x) ? String(x) : "")) }, { ...axis, size: 44 }],
    series: [{}, { stroke: colour("--s1"), width: chart.line ? 1.75 : 0, points: { show: !chart.line || ended.length < 3, size: 5, fill: colour("--s1") } }],
  }, [ended.map((_run, i) => i + 1), values], box);
}

function failures(ended) {
  const codes = new Map();
  for (const run of ended) if (run.code) { if (!codes.has(run.code)) codes.set(run.code, []); codes.get(run.code).push(run); }
  const rows = [...codes].sort(([, a], [, b]) => b.length - a.length);
  if (!rows.length) return h("p", { class: "good" }, "✓ None of them has failed.");
  const link = (run) => h("a", { href: `#run=${encodeURIComponent(run.run)}`, title: `${run.run}: ${run.message ?? ""}`, onclick: () => document.dispatchEvent(new CustomEvent("open-run")) }, run.picture ? h("img", { src: withToken(recordAddress(run.run, "picture")).href, alt: `picture of ${run.run}`, loading: "lazy", width: 140 }) : run.run);
  return h("table", { class: "codes" }, h("thead", {}, h("tr", {}, ["why", "runs", "the newest"].map((c) => h("th", {}, c)))), h("tbody", {}, rows.map(([code, some]) => h("tr", {},
    h("td", {}, h("code", {}, code)), h("td", {}, `${some.length} of ${ended.length}`), h("td", { class: "pictures" }, some.slice(-MOST_PICTURES).reverse().map(link))))));
}

const figure = (value, unit) => (value === null ? "–" : unit === "s" ? seconds(value) : `${Number(value.toPrecision(3))} ${unit}`);

function median(values) {
  const sorted = values.filter((v) => v !== null).sort((a, b) => a - b);
  return sorted.length ? (sorted[(sorted.length - 1) >> 1] + sorted[sorted.length >> 1]) / 2 : null;
}

// Wilson's interval of a ratio, in percent.
function wilson(good, all) {
  const z = 1.96, p = good / all, centre = (p + (z * z) / (2 * all)) / (1 + (z * z) / all);
  const half = (z * Math.sqrt((p * (1 - p)) / all + (z * z) / (4 * all * all))) / (1 + (z * z) / all);
  return [100 * Math.max(0, centre - half), 100 * Math.min(1, centre + half)];
}
