// Camera images with overlays, and time series.
import uPlot from "./vendor/uplot.js";
import { $, h, put, seconds } from "./dom.js";
import { ageOf, isOver, page, withToken } from "./page.js";
import { expected } from "./store.js";

const LINE = new Set(["found", "refined", "muted", "chosen", "ruled_out"]);
const SVG = "http://www.w3.org/2000/svg";

const svgElement = (tag, attributes) => {
  const element = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  return element;
};

export class CameraView {
  constructor() { this.key = null; this.at = null; }

  // `pictures`: live images of the cameras, where the cell delivers them; the last look is then an inset.
  update(state, pictures = null) {
    const views = [...state.images.entries()], live = [...pictures?.values() ?? []].at(-1) ?? null;
    const key = `${state.run?.run}|${views.map(([topic, v]) => `${topic}@${v.t}`).join("|")}|${Boolean(live)}`;
    if (key !== this.key) {
      this.key = key;
      this.draw(views, live);
    }
    if (live && this.live) { this.live.src = live.image; put($("camera-age"), `live · ${live.device}${this.at === null ? "" : `; last look ${seconds(Math.max(0, ageOf(state, this.at)))} ago`}`); }
    else showAge($("camera-age"), this.at, state);
  }

  draw(views, live) {
    this.live = live ? h("img", { class: "live", alt: `what ${live.device} shows now` }) : null;
    const base = views.filter(([, v]) => v.image).sort(([, a], [, b]) => a.t - b.t).at(-1)?.[1];
    this.at = base ? base.t : null;
    if (!base && live) { $("camera").replaceChildren(h("div", { class: "picture" }, this.live)); return; }
    if (!base) { $("camera").replaceChildren(h("p", { class: "empty" }, "No image yet")); return; }
    const [w, ht] = base.size;
    const svg = svgElement("svg", { viewBox: `0 0 ${w} ${ht}` });
    const shown = views.filter(([, v]) => v.t >= base.t).map(([, v]) => v); // outlines of an earlier picture are not in this one
    for (const view of shown) {
      for (const line of view.lines ?? []) {
        for (const run of runs(line.points)) {
          const shape = svgElement(line.closed ? "polygon" : "polyline", { points: run.map((p) => p.join(",")).join(" "), class: `line ${LINE.has(line.style) ? line.style : "found"}` });
          if (line.label) { const title = svgElement("title", {}); title.textContent = line.label; shape.append(title); }
          svg.append(shape);
        }
      }
      for (const p of Array.isArray(view.points) ? view.points : []) {
        if (p[0] !== null) svg.append(svgElement("circle", { cx: p[0], cy: p[1], r: Math.max(2.5, w / 240), class: "keypoint" }));
      }
    }
    const captions = shown.map((v) => v.caption).filter(Boolean).join(" · ");
    const source = base.image.startsWith("/api/") ? withToken(base.image).href : base.image;
    const look = [h("img", { src: source, alt: `camera image. ${captions}` }), svg];
    $("camera").replaceChildren(h("div", { class: "picture" }, live ? [this.live, h("div", { class: "inset" }, look)] : look), h("p", { class: "caption", title: captions }, captions));
  }
}

function runs(points) {
  const out = [[]];
  for (const p of Array.isArray(points) ? points : []) { if (p[0] === null || p[1] === null) out.push([]); else out.at(-1).push(p); }
  return out.filter((r) => r.length > 1);
}

// Age of the newest item, beside its title. Looks and plans are rare, so an old one is no fault; the header shows silent
// devices, the banner a silent link.
export function showAge(element, t, state) {
  put(element, t === null ? "" : ageOf(state, t) >= 0.5 || isOver(state) ? `${seconds(ageOf(state, t))} ago` : page.at === null && !page.recorded ? "now" : "at this moment");
}

const FINER = { m: ["mm", 1e3], "m/s": ["mm/s", 1e3], "m/s²": ["mm/s²", 1e3] }; // motions of a hand are small
const figure = (v) => (v === null || v === undefined ? "–" : Math.abs(v) < 5e-4 ? "0" : String(Number(v.toPrecision(3))));
const unitOf = (name) => name.match(/\[(.+)\]/)?.[1] ?? "";
const low = matchMedia("(max-height: 860px) and (min-width: 1241px)"); // the curves stand beside the lanes
const tablet = matchMedia("(min-width: 721px) and (max-width: 900px)"); // a table follows them
const height = () => (low.matches ? innerHeight < 780 ? 112 : 153 : innerHeight <= 800 || tablet.matches ? 96 : 160); // 120 px of it for the curves
const LIVE = new Set(["running", "pausing", "paused"]), OLD = 1, NARROW = 150; // s, age from which on a value is an old one; px, width of a chart that leaves less room to the numbers of its axis
const DASHES = [undefined, [8, 3], [3, 3], [10, 3, 2, 3]];

