// Things in space on a plain canvas: lines, points and meshes in the base frame, turned with the mouse.
import { $, h } from "./dom.js";
import { showAge } from "./pictures.js";

const STYLE = {
  planned: "--planned", executed: "--executed", approach: "--approach", muted: "--hidden", occupied: "--text",
  free: "--free", chosen: "--good", ruled_out: "--bad", tried: "--warn", fruit: "--fruit", robot: "--muted",
};

export class SceneView {
  constructor() {
    this.canvas = $("scene");
    this.yaw = -0.9; this.pitch = 0.5; this.zoom = 1; this.key = null;
    let drag = null;
    this.canvas.addEventListener("pointerdown", (e) => { drag = [e.clientX, e.clientY]; this.canvas.setPointerCapture(e.pointerId); });
    this.canvas.addEventListener("pointermove", (e) => {
      if (!drag) return;
      this.yaw += (e.clientX - drag[0]) * 0.01;
      this.pitch = Math.max(-1.5, Math.min(1.5, this.pitch + (e.clientY - drag[1]) * 0.01));
      drag = [e.clientX, e.clientY];
      this.draw();
    });
    this.canvas.addEventListener("pointerup", () => { drag = null; });
    this.canvas.addEventListener("wheel", (e) => { e.preventDefault(); this.zoom *= Math.exp(-e.deltaY * 0.001); this.draw(); }, { passive: false });
    this.canvas.addEventListener("keydown", (e) => {
      if (e.key === "+" || e.key === "-") { this.zoom *= e.key === "+" ? 1.15 : 1 / 1.15; this.draw(); return; }
      const step = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] }[e.key];
      if (!step) return;
      this.yaw += step[0]; this.pitch += step[1]; this.draw(); e.preventDefault(); e.stopPropagation();
    });
    new ResizeObserver(() => this.draw()).observe(this.canvas);
  }

  update(state) {
    showAge($("scene-age"), state.scenes.size ? Math.max(...[...state.scenes.values()].map((v) => v.t)) : null, state);
    const key = `${state.run?.run}|${[...state.scenes.entries()].map(([topic, v]) => `${topic}@${v.t}`).join("|")}`;
    if (key === this.key) return;
    this.key = key;
    this.views = [...state.scenes.values()];
    this.canvas.hidden = !this.views.length;
    if (!this.views.length) { $("scene-legend").replaceChildren("nothing to show yet"); return; }
    const labels = new Map();
    for (const view of this.views) for (const part of [...list(view.lines), ...list(view.points), ...list(view.meshes)]) if (part.label) labels.set(part.label, part.style);
    $("scene-legend").replaceChildren(...[...labels].map(([label, style]) => { const dot = h("i"); dot.style.background = colour(style); return h("span", {}, dot, label); }),
      ...this.views.map((v) => v.caption ? h("p", { class: "caption" }, v.caption) : null).filter(Boolean));
    this.draw();
  }

  draw() {
    const { canvas } = this;
    const ratio = devicePixelRatio || 1;
    const [w, ht] = [canvas.clientWidth, canvas.clientHeight];
    if (!w || !ht) return;
    canvas.width = w * ratio; canvas.height = ht * ratio;
    const g = canvas.getContext("2d");
    g.scale(ratio, ratio);
    if (!this.views?.length) return;
    const [low, high] = bounds(this.views);
    if (!Number.isFinite(low[0])) return;
    const centre = low.map((v, i) => (v + high[i]) / 2);
    const size = Math.max(0.2, Math.hypot(...high.map((v, i) => v - low[i])));
    const scale = (Math.min(w, ht) * 1.0 * this.zoom) / size;
    const [cy, sy, cp, sp] = [Math.cos(this.yaw), Math.sin(this.yaw), Math.cos(this.pitch), Math.sin(this.pitch)];
    const project = ([x, y, z]) => {
      const [dx, dy, dz] = [x - centre[0], y - centre[1], z - centre[2]];
      const [rx, ry] = [cy * dx - sy * dy, sy * dx + cy * dy];
      return [w / 2 + rx * scale, ht / 2 - (cp * dz + sp * ry) * scale, cp * ry - sp * dz];
    };
    floor(g, low, high, project, colour("--line"));
    const things = [];
    for (const view of this.views) {
      for (const cloud of list(view.points)) {
        const tint = colour(cloud.style); // asked once: thousands of points share it
        for (const p of list(cloud.points)) { const q = project(p); things.push([q[2], "p", q, tint, Math.max(2, cloud.size * scale)]); }
      }
      for (const mesh of list(view.meshes)) {
        if (!Array.isArray(mesh.vertices)) continue;
        const vs = mesh.vertices.map(project);
        const base = colour(mesh.style);
        for (const [a, b, c] of list(mesh.faces)) {
          const area = (vs[b][0] - vs[a][0]) * (vs[c][1] - vs[a][1]) - (vs[b][1] - vs[a][1]) * (vs[c][0] - vs[a][0]);
          if (area > 0) continue;
          things.push([(vs[a][2] + vs[b][2] + vs[c][2]) / 3, "f", [vs[a], vs[b], vs[c]], base]);
        }
      }
      for (const line of list(view.lines)) {
        const ps = list(line.points).map(project), tint = colour(line.style);
        for (let i = 1; i < ps.length; i++) things.push([(ps[i][2] + ps[i - 1][2]) / 2 - 0.01, "l", [ps[i - 1], ps[i]], tint]);
      }
    }
    things.sort((a, b) => b[0] - a[0]);
    for (const [, kind, q, stroke, r] of things) {
      g.fillStyle = g.strokeStyle = stroke;
      if (kind === "p") { g.globalAlpha = 0.55; g.fillRect(q[0] - r / 2, q[1] - r / 2, r, r); g.globalAlpha = 1; }
      else { g.lineWidth = kind === "l" ? 2.5 : 0.5; g.beginPath(); g.moveTo(q[0][0], q[0][1]); for (const p of q.slice(1)) g.lineTo(p[0], p[1]); if (kind === "f") { g.closePath(); g.fill(); } g.stroke(); }
    }
  }
}

