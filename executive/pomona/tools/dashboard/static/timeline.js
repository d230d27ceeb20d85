// A lane per skill, marks of events, and a cursor that scrubs; the wheel zooms.
import { $, put, seconds } from "./dom.js";
import { page } from "./page.js";
import { expected } from "./store.js";

const MOST_LANES = 60;
const INSTANT = 0.001; // seconds below which a skill takes no lane of its own
const WIDE = 150, NARROW = 104, RIGHT = 14, TOP = 30;
const LABEL = 52; // px that a time on the ruler takes
const LANE = 15;
const RANK = { SUCCESS: "--good", FAILURE: "--bad", RUNNING: "--busy", INVALID: "--idle" };
const MARK = { failure: "--bad", bad: "--bad", good: "--good", act: "--accent", state: "--muted" };

const failed = (span) => span.status === "FAILURE" && !span.decided;

// Running, stopped and failed skills come first, the newest on top; skills that took no time share the last lane.
function lanesOf(s) {
  const about = new Map();
  for (const span of s.spans) {
    const of = about.get(span.path) ?? { path: span.path, name: s.byPath.get(span.path)?.name ?? span.path, time: 0, first: span.start, rank: "", since: -1 };
    of.time += (span.end ?? s.t) - span.start;
    if (span.end === null || span.halted || failed(span)) Object.assign(of, { since: span.end ?? Infinity, rank: span.end === null ? "busy" : !span.halted && expected(s, span.end) ? "warn" : "bad" });
    about.set(span.path, of);
  }
  const all = [...about.values()].sort((a, b) => b.since - a.since || a.first - b.first);
  const lanes = all.filter((of) => of.time >= INSTANT || of.rank).slice(0, MOST_LANES), rest = all.filter((of) => !lanes.includes(of));
  const lane = new Map(lanes.map(({ path }, i) => [path, i]));
  for (const { path } of rest) lane.set(path, lanes.length);
  return { lanes: rest.length ? [...lanes, { name: rest.length === 1 ? rest[0].name : `${rest.length} skills, 0 ms`, rank: "muted" }] : lanes, lane };
}

// Shapes beside colours: failures are crosses, operators diamonds, the rest triangles.
const shape = (g, points) => { g.beginPath(); points.forEach(([x, y], i) => (i ? g.lineTo(x, y) : g.moveTo(x, y))); g.fill(); };
const triangle = (g, x, y) => shape(g, [[x, y + 4], [x - 4, y - 4], [x + 4, y - 4]]);
const cross = (g, x, y) => { g.strokeStyle = g.fillStyle; g.lineWidth = 2; for (const d of [-1, 1]) { g.beginPath(); g.moveTo(x - 4, y - 4 * d); g.lineTo(x + 4, y + 4 * d); g.stroke(); } };
const diamond = (g, x, y) => shape(g, [[x, y - 5], [x + 5, y], [x, y + 5], [x - 5, y]]);
const SHAPE = { failure: cross, bad: cross, good: triangle, state: triangle, act: diamond };

export class Timeline {
  constructor(onScrub) {
    this.canvas = $("timeline");
    this.onScrub = onScrub;
    this.part = null; // the stretch that is shown, or null: all of it
    this.first = 0; // number of the first lane below the ruler
    let down = false;
    const seek = (event) => this.onScrub(this.timeAt(event.offsetX));
    this.canvas.addEventListener("pointerdown", (e) => { down = true; this.canvas.setPointerCapture(e.pointerId); seek(e); });
    this.canvas.addEventListener("pointermove", (e) => { if (down) seek(e); });
    this.canvas.addEventListener("pointerup", () => { down = false; });
    this.canvas.addEventListener("wheel", (e) => {
      if (Math.abs(e.deltaX) < Math.abs(e.deltaY) && !e.ctrlKey && !e.shiftKey && e.offsetX < this.left) { this.scroll(Math.sign(e.deltaY)); e.preventDefault(); return; } // over the names it scrolls the lanes
      e.preventDefault();
      if (e.shiftKey || Math.abs(e.deltaX) > Math.abs(e.deltaY)) this.pan((e.deltaX || e.deltaY) / 500);
      else this.zoom(Math.exp(e.deltaY * 0.002), this.timeAt(e.offsetX));
    }, { passive: false });
    this.canvas.addEventListener("keydown", (e) => {
      if (e.key === "+" || e.key === "-") { this.zoom(e.key === "+" ? 0.7 : 1 / 0.7, this.now); return; }
      const step = { ArrowLeft: -0.1, ArrowRight: 0.1, PageUp: -1, PageDown: 1 }[e.key];
      if (step === undefined && e.key !== "Home" && e.key !== "End") return;
      this.onScrub(e.key === "Home" ? 0 : e.key === "End" ? this.length : Math.max(0, Math.min(this.length, this.now + step * (e.shiftKey ? 10 : 1))));
      e.preventDefault();
    });
    $("whole").addEventListener("click", () => { this.part = null; this.key = ""; this.draw(); });
    const measure = () => { Object.assign(this, { key: "", width: this.canvas.clientWidth, tall: this.canvas.parentElement.clientHeight }); page.dirty = true; };
    measure(); // kept: reading them makes the browser lay the page out
    const sizes = new ResizeObserver(measure);
    for (const element of [this.canvas, this.canvas.parentElement]) sizes.observe(element);
  }

