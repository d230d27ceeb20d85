// A lane per skill, marks for what happened, and a cursor that scrubs.
import { $, seconds } from "./dom.js";

const MOST_LANES = 60; // those that ran last
const LEFT = 150;
const RANK = { SUCCESS: "--good", FAILURE: "--bad", RUNNING: "--busy", INVALID: "--muted" };
const MARK = { failure: "--bad", bad: "--bad", good: "--good", act: "--accent", state: "--muted" };

// Never colour alone: failures are crosses, operators diamonds, the rest triangles.
const path = (g, points) => { g.beginPath(); points.forEach(([x, y], i) => (i ? g.lineTo(x, y) : g.moveTo(x, y))); g.fill(); };
const triangle = (g, x) => path(g, [[x, 12], [x - 4, 4], [x + 4, 4]]);
const cross = (g, x) => { g.strokeStyle = g.fillStyle; g.lineWidth = 2; for (const d of [-1, 1]) { g.beginPath(); g.moveTo(x - 4, 8 - 4 * d); g.lineTo(x + 4, 8 + 4 * d); g.stroke(); } };
const diamond = (g, x) => path(g, [[x, 3], [x + 5, 8], [x, 13], [x - 5, 8]]);
const SHAPE = { failure: cross, bad: cross, good: triangle, state: triangle, act: diamond };

export class Timeline {
  constructor(onScrub) {
    this.canvas = $("timeline");
    this.onScrub = onScrub;
    this.length = 1;
    let down = false;
    const seek = (event) => this.onScrub(this.timeAt(event.offsetX));
    this.canvas.addEventListener("pointerdown", (e) => { down = true; this.canvas.setPointerCapture(e.pointerId); seek(e); });
    this.canvas.addEventListener("pointermove", (e) => { if (down) seek(e); });
    this.canvas.addEventListener("pointerup", () => { down = false; });
    this.canvas.addEventListener("keydown", (e) => {
      const step = { ArrowLeft: -0.1, ArrowRight: 0.1, PageUp: -1, PageDown: 1 }[e.key];
      if (step === undefined && e.key !== "Home" && e.key !== "End") return;
      this.onScrub(e.key === "Home" ? 0 : e.key === "End" ? this.length : Math.max(0, this.now + step * (e.shiftKey ? 10 : 1)));
      e.preventDefault();
    });
    new ResizeObserver(() => { this.key = ""; }).observe(this.canvas);
  }

  timeAt(x) {
    return Math.max(0, Math.min(this.length, ((x - LEFT) / Math.max(1, this.canvas.clientWidth - LEFT - 12)) * this.length));
  }

  draw(whole, now) {
    this.length = Math.max(0.1, whole.t);
    this.now = now;
    const key = `${whole.seq}|${now}|${this.canvas.clientWidth}`;
    if (key === this.key) return;
    this.key = key;
    const css = getComputedStyle(document.documentElement);
    const colour = (name) => css.getPropertyValue(name).trim();
    const lanes = [...new Set(whole.spans.map((s) => s.path))].slice(-MOST_LANES);
    const lane = new Map(lanes.map((path, i) => [path, i]));
    this.canvas.style.height = `${Math.max(50, 24 + lanes.length * 16)}px`;
    const ratio = devicePixelRatio || 1;
    const w = this.canvas.clientWidth, ht = this.canvas.clientHeight;
    this.canvas.width = w * ratio; this.canvas.height = ht * ratio;
    const g = this.canvas.getContext("2d");
    g.scale(ratio, ratio);
    g.font = "11px system-ui, sans-serif";
    const x = (t) => LEFT + (t / this.length) * (w - LEFT - 12);
    const step = (ht - 20) / Math.max(1, lanes.length);
    lanes.forEach((path, i) => {
      g.fillStyle = colour("--text");
      const name = whole.byPath.get(path)?.name ?? path;
      g.fillText(name.length > 24 ? `${name.slice(0, 23)}…` : name, 4, 16 + i * step + step / 2);
    });
    for (const span of whole.spans) {
      const i = lane.get(span.path);
      if (i === undefined) continue;
      g.fillStyle = colour(RANK[span.status] ?? "--muted");
      g.fillRect(x(span.start), 14 + i * step, Math.max(2, x(span.end ?? whole.t) - x(span.start)), Math.max(3, step - 4));
    }
    for (const mark of whole.marks) {
      g.fillStyle = colour(MARK[mark.kind] ?? "--muted");
      SHAPE[mark.kind]?.(g, x(mark.t));
    }
    g.strokeStyle = colour("--text");
    g.lineWidth = 1.5;
    g.beginPath(); g.moveTo(x(now), 0); g.lineTo(x(now), ht); g.stroke();
    $("shown").textContent = `${seconds(now)} of ${seconds(this.length)}`;
    const near = whole.marks.findLast((mark) => mark.t <= now + 1e-9);
    $("mark").textContent = near ? `${seconds(near.t)}: ${near.text}` : "";
    this.canvas.setAttribute("aria-valuenow", now.toFixed(1));
    this.canvas.setAttribute("aria-valuemax", this.length.toFixed(1));
    this.canvas.setAttribute("aria-valuetext", $("shown").textContent);
  }
}