// One chart for each unit of each topic: quantities of different units share no axis. At a moment of a record a page of
// the curves stands still, later samples are paler, and the moment moves over it as an element of its own.
export class PlotsView {
  constructor() {
    Object.assign(this, { charts: new Map(), marks: [], at: null, span: 60, end: 0, page: [0, 0], follows: false });
    for (const button of document.querySelectorAll("[data-span]")) button.addEventListener("click", () => {
      this.span = Number(button.dataset.span);
      this.zoomed = null;
      for (const other of document.querySelectorAll("[data-span]")) other.setAttribute("aria-pressed", other === button);
      this.page = [0, 0];
      this.redraw();
    });
    $("plots").addEventListener("dblclick", () => { if (this.zoomed) { this.zoomed = null; this.page = [0, 0]; this.redraw(); } });
  }

  forget() {
    for (const chart of this.charts.values()) chart.box.remove();
    this.charts.clear();
  }

  // A stretch that was drawn with the pointer fills all curves; a double click shows the span again.
  zoom(u) {
    const { left, width } = u.select;
    if (width < 5) return;
    this.zoomed = [u.posToVal(left, "x"), u.posToVal(left + width, "x")];
    u.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
    this.redraw();
  }

  redraw() {
    for (const chart of this.charts.values()) chart.drawn = "";
    page.dirty = true;
  }

  // The stretch of time that is shown: the newest, or the page with the moment.
  range(follows) {
    const { span, end, at } = this;
    if (this.zoomed) return this.zoomed;
    if (!span || end <= span) return [0, Math.max(0.1, end)];
    if (!follows) { const to = Math.min(end, (at ?? end) + span / 6); return [Math.max(0, to - span), Math.max(to, span)]; }
    const [from, to] = this.page, ahead = to < end ? span / 12 : 0;
    if (to - from === span && at >= from && at <= to - ahead) return this.page;
    const start = Math.max(0, Math.min(end - span, at - span / 3));
    return [start, start + span];
  }

  // `ahead`: the samples of this run, and of the one over it, up to a time after the moment; none where there is no after.
  update(state, at, end, over = null, ahead = null) {
    this.marks = state.marks.filter((mark) => mark.kind !== "state").map((mark) => ({ ...mark, kind: mark.kind === "failure" && expected(state, mark.t) ? "warn" : mark.kind }));
    const marks = this.marks.length;
    Object.assign(this, { end, at, follows: Boolean(ahead), now: at ?? state.t + ageOf(state, state.t), alive: at !== null || LIVE.has(state.state), over: isOver(state) });
    this.page = this.range(this.follows);
    const [from, to] = this.page, shown = ahead ? ahead[0](to) : state.series, others = ahead?.[1] ? ahead[1](to) : over?.series;
    const wanted = new Set();
    for (const [topic, series] of shown) {
      const names = Object.keys(series.values);
      for (const unit of new Set(names.map(unitOf))) {
        const key = `${topic}|${unit}`;
        const mine = names.filter((name) => unitOf(name) === unit);
        wanted.add(key);
        const other = others?.get(topic) ?? null;
        const both = other ? mine.filter((name) => name in other.values) : [];
        if (this.charts.get(key)?.names.length !== mine.length || this.charts.get(key).both.length !== both.length) {
          this.charts.get(key)?.box.remove();
          this.charts.set(key, this.make(topic, unit, mine, series, both, other));
        }
        const chart = this.charts.get(key);
        Object.assign(chart, { series, other });
        const drawn = `${from}|${to}|${series.writes}|${other?.writes}|${marks}`;
        if (chart.drawn !== drawn || chart.of !== series) {
          Object.assign(chart, { drawn, of: series });
          chart.plot.setData(this.data(chart));
          chart.thinned.hidden = !series.thinned.some(([a, b]) => a < to && b > from);
        }
        this.fit(chart);
        this.tell(chart);
      }
    }
    for (const [key, chart] of this.charts) if (!wanted.has(key)) { chart.box.remove(); this.charts.delete(key); }
    $("plots").classList.toggle("empty", this.charts.size === 0);
    $("spans").hidden = this.charts.size === 0;
    showAge($("series-age"), state.series.size ? Math.max(...[...state.series.values()].map((s) => s.last)) : null, state);
    this.point(at);
  }

