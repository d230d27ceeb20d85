// Camera images with what was found drawn over them, time series, and tables.
import uPlot from "./vendor/uplot.js";
import { $, h } from "./dom.js";

const LINE = { found: "--warn", refined: "--good", muted: "--muted", chosen: "--good", ruled_out: "--bad" };
const SVG = "http://www.w3.org/2000/svg";

export class CameraView {
  constructor() { this.key = ""; }

  update(state) {
    const views = [...state.images.entries()];
    const key = views.map(([topic, v]) => `${topic}@${v.t}`).join("|");
    if (key !== this.key) {
      this.key = key;
      const base = views.filter(([, v]) => v.image).at(-1)?.[1];
      if (!base) { $("camera").replaceChildren(h("p", { class: "muted" }, "no image yet")); return; }
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
      this.age.textContent = `${old.toFixed(1)} s old`;
      this.age.classList.toggle("stale", old > 2 && !state.ended);
    }
  }
}

function runs(points) {
  const out = [[]];
  for (const p of points) { if (p[0] === null || p[1] === null) out.push([]); else out.at(-1).push(p); }
  return out.filter((r) => r.length > 1);
}

export class PlotsView {
  constructor() { this.plots = new Map(); this.drawn = new Map(); }

  update(state) {
    for (const topic of [...this.plots.keys()]) if (!state.series.has(topic)) { this.plots.get(topic).box.remove(); this.plots.delete(topic); this.drawn.delete(topic); }
    for (const [topic, series] of state.series) {
      const names = Object.keys(series.values);
      const signature = names.join("|") + Object.keys(series.thresholds).join("|");
      let plot = this.plots.get(topic);
      if (!plot || plot.signature !== signature) {
        plot?.box.remove();
        plot = this.make(topic, series, names, signature);
        this.plots.set(topic, plot);
      }
      if (this.drawn.get(topic) !== series.t.length) {
        this.drawn.set(topic, series.t.length);
        plot.chart.setData(thin(series, names));
      }
      const width = $("plots").clientWidth;
      if (width && Math.abs(plot.chart.width - width) > 8) plot.chart.setSize({ width, height: 190 });
    }
    if (!state.series.size && !$("plots").hasChildNodes()) $("plots").append(h("p", { class: "muted" }, "no samples yet"));
    else if (state.series.size) $("plots").querySelector("p.muted")?.remove();
  }

  make(topic, series, names, signature) {
    const css = getComputedStyle(document.documentElement);
    const palette = ["--s1", "--s2", "--s3", "--s4", "--s5", "--s6"].map((n) => css.getPropertyValue(n).trim());
    const text = css.getPropertyValue("--text").trim(), grid = css.getPropertyValue("--line").trim();
    const axis = { stroke: text, grid: { stroke: grid }, ticks: { stroke: grid } };
    const units = names.map((n) => n.match(/\[(.+)\]/)?.[1] ?? "");
    const scales = [...new Set(units)];
    const box = h("div", { class: "plot" }, h("h3", {}, topic));
    $("plots").append(box);
    const chart = new uPlot({
      width: $("plots").clientWidth || 600, height: 190, scales: { x: { time: false } }, cursor: { sync: { key: "run" } },
      axes: [{ ...axis, values: (_u, v) => v.map((x) => `${x} s`) }, ...scales.slice(0, 2).map((unit, i) => ({ ...axis, scale: unit || "y", side: i === 0 ? 3 : 1, label: unit, size: 46, labelSize: 16 }))],
      series: [{ label: "t", value: (_u, v) => (v === null ? "" : `${v.toFixed(2)} s`) }, ...names.map((label, i) => ({ label, scale: units[i] || "y", stroke: palette[i % palette.length], width: 1.5, dash: i > 2 ? [6, 4] : undefined, value: (_u, v) => (v === null || v === undefined ? "" : v.toPrecision(3)) }))],
      hooks: { draw: [(u) => thresholds(u, series.thresholds, scales[0] || "y", text)] },
    }, thin(series, names), box);
    return { chart, box, signature };
  }
}

function thresholds(u, lines, scale, colour) {
  const g = u.ctx;
  for (const [name, value] of Object.entries(lines)) {
    const y = u.valToPos(value, scale, true);
    if (y < u.bbox.top || y > u.bbox.top + u.bbox.height) continue;
    g.save();
    g.strokeStyle = colour; g.fillStyle = colour; g.globalAlpha = 0.6; g.setLineDash([5, 5]);
    g.beginPath(); g.moveTo(u.bbox.left, y); g.lineTo(u.bbox.left + u.bbox.width, y); g.stroke();
    g.fillText(name, u.bbox.left + 6, y - 4);
    g.restore();
  }
}

function thin(series, names) {
  const step = Math.max(1, Math.floor(series.t.length / 3000));
  const pick = (values) => (step === 1 ? values : values.filter((_v, i) => i % step === 0));
  return [pick(series.t), ...names.map((name) => pick(series.values[name]))];
}

export function drawTables(state) {
  $("tables-panel").hidden = state.tables.size === 0;
  $("tables").replaceChildren(...[...state.tables.values()].map((table) =>
    h("table", {}, h("caption", {}, table.caption), h("thead", {}, h("tr", {}, table.columns.map((c) => h("th", {}, c)))), h("tbody", {}, table.rows.map((row) => h("tr", {}, row.map((cell) => h("td", {}, cell))))))));
}
