// A lane per skill, marks for what happened, and a cursor that scrubs.
import { $, seconds } from "./dom.js";

const RANK = { SUCCESS: "--good", FAILURE: "--bad", RUNNING: "--busy", INVALID: "--muted" };
const MARK = { failure: "--bad", bad: "--bad", good: "--good", act: "--accent", state: "--muted" };

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
    return Math.max(0, Math.min(this.length, ((x - 120) / Math.max(1, this.canvas.clientWidth - 132)) * this.length));
  }

  draw(whole, now) {
    this.length = Math.max(1, whole.t);
    this.now = now;
    const key = `${whole.seq}|${now}|${this.canvas.clientWidth}`;
    if (key === this.key) return;
    this.key = key;
    const css = getComputedStyle(document.documentElement);
    const colour = (name) => css.getPropertyValue(name).trim();
    const lanes = [...new Set(whole.spans.map((s) => s.path))];
    const height = Math.max(60, 22 + lanes.length * 17);
    this.canvas.style.height = `${Math.min(height, 190)}px`;
    const ratio = devicePixelRatio || 1;
    const w = this.canvas.clientWidth, ht = this.canvas.clientHeight;
    this.canvas.width = w * ratio; this.canvas.height = ht * ratio;
    const g = this.canvas.getContext("2d");
    g.scale(ratio, ratio);
    g.font = "11px system-ui, sans-serif";
    const x = (t) => 120 + (t / this.length) * (w - 132);
    const step = (ht - 20) / Math.max(1, lanes.length);
    lanes.forEach((path, i) => {
      g.fillStyle = colour("--text");
      g.fillText((whole.byPath.get(path)?.name ?? path).slice(0, 18), 4, 16 + i * step + step / 2);
    });
    for (const span of whole.spans) {
      const i = lanes.indexOf(span.path);
      g.fillStyle = colour(RANK[span.status] ?? "--muted");
      g.fillRect(x(span.start), 14 + i * step, Math.max(2, x(span.end ?? whole.t) - x(span.start)), Math.max(3, step - 4));
    }
    for (const mark of whole.marks) {
      g.fillStyle = colour(MARK[mark.kind] ?? "--muted");
      g.beginPath(); g.moveTo(x(mark.t), 12); g.lineTo(x(mark.t) - 4, 3); g.lineTo(x(mark.t) + 4, 3); g.fill();
    }
    g.strokeStyle = colour("--text");
    g.lineWidth = 1.5;
    g.beginPath(); g.moveTo(x(now), 0); g.lineTo(x(now), ht); g.stroke();
    $("shown").textContent = `${seconds(now)} of ${seconds(this.length)}`;
  }
}
