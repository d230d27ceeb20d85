// Things in space on a plain canvas: robot, paths, points and meshes in the base frame, turned with the mouse.
import { $, h } from "./dom.js";
import { showAge } from "./pictures.js";

const STYLE = {
  planned: "--planned", executed: "--executed", approach: "--approach", muted: "--hidden", occupied: "--occupied",
  free: "--free", chosen: "--good", ruled_out: "--bad", tried: "--warn", object: "--object", robot: "--robot", tool: "--tool",
};
const MOST_CUBES = 1500; // more cells are drawn as squares
const SUN = normal([0.35, -0.5, 0.8]);
const HOME = { yaw: -0.7, pitch: 0.45, zoom: 1 };

export class SceneView {
  constructor() {
    this.canvas = $("scene");
    Object.assign(this, HOME, { key: null, views: [], robots: [], run: null, box: [[Infinity], [-Infinity]] });
    let drag = null;
    this.canvas.addEventListener("pointerdown", (e) => { drag = [e.clientX, e.clientY]; this.canvas.setPointerCapture(e.pointerId); });
    this.canvas.addEventListener("pointermove", (e) => {
      if (!drag) return;
      this.turn((e.clientX - drag[0]) * 0.01, (e.clientY - drag[1]) * 0.01);
      drag = [e.clientX, e.clientY];
    });
    this.canvas.addEventListener("pointerup", () => { drag = null; });
    this.canvas.addEventListener("wheel", (e) => { e.preventDefault(); this.closer(Math.exp(-e.deltaY * 0.001)); }, { passive: false });
    this.canvas.addEventListener("keydown", (e) => {
      if (e.key === "+" || e.key === "-") { this.closer(e.key === "+" ? 1.15 : 1 / 1.15); return; }
      const step = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] }[e.key];
      if (!step) return;
      this.turn(...step); e.preventDefault(); e.stopPropagation();
    });
    $("scene-home").addEventListener("click", () => { Object.assign(this, HOME); this.draw(); });
    new ResizeObserver(() => this.draw()).observe(this.canvas);
  }

  turn(yaw, pitch) { this.yaw += yaw; this.pitch = Math.max(-0.2, Math.min(1.5, this.pitch + pitch)); this.draw(); }
  closer(factor) { this.zoom = Math.max(0.3, Math.min(12, this.zoom * factor)); this.draw(); }

  update(state) {
    const ages = [...state.scenes.values(), ...state.poses.values()].map((v) => v.t);
    showAge($("scene-age"), ages.length ? Math.max(...ages) : null, state);
    const stamps = (map) => [...map.entries()].map(([topic, v]) => `${topic}@${v.t}`).join("|");
    const key = `${state.run?.run}|${stamps(state.scenes)}|${stamps(state.poses)}|${state.bodies.size}`;
    if (key === this.key) return;
    this.key = key;
    this.views = [...state.scenes.values()];
    this.robots = [...state.poses.entries()].filter(([topic]) => state.bodies.has(topic)).map(([topic, v]) => ({ ...v, bodies: state.bodies.get(topic) }));
    const anything = this.views.length || this.robots.length;
    this.canvas.hidden = !anything;
    $("scene-home").hidden = !anything;
    $("scene-caption").textContent = "";
    if (!anything) { $("scene-legend").replaceChildren(h("p", { class: "empty" }, "Nothing to show yet")); return; }
    const labels = new Map();
    for (const view of this.views) for (const part of [...list(view.lines), ...list(view.points), ...list(view.meshes)]) if (part.label) labels.set(part.label, part.style);
    if (this.robots.some((robot) => robot.trace.length > 1)) labels.set("executed path", "executed");
    $("scene-legend").replaceChildren(...[...labels].map(([label, style]) => { const dot = h("i"); dot.style.background = colour(style); return h("span", {}, dot, label); }));
    $("scene-caption").textContent = $("scene-caption").title = this.views.map((v) => v.caption).filter(Boolean).join(" · ");
    if (this.run !== state.run?.run) { this.run = state.run?.run; this.box = [[Infinity, Infinity, Infinity], [-Infinity, -Infinity, -Infinity]]; }
    const [low, high] = this.box;
    eachPoint(this.views, this.robots, (p, by) => { for (let i = 0; i < 3; i++) { low[i] = Math.min(low[i], p[i] - by); high[i] = Math.max(high[i], p[i] + by); } });
    this.draw();
  }

  // What there is to see, as it lies on the screen. It only grows while one looks from the same side: what moves must not
  // make the rest move.
  extent(turned) {
    const side = `${this.run}|${this.yaw}|${this.pitch}`;
    if (this.side !== side) { this.side = side; this.seen = [Infinity, -Infinity, Infinity, -Infinity]; }
    const { seen } = this;
    eachPoint(this.views, this.robots, (p, by) => {
      const [u, v] = turned(p);
      seen[0] = Math.min(seen[0], u - by); seen[1] = Math.max(seen[1], u + by); seen[2] = Math.min(seen[2], v - by); seen[3] = Math.max(seen[3], v + by);
    });
    return seen;
  }

  draw() {
    const { canvas } = this;
    const ratio = devicePixelRatio || 1;
    const [w, ht] = [canvas.clientWidth, canvas.clientHeight];
    if (!w || !ht) return;
    canvas.width = w * ratio; canvas.height = ht * ratio;
    const g = canvas.getContext("2d");
    g.scale(ratio, ratio);
    if (!this.views.length && !this.robots.length) return;
    const [low, high] = this.box;
    if (!Number.isFinite(low[0])) return;
    const [cy, sy, cp, sp] = [Math.cos(this.yaw), Math.sin(this.yaw), Math.cos(this.pitch), Math.sin(this.pitch)];
    const turned = ([x, y, z]) => { const ry = sy * x + cy * y; return [cy * x - sy * y, cp * z + sp * ry, cp * ry - sp * z]; };
    const [left, right, bottom, top] = this.extent(turned);
    const legend = getComputedStyle($("scene-legend")).position === "absolute" ? 130 : 0;
    const scale = Math.min((w - legend) / (right - left), ht / (top - bottom)) * this.zoom;
    const [cu, cv] = [(left + right) / 2, (bottom + top) / 2];
    const project = (p) => { const [u, v, depth] = turned(p); return [(w + legend) / 2 + (u - cu) * scale, ht / 2 - (v - cv) * scale, depth]; };
    floor(g, low, high, project);
    const things = [];
    const line = (points, tint, width) => { // paths are seen through what hides them
      const ps = points.map(project);
      for (let i = 1; i < ps.length; i++) things.push({ depth: (ps[i][2] + ps[i - 1][2]) / 2 - 0.3, line: [ps[i - 1], ps[i]], tint, width });
    };
    const mesh = (vertices, faces, style) => {
      const shade = shades(style);
      const ps = vertices.map(project);
      for (const [a, b, c] of faces) {
        const area = (ps[b][0] - ps[a][0]) * (ps[c][1] - ps[a][1]) - (ps[b][1] - ps[a][1]) * (ps[c][0] - ps[a][0]);
        if (area >= 0) continue; // it looks away
        things.push({ depth: (ps[a][2] + ps[b][2] + ps[c][2]) / 3, face: [ps[a], ps[b], ps[c]], tint: shade(facing(vertices[a], vertices[b], vertices[c])) });
      }
    };
    for (const robot of this.robots) {
      robot.bodies.forEach((body, i) => { if (robot.poses[i]) mesh(placed(body.vertices, robot.poses[i]), body.faces, body.style); });
      line(robot.trace, colour("executed"), 2.5);
    }
    for (const view of this.views) {
      for (const cloud of list(view.points)) {
        const points = list(cloud.points), tint = colour(cloud.style);
        const cells = cloud.style === "occupied" || cloud.style === "muted";
        if (cells && points.length <= MOST_CUBES) for (const p of points) cube(things, p, cloud.size / 2, project, shades(cloud.style));
        else for (const p of points) { const q = project(p); things.push({ depth: q[2], dot: q, tint, size: Math.max(cells ? 2 : 3.5, cells ? cloud.size * scale : Math.min(6, cloud.size * scale)), round: !cells }); }
      }
      for (const m of list(view.meshes)) if (Array.isArray(m.vertices)) mesh(m.vertices, list(m.faces), m.style);
      for (const l of list(view.lines)) line(list(l.points), colour(l.style), 2.5);
    }
    things.sort((a, b) => b.depth - a.depth);
    for (const thing of things) paint(g, thing);
  }
}