  // At once, also between two drawings: a chart that is wider than its column would lie under the next one.
  fit({ plot, width }) {
    if (width && (Math.abs(plot.width - width) > 4 || plot.height !== height())) plot.setSize({ width, height: height() });
  }

  // The moment over the curves.
  point(at) {
    const [from, to] = this.page;
    for (const { plot, cursor, room } of this.charts.values()) {
      const x = at === null ? -1 : ((at - from) / (to - from)) * room();
      const place = `translateX(${x.toFixed(1)}px)`;
      if (cursor.dataset.place === place) continue;
      cursor.dataset.place = place;
      cursor.style.transform = place;
      cursor.hidden = at === null || at < from || at > to;
      cursor.classList.toggle("later", this.follows && at < plot.data[0].at(-1));
    }
  }

  // Each quantity's value under the cursor, else at the moment that is shown: grey with its age when it is old, grey when the run has ended.
  tell(chart) {
    const { plot, values, names, both } = chart;
    const last = plot.data[0].length - 1;
    const index = plot.cursor.idx ?? (this.at === null ? last : lowerBound(plot.data[0], this.at + 1e-6) - 1);
    const known = (column) => { let i = index; while (i > 0 && plot.data[column][i] === undefined) i -= 1; return [plot.data[column][i], this.now - plot.data[0][i]]; }; // at times of the other run
    const ages = values.map((element, i) => { const over = both.indexOf(names[i]), [value, age] = known(i + 1); put(element, (this.over && plot.cursor.idx === null ? "–" : figure(value)) + (over < 0 ? "" : ` · ${figure(known(names.length + 1 + over)[0])}`)); return age; });
    const oldest = Math.max(...ages), old = plot.cursor.idx === null && oldest > OLD; put(chart.age, old ? `${seconds(oldest)} ago` : "");
    for (const element of values) element.className = old || !this.alive ? "old" : "";
  }

  // Times and values of the shown part; two runs share the time since their starts.
  data({ series, other, names, both, scale }) {
    const own = thin(series, names, this.page, scale);
    return other && both.length ? uPlot.join([own, thin(other, both, this.page, scale)]) : own;
  }

  make(topic, unit, names, series, both, other) {
    const css = getComputedStyle(document.documentElement);
    const palette = ["--s1", "--s2", "--s3", "--s4", "--s5", "--s6"].map((n) => css.getPropertyValue(n).trim());
    const text = css.getPropertyValue("--muted").trim(), grid = css.getPropertyValue("--floor").trim();
    const axis = { stroke: text, grid: { stroke: grid, width: 1 }, ticks: { show: false }, font: "11px system-ui, sans-serif" };
    const values = names.map(() => h("b", {}, "–"));
    const keys = names.map((name, i) => {
      const sample = svgElement("svg", { viewBox: "0 0 18 8" });
      sample.append(svgElement("path", { d: "M0 4H18", stroke: palette[i % palette.length], "stroke-width": 2, "stroke-dasharray": DASHES[i % 4]?.join(" ") ?? "none" }));
      return h("span", {}, sample, `${name.replace(` [${unit}]`, "")} `, values[i]);
    });
    const [shown, scale] = FINER[unit] ?? [unit, 1];
    const canvas = h("div");
    const thinned = h("small", { class: "thinned", hidden: true, title: "of many samples the least and the greatest are shown; nearer, in a shorter span, all of them are" }, "thinned");
    const age = h("small", { class: "age" });
    const box = h("div", { class: names.length > 2 ? "plot many" : "plot" }, h("h3", {}, `${topic}${shown ? ` [${shown}]` : ""} `, age, thinned), h("div", { class: "keys" }, keys), canvas);
    $("plots").append(box);
    const chart = { box, age, width: 0, names, both, other, thinned, series, values, scale, drawn: "", of: null };
    chart.plot = new uPlot({
      width: box.clientWidth || 300, height: height(), padding: [8, 14, 0, 0], legend: { show: false }, cursor: { sync: { key: "run" }, drag: { x: true, y: false, setScale: false, dist: 5 }, y: false },
      scales: { x: { time: false, range: () => this.page }, y: { range: (_u, low, high) => padded(low, high, chart.series.thresholds, unit, scale) } },
      axes: [{ ...axis, size: 24, values: (_u, v) => v.map((x) => `${Number(x.toFixed(2))} s`), space: 60 }, { ...axis, size: (u) => (u.width < NARROW ? 34 : 48), space: 28, values: (_u, v) => v.map((x) => (x && Math.abs(x) < 1e-3 ? Number(x.toPrecision(2)).toExponential() : String(Number(x.toPrecision(3))))) }],
      series: [{}, ...names.map((_name, i) => ({ stroke: palette[i % palette.length], width: 1.75, dash: DASHES[i % 4], points: { show: false } })), ...both.map((name) => ({ stroke: palette[names.indexOf(name) % palette.length], width: 1.25, dash: [1.5, 3], alpha: 0.85, points: { show: false } }))],
      hooks: { draw: [(u) => annotate(u, chart.series.thresholds, unit, scale, this.marks, css)], setCursor: [() => this.tell(chart)], setSelect: [(u) => this.zoom(u)] },
    }, this.data(chart), canvas);
    chart.cursor = h("i", { class: "plot-cursor", hidden: true });
    chart.plot.over.append(chart.cursor);
    chart.room = () => chart.plot.bbox.width / devicePixelRatio;
    new ResizeObserver(() => { chart.width = box.clientWidth; this.fit(chart); page.dirty = true; }).observe(box); // kept: reading it makes the browser lay the page out
    return chart;
  }
}