  // Read anew each time: two keys may come before the next frame.
  get now() { return page.at ?? page.whole.t; }
  get length() { return Math.max(0.1, page.whole.t, page.over?.whole.t ?? 0); }
  get left() { return this.width < 520 ? NARROW : WIDE; }
  get room() { return Math.max(1, Math.floor((this.tall - TOP) / LANE)); } // lanes in sight
  get shown() { return this.part ?? [0, this.length]; }

  zoom(factor, around) {
    const [from, to] = this.shown;
    const wide = Math.max(0.5, (to - from) * factor);
    if (wide >= this.length) this.part = null;
    else {
      const start = Math.max(0, Math.min(this.length - wide, around - ((around - from) / (to - from)) * wide));
      this.part = [start, start + wide];
    }
    this.key = "";
    this.draw();
  }

  pan(share) {
    if (!this.part) return;
    const wide = this.part[1] - this.part[0];
    const start = Math.max(0, Math.min(this.length - wide, this.part[0] + share * wide));
    this.part = [start, start + wide];
    this.key = "";
    this.draw();
  }

  timeAt(x) {
    const [from, to] = this.shown;
    return Math.max(0, Math.min(this.length, from + ((x - this.left) / Math.max(1, this.canvas.clientWidth - this.left - RIGHT)) * (to - from)));
  }

  scroll(lanes) {
    this.first = Math.max(0, Math.min(this.first + lanes, this.lanes.length - this.room));
    this.key = "";
    this.draw();
  }

  // Scroll to the lane of the skill that started last before the moment; once, so that another stretch can be looked at.
  follow(whole, now) {
    const path = whole.spans.findLast((span) => span.start <= now + 1e-9 && (span.halted || failed(span) || (span.end ?? Infinity) - span.start >= INSTANT))?.path, i = this.lane.get(path) ?? 0, { room } = this;
    const key = `${path}|${i}|${room}`;
    if (key === this.followed) return;
    this.followed = key;
    const first = Math.max(0, Math.min(i, Math.max(this.first, i - room + 1), this.lanes.length - room));
    if (first !== this.first) { this.first = first; this.key = ""; }
    this.canvas.dataset.first = first;
  }