function paint(g, { face, line, dot, tint, width, size, round }) {
  g.fillStyle = g.strokeStyle = tint;
  if (dot) {
    if (round) { g.beginPath(); g.arc(dot[0], dot[1], size / 2, 0, 7); g.fill(); } else g.fillRect(dot[0] - size / 2, dot[1] - size / 2, size, size);
    return;
  }
  const points = face ?? line;
  g.beginPath();
  g.moveTo(points[0][0], points[0][1]);
  for (let i = 1; i < points.length; i++) g.lineTo(points[i][0], points[i][1]);
  g.lineWidth = face ? 0.6 : width;
  g.lineCap = "round";
  if (face) { g.closePath(); g.fill(); }
  g.stroke(); // of a face too: it hides the seams
}

function normal(v) { const n = Math.hypot(...v) || 1; return v.map((x) => x / n); }

// How much a triangle faces the light, 0 to 1.
function facing(a, b, c) {
  const [u, v] = [[b[0] - a[0], b[1] - a[1], b[2] - a[2]], [c[0] - a[0], c[1] - a[1], c[2] - a[2]]];
  const n = normal([u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]);
  return Math.max(0, n[0] * SUN[0] + n[1] * SUN[1] + n[2] * SUN[2]);
}

// Vertices of a body where its pose puts them: position and quaternion x, y, z, w.
function placed(vertices, [px, py, pz, x, y, z, w]) {
  const r = [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), 2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), 2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)];
  return vertices.map(([a, b, c]) => [r[0] * a + r[1] * b + r[2] * c + px, r[3] * a + r[4] * b + r[5] * c + py, r[6] * a + r[7] * b + r[8] * c + pz]);
}

