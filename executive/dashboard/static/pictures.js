// Camera images with what was found drawn over them, time series, and tables.
import uPlot from "./vendor/uplot.js";
import { $, h, seconds } from "./dom.js";

const LINE = { found: "--warn", refined: "--good", muted: "--muted", chosen: "--good", ruled_out: "--bad" };
export const STALE = 3; // seconds after which a stream that should go on looks stale
const SVG = "http://www.w3.org/2000/svg";

export class CameraView {
  constructor() { this.key = null; }

  update(state) {
    const views = [...state.images.entries()];
    const key = views.map(([topic, v]) => `${topic}@${v.t}`).join("|");
    if (key !== this.key) {
      this.key = key;
      const base = views.filter(([, v]) => v.image).at(-1)?.[1];
      if (!base) { this.age = null; $("camera").replaceChildren(h("p", { class: "muted" }, "no image yet")); return; }
      const [w, ht] = base.size;
      const svg = document.createElementNS(SVG, "svg");
      svg.setAttribute("viewBox", `0 0 ${w} ${ht}`);
      for (const [, view] of views) {
        for (const line of view.lines ?? []) {
          for (const run of runs(line.points)) {
            const shape = document.createElementNS(SVG, line.closed ? "polygon" : "polyline");
            shape.setAttribute("points", run.map((p) => p.join(",")).join(" "));
            shape.setAttribute("class", `line ${LINE[line.style] ? line.style : "found"}`);
            svg.append(shape);
          }
        }
        for (const p of Array.isArray(view.points) ? view.points : []) {
          if (p[0] === null) continue;
          const dot = document.createElementNS(SVG, "circle");
          dot.setAttribute("cx", p[0]); dot.setAttribute("cy", p[1]); dot.setAttribute("r", Math.max(3, w / 200));
          dot.setAttribute("class", "keypoint");
          svg.append(dot);
        }
      }
      this.age = h("span", { class: "age" });
      this.at = base.t;
      $("camera").replaceChildren(h("div", { class: "picture" }, h("img", { src: base.image, alt: "camera image with what was found" }), svg, this.age),
        h("p", { class: "caption" }, views.map(([, v]) => v.caption).filter(Boolean).join(" · ")));
    }
    if (this.age) {
      const old = state.t - this.at;
      const stale = old > STALE && !state.ended;
      this.age.textContent = `${seconds(Math.max(0, old))} old${stale ? ", stale" : ""}`;
      this.age.classList.toggle("stale", stale);
      $("camera").classList.toggle("stale-picture", stale);
    }
  }
}

function runs(points) {
  const out = [[]];
  for (const p of points) { if (p[0] === null || p[1] === null) out.push([]); else out.at(-1).push(p); }
  return out.filter((r) => r.length > 1);
}

// How old a stream is, beside its title.
export function showAge(element, t, state) {
  const old = Math.max(0, state.t - t);
  const stale = old > STALE && !state.ended;
  element.textContent = t === null ? "" : `${seconds(old)} old${stale ? ", stale" : ""}`;
  element.classList.toggle("stale", stale && t !== null);
}

const unitOf = (name) => name.match(/\[(.+)\]/)?.[1] ?? "";

// One chart for each unit of each topic: quantities of different units share no axis.
export class PlotsView {
  constructor() { this.charts = new Map(); this.marks = []; this.at = null; }

  forget() {
    for (const chart of this.charts.values()) chart.box.remove();
    this.charts.clear();
  }

  update(state, at) {
    this.marks = state.marks.filter((mark) => mark.kind !== "state");
    const wanted = new Set();
    for (const [topic, series] of state.series) {
      const names = Object.keys(series.values);
      for (const unit of new Set(names.map(unitOf))) {
        const key = `${topic}|${unit}`;
        const mine = names.filter((name) => unitOf(name) === unit);
        wanted.add(key);
        if (this.charts.get(key)?.names.length !== mine.length) {
          this.charts.get(key)?.box.remove();
          this.charts.set(key, this.make(topic, unit, mine, series));
        }
        const chart = this.charts.get(key);
        chart.series = series;
        if (chart.drawn !== series.writes || chart.of !== series) {
          chart.drawn = series.writes; chart.of = series;
          chart.plot.setData(thin(series, mine));
        } else if (this.at !== at) chart.plot.redraw(false);
        const width = chart.box.clientWidth;
        if (width && Math.abs(chart.plot.width - width) > 8) chart.plot.setSize({ width, height: HEIGHT });
      }
    }
    this.at = at;
    for (const [key, chart] of this.charts) if (!wanted.has(key)) { chart.box.remove(); this.charts.delete(key); }
    $("plots").classList.toggle("empty", this.charts.size === 0);
    showAge($("series-age"), state.series.size ? Math.max(...[...state.series.values()].map((s) => s.last)) : null, state);
  }