// A grid of 100 mm below everything, and the base frame's axes, so that the eye has something to hold on to.
function floor(g, low, high, project, stroke) {
  const [x0, y0] = [Math.floor(low[0] * 10) / 10, Math.floor(low[1] * 10) / 10];
  const [x1, y1] = [Math.ceil(high[0] * 10) / 10, Math.ceil(high[1] * 10) / 10];
  const line = (a, b) => { const [p, q] = [project(a), project(b)]; g.beginPath(); g.moveTo(p[0], p[1]); g.lineTo(q[0], q[1]); g.stroke(); };
  g.strokeStyle = stroke; g.lineWidth = 1;
  for (let i = 0; i <= Math.min(100, Math.round((x1 - x0) * 10)); i++) line([x0 + i / 10, y0, low[2]], [x0 + i / 10, y1, low[2]]);
  for (let i = 0; i <= Math.min(100, Math.round((y1 - y0) * 10)); i++) line([x0, y0 + i / 10, low[2]], [x1, y0 + i / 10, low[2]]);
  const css = getComputedStyle(document.documentElement);
  const ends = [["x", [x0 + 0.1, y0, low[2]]], ["y", [x0, y0 + 0.1, low[2]]], ["z", [x0, y0, low[2] + 0.1]]];
  g.font = "11px system-ui, sans-serif"; g.lineWidth = 2;
  for (const [name, end] of ends) { g.strokeStyle = g.fillStyle = css.getPropertyValue("--muted"); line([x0, y0, low[2]], end); const p = project(end); g.fillText(name, p[0] + 3, p[1] - 3); }
}

const list = (v) => (Array.isArray(v) ? v : []);

function bounds(views) {
  const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
  const add = (ps) => { for (const p of list(ps)) for (let i = 0; i < 3; i++) { low[i] = Math.min(low[i], p[i]); high[i] = Math.max(high[i], p[i]); } };
  for (const v of views) { list(v.lines).forEach((l) => add(l.points)); list(v.points).forEach((c) => add(c.points)); list(v.meshes).forEach((m) => add(m.vertices)); }
  return [low, high];
}

export function colour(style) {
  return getComputedStyle(document.documentElement).getPropertyValue(style.startsWith("--") ? style : STYLE[style] ?? "--accent").trim();
}