const SIDES = [[[1, 0, 0], [[1, -1, -1], [1, 1, -1], [1, 1, 1], [1, -1, 1]]], [[-1, 0, 0], [[-1, -1, -1], [-1, -1, 1], [-1, 1, 1], [-1, 1, -1]]], [[0, 1, 0], [[-1, 1, -1], [-1, 1, 1], [1, 1, 1], [1, 1, -1]]], [[0, -1, 0], [[-1, -1, -1], [1, -1, -1], [1, -1, 1], [-1, -1, 1]]], [[0, 0, 1], [[-1, -1, 1], [1, -1, 1], [1, 1, 1], [-1, 1, 1]]]];

function cube(things, p, half, project, shade) {
  for (const [n, corners] of SIDES) {
    const ps = corners.map((c) => project([p[0] + c[0] * half, p[1] + c[1] * half, p[2] + c[2] * half]));
    if ((ps[1][0] - ps[0][0]) * (ps[2][1] - ps[0][1]) - (ps[1][1] - ps[0][1]) * (ps[2][0] - ps[0][0]) >= 0) continue;
    things.push({ depth: (ps[0][2] + ps[2][2]) / 2, face: ps, tint: shade(Math.max(0, n[0] * SUN[0] + n[1] * SUN[1] + n[2] * SUN[2])) });
  }
}

// Tints of a style from shadow to light, made once for each style and scheme.
const made = new Map();
function shades(style) {
  const base = colour(style);
  if (!made.has(base)) {
    const rgb = [1, 3, 5].map((i) => parseInt(base.slice(i, i + 2), 16));
    made.set(base, Array.from({ length: 17 }, (_x, i) => { const k = 0.62 + 0.5 * (i / 16); return `rgb(${rgb.map((c) => Math.min(255, Math.round(c * k))).join(",")})`; }));
  }
  const tints = made.get(base);
  return (light) => tints[Math.round(light * 16)];
}

// A grid of 100 mm below everything, and the base frame's axes, so that the eye has something to hold on to.
function floor(g, low, high, project) {
  const z = Math.min(0, low[2]);
  const [x0, y0] = [Math.floor(low[0] * 10) / 10, Math.floor(low[1] * 10) / 10];
  const [x1, y1] = [Math.ceil(high[0] * 10) / 10, Math.ceil(high[1] * 10) / 10];
  const line = (a, b) => { const [p, q] = [project(a), project(b)]; g.beginPath(); g.moveTo(p[0], p[1]); g.lineTo(q[0], q[1]); g.stroke(); };
  g.strokeStyle = colour("--floor"); g.lineWidth = 1;
  for (let i = 0; i <= Math.min(100, Math.round((x1 - x0) * 10)); i++) line([x0 + i / 10, y0, z], [x0 + i / 10, y1, z]);
  for (let i = 0; i <= Math.min(100, Math.round((y1 - y0) * 10)); i++) line([x0, y0 + i / 10, z], [x1, y0 + i / 10, z]);
  g.font = "11px system-ui, sans-serif"; g.lineWidth = 1.5;
  g.strokeStyle = g.fillStyle = colour("--muted");
  for (const [name, end] of [["x", [x0 + 0.1, y0, z]], ["y", [x0, y0 + 0.1, z]], ["z", [x0, y0, z + 0.1]]]) { line([x0, y0, z], end); const p = project(end); g.fillText(name, p[0] + 3, p[1] - 3); }
}

const list = (v) => (Array.isArray(v) ? v : []);

// Every point that should be in sight, and how far what belongs to it reaches [m].
function eachPoint(views, robots, take) {
  const all = (points, by) => { for (const p of list(points)) take(p, by); };
  for (const v of views) { list(v.lines).forEach((l) => all(l.points, 0.02)); list(v.points).forEach((c) => all(c.points, 0.02)); list(v.meshes).forEach((m) => all(m.vertices, 0)); }
  for (const robot of robots) { all(robot.poses, 0.09); all(robot.trace, 0.02); }
}

export function colour(style) {
  return getComputedStyle(document.documentElement).getPropertyValue(style.startsWith("--") ? style : STYLE[style] ?? "--accent").trim();
}