// The values' range with a margin; it includes a near threshold.
function padded(low, high, thresholds, unit, scale) {
  if (low === null || high === null) return [0, 1];
  for (const [name, limit] of Object.entries(thresholds)) {
    if (unitOf(name) !== unit) continue;
    const value = limit * scale;
    const wide = Math.max(high - low, Math.abs(high) * 0.5);
    if (value > high && value - high < wide) high = value;
    if (value < low && low - value < wide) low = value;
  }
  const air = (high - low || Math.abs(high) || 1) * 0.06;
  return [low - air, high + air];
}

// Thresholds of this unit, and marks of events.
function annotate(u, thresholds, unit, scale, marks, css) {
  const g = u.ctx;
  const { left, top, width, height } = u.bbox;
  const colour = (name) => css.getPropertyValue(name).trim();
  g.save();
  g.beginPath(); g.rect(left, top, width, height); g.clip();
  g.font = `${11 * devicePixelRatio}px system-ui, sans-serif`;
  g.textAlign = "left"; // uPlot's axes change it
  const vertical = (t, stroke, dash) => { const x = u.valToPos(t, "x", true); g.strokeStyle = stroke; g.setLineDash(dash); g.beginPath(); g.moveTo(x, top); g.lineTo(x, top + height); g.stroke(); };
  g.lineWidth = devicePixelRatio;
  g.globalAlpha = 0.6;
  for (const mark of marks) if (mark.t >= u.scales.x.min && mark.t <= u.scales.x.max) vertical(mark.t, colour({ good: "--good", act: "--accent", warn: "--warn" }[mark.kind] ?? "--bad"), [2, 4]);
  g.globalAlpha = 1;
  for (const [name, value] of Object.entries(thresholds)) {
    if (unitOf(name) !== unit) continue;
    const y = u.valToPos(value * scale, "y", true);
    g.strokeStyle = g.fillStyle = colour("--text");
    g.setLineDash([6, 4]);
    g.beginPath(); g.moveTo(left, y); g.lineTo(left + width, y); g.stroke();
    g.fillText(name.replace(` [${unit}]`, ""), left + 6, y - 4 < top + 11 * devicePixelRatio ? y + 11 * devicePixelRatio : y - 4);
  }
  g.restore();
}

// Thins the shown part for the screen: of every step its least and its greatest sample.
function thin(series, names, [from, to], scale) {
  const first = Math.max(0, lowerBound(series.t, from) - 1), last = Math.min(series.t.length, lowerBound(series.t, to) + 1);
  const step = Math.floor((last - first) / 1500);
  if (step < 2) return [series.t.slice(first, last), ...names.map((name) => series.values[name].slice(first, last).map((v) => (v === null ? null : v * scale)))];
  const t = [], out = names.map(() => []);
  for (let i = first; i < last; i += step) {
    const end = Math.min(last, i + step);
    t.push(series.t[i], series.t[end - 1]);
    names.forEach((name, k) => {
      let low = null, high = null;
      const values = series.values[name];
      for (let j = i; j < end; j++) { const v = values[j]; if (v !== null) { if (low === null || v < low) low = v; if (high === null || v > high) high = v; } }
      out[k].push(low === null ? null : low * scale, high === null ? null : high * scale);
    });
  }
  return [t, ...out];
}

function lowerBound(sorted, value) {
  let low = 0, high = sorted.length;
  while (low < high) { const middle = (low + high) >> 1; if (sorted[middle] < value) low = middle + 1; else high = middle; }
  return low;
}