  make(topic, unit, names, series) {
    const css = getComputedStyle(document.documentElement);
    const palette = ["--s1", "--s2", "--s3", "--s4", "--s5", "--s6"].map((n) => css.getPropertyValue(n).trim());
    const text = css.getPropertyValue("--text").trim(), grid = css.getPropertyValue("--line").trim();
    const axis = { stroke: text, grid: { stroke: grid, width: 1 }, ticks: { stroke: grid, width: 1 } };
    const box = h("div", { class: "plot" }, h("h3", {}, `${topic}${unit ? ` [${unit}]` : ""}`));
    $("plots").append(box);
    const chart = { box, names, series, drawn: -1, of: null };
    chart.plot = new uPlot({
      width: box.clientWidth || 400, height: HEIGHT, scales: { x: { time: false } }, cursor: { sync: { key: "run" } },
      axes: [{ ...axis, values: (_u, v) => v.map((x) => `${x} s`) }, { ...axis, size: 64, values: (_u, v) => v.map((x) => String(Number(x.toPrecision(3)))) }],
      series: [{ label: "t", value: (_u, v) => (v === null || v === undefined ? "–" : `${v.toFixed(2)} s`) },
        ...names.map((name, i) => ({ label: name.replace(` [${unit}]`, ""), stroke: palette[i % palette.length], width: 2, dash: [undefined, [8, 3], [3, 3], [10, 3, 2, 3]][i % 4], points: { show: false }, value: (_u, v) => (v === null || v === undefined ? "–" : v.toPrecision(3)) }))],
      hooks: { draw: [(u) => annotate(u, chart.series.thresholds, unit, this.marks, this.at, css)] },
    }, thin(series, names), box);
    return chart;
  }
}

const HEIGHT = 170;

// Thresholds of this unit, what happened, and the moment that is shown.
function annotate(u, thresholds, unit, marks, at, css) {
  const g = u.ctx;
  const { left, top, width, height } = u.bbox;
  const colour = (name) => css.getPropertyValue(name).trim();
  g.save();
  g.beginPath(); g.rect(left, top, width, height); g.clip();
  g.font = `${11 * devicePixelRatio}px system-ui, sans-serif`;
  const vertical = (t, stroke, dash) => { const x = u.valToPos(t, "x", true); g.strokeStyle = stroke; g.setLineDash(dash); g.beginPath(); g.moveTo(x, top); g.lineTo(x, top + height); g.stroke(); };
  for (const mark of marks) if (mark.t >= u.scales.x.min && mark.t <= u.scales.x.max) vertical(mark.t, colour(mark.kind === "good" ? "--good" : mark.kind === "act" ? "--accent" : "--bad"), [2, 4]);
  for (const [name, value] of Object.entries(thresholds)) {
    if (unitOf(name) !== unit) continue;
    const y = u.valToPos(value, "y", true);
    g.strokeStyle = g.fillStyle = colour("--text");
    g.setLineDash([6, 4]);
    g.beginPath(); g.moveTo(left, y); g.lineTo(left + width, y); g.stroke();
    g.fillText(name, left + 6, y - 4);
  }
  if (at !== null) vertical(at, colour("--text"), []);
  g.restore();
}

function thin(series, names) {
  const step = Math.max(1, Math.floor(series.t.length / 3000));
  const pick = (values) => (step === 1 ? values : values.filter((_v, i) => i % step === 0));
  return [pick(series.t), ...names.map((name) => pick(series.values[name]))];
}

let tablesKey = "";
export function drawTables(state) {
  const key = `${state.run?.run}|${[...state.tables.values()].map((table) => `${table.caption}${table.rows.length}`).join("|")}`;
  if (key === tablesKey) return;
  tablesKey = key;
  $("tables-panel").hidden = state.tables.size === 0;
  $("tables").replaceChildren(...[...state.tables.values()].map((table) =>
    h("table", {}, h("caption", {}, table.caption), h("thead", {}, h("tr", {}, table.columns.map((c) => h("th", {}, c)))), h("tbody", {}, table.rows.map((row) => h("tr", {}, row.map((cell) => h("td", {}, cell))))))));
}