  draw() {
    const { whole } = page, { now } = this;
    if (this.part && (now < this.part[0] || now > this.part[1])) { // the cursor stays in sight
      const wide = this.part[1] - this.part[0];
      const start = Math.max(0, Math.min(this.length - wide, now - wide / 2));
      this.part = [start, start + wide];
    }
    this.point(now);
    this.tell(whole, now);
    const key = `${page.over?.name}|${whole.seq}|${whole.t.toFixed(2)}|${this.part}|${this.width}|${whole.run?.run}`;
    if (key !== this.key) {
      Object.assign(this, lanesOf(whole));
      this.canvas.style.height = `${TOP + Math.max(1, this.lanes.length) * LANE + 4}px`;
    }
    this.follow(whole, now);
    if (key === this.key) return; // the cursor moves over what is drawn
    this.key = key;
    $("whole").hidden = !this.part;
    const css = getComputedStyle(document.documentElement);
    const colour = (name) => css.getPropertyValue(name).trim();
    const { lanes, lane, first, room } = this;
    const ratio = devicePixelRatio || 1;
    const w = this.canvas.clientWidth, ht = this.canvas.clientHeight;
    this.canvas.width = w * ratio; this.canvas.height = ht * ratio;
    const g = this.canvas.getContext("2d");
    g.scale(ratio, ratio);
    g.font = "12px system-ui, sans-serif";
    const [from, to] = this.shown;
    const x = (t) => this.left + ((t - from) / (to - from)) * (w - this.left - RIGHT);
    this.ruler(g, x, from, to, ht, colour);
    const laneTop = (i) => TOP + (i - first) * LANE, most = Math.floor(this.left / 6.8);
    g.textBaseline = "middle";
    lanes.slice(first, first + room).forEach(({ name, rank }, i) => {
      g.fillStyle = colour(rank ? `--${rank}` : "--text");
      g.fillText(name.length > most ? `${name.slice(0, most - 1)}…` : name, 2, laneTop(first + i) + LANE / 2);
    });
    const below = Math.max(0, lanes.length - first - room);
    g.fillStyle = colour("--muted");
    if (first || below) g.fillText(`${first ? `↑ ${first} ` : ""}${below ? `↓ ${below} ` : ""}more`, 2, 11);
    g.save();
    g.beginPath(); g.rect(this.left - 6, 0, w - this.left - RIGHT + 12, ht); g.clip();
    for (const span of whole.spans) {
      const i = lane.get(span.path);
      const end = span.end ?? whole.t;
      if (i === undefined || i < first || i >= first + room || end < from || span.start > to) continue; // no part of a lane
      g.fillStyle = colour(span.halted ? "--bad" : span.decided ? "--muted" : failed(span) && expected(whole, end) ? "--warn" : RANK[span.status] ?? "--muted");
      const wide = Math.max(2.5, x(end) - x(span.start));
      g.globalAlpha = span.of ? 0.5 : 1; // it stands for several
      g.fillRect(x(span.start), laneTop(i) + 2, wide, LANE - 4);
      if (span.halted) g.fillRect(x(end) - 3, laneTop(i), 6, LANE);
      if (failed(span) && wide > 8) { g.strokeStyle = colour("--panel"); g.lineWidth = 1.5; g.beginPath(); g.moveTo(x(end) - 7, laneTop(i) + 4.5); g.lineTo(x(end) - 2, laneTop(i) + LANE - 4.5); g.moveTo(x(end) - 2, laneTop(i) + 4.5); g.lineTo(x(end) - 7, laneTop(i) + LANE - 4.5); g.stroke(); }
    }
    g.globalAlpha = 1;
    for (const span of page.over?.whole.spans ?? []) { // the second run's, thin, below those of the same name
      const i = lane.get(span.path), end = span.end ?? page.over.whole.t;
      if (i === undefined || i < first || i >= first + room || end < from || span.start > to) continue; // no part of a lane
      g.fillStyle = colour("--text");
      g.fillRect(x(span.start), laneTop(i) + LANE - 4, Math.max(2, x(end) - x(span.start)), 2);
    }
    for (const mark of whole.marks) {
      if (mark.t < from || mark.t > to) continue;
      g.fillStyle = colour(mark.kind === "failure" && expected(whole, mark.t) ? "--warn" : MARK[mark.kind] ?? "--muted");
      SHAPE[mark.kind]?.(g, x(mark.t), 21);
    }
    g.restore();
    this.point(now);
  }

  // The cursor is an element of its own: sixty times a second it moves, and nothing is drawn anew.
  point(now) {
    const [from, to] = this.shown;
    const x = this.left + ((now - from) / (to - from)) * (this.width - this.left - RIGHT);
    $("timeline-cursor").style.transform = `translateX(${x.toFixed(1)}px)`;
  }

  ruler(g, x, from, to, height, colour) {
    const rough = (to - from) / Math.max(2, Math.min(10, (x(to) - x(from)) / LABEL));
    const step = [0.1, 0.2, 0.5, 1, 2, 5, 10, 30, 60, 120, 300, 600, 1800, 3600].find((s) => s >= rough) ?? 7200;
    g.strokeStyle = colour("--floor"); g.lineWidth = 1; g.fillStyle = colour("--muted"); g.textBaseline = "alphabetic"; g.textAlign = "center";
    for (let t = Math.ceil(from / step) * step; t <= to + 1e-9; t += step) {
      g.beginPath(); g.moveTo(x(t), 14); g.lineTo(x(t), height); g.stroke();
      const words = t >= 60 ? `${Math.floor(t / 60)}:${String(Math.round(t % 60)).padStart(2, "0")}` : `${Number(t.toFixed(1))} s`;
      if (x(t) < this.canvas.clientWidth - 30) g.fillText(words, x(t), 11);
    }
    g.textAlign = "left";
  }

  tell(whole, now) {
    put($("shown"), `${seconds(now)} of ${seconds(this.length)}`);
    const near = whole.marks.findLast((mark) => mark.t <= now + 1e-9);
    put($("mark"), near ? `${seconds(near.t)}: ${near.text}` : "");
    this.canvas.setAttribute("aria-valuenow", now.toFixed(1));
    this.canvas.setAttribute("aria-valuemax", this.length.toFixed(1));
    this.canvas.setAttribute("aria-valuetext", $("shown").textContent);
  }
}
