// Things in space, in the base frame: robot, paths, fruit, map, the look's depth points. Turned with mouse and keys; a click on
// a thing selects the node that published it, and the things of the chosen node are highlighted.
import { $, h } from "./dom.js";
import { withToken } from "./page.js";
import { showAge } from "./pictures.js";

const STYLE = {
  planned: "--planned", executed: "--executed", approach: "--approach", muted: "--hidden", occupied: "--occupied",
  free: "--free", chosen: "--good", ruled_out: "--bad", tried: "--warn", object: "--object", robot: "--robot", tool: "--tool",
};
const MOST_CUBES = 20000; // more cells are drawn as points
const HOME = { yaw: -0.7, pitch: 0.45 };
const FIELD = 40; // degrees
const FRAMED = new Set(["sheet", "rod", "line"]); // kinds of things that are wholly in the picture; points and cells may leave it
const AIR = 1.04; // around them
const CLICK = 4; // px between down and up that are still a click
const OFF_PATH = 0.004; // m by which a drawn path may pass beside a point of it
const MOST_CORNERS = 500; // of an executed path, the newest
const ROOM = 640; // px, width of a scene whose legend stands open
const ROD = 0.0015; // m, radius of a drawn path
let three = null; // the library, once there is something to show

export class SceneView {
  constructor(onPick) {
    this.canvas = $("scene");
    Object.assign(this, { onPick, key: null, topics: new Map(), robots: new Map(), run: null, selected: null, mine: true, problem: "", unfolded: null });
    $("scene-home").addEventListener("click", () => { this.mine = true; this.seen = null; this.home(); });
    $("scene-legend").firstElementChild.addEventListener("click", () => { this.unfolded = !$("scene-legend").open; });
    new ResizeObserver(() => this.draw()).observe(this.canvas.parentElement);
    this.canvas.addEventListener("keydown", (e) => this.turnedByKey(e));
    let down = null;
    this.canvas.addEventListener("pointerdown", (e) => { down = [e.clientX, e.clientY]; });
    this.canvas.addEventListener("click", (e) => { if (down && Math.hypot(e.clientX - down[0], e.clientY - down[1]) < CLICK) this.pick(e); });
  }

  update(state, selected = null, over = null) {
    const ages = [...state.scenes.values(), ...state.poses.values()].map((v) => v.t);
    showAge($("scene-age"), ages.length ? Math.max(...ages) : null, state);
    const views = shownViews(state);
    const robots = [...state.poses].filter(([topic]) => state.bodies.has(topic));
    const ways = [...over?.poses ?? []].map(([, { trace }]) => trace).filter((trace) => trace.length > 1);
    const key = `${state.run?.run}|${views.map(([topic, v]) => `${topic}@${v.t}`).join("|")}|${robots.map(([topic, v]) => `${topic}@${v.t}`).join("|")}|${state.bodies.size}|${ways.map((way) => way.length)}|${selected}|${Boolean(three)}`;
    if (key === this.key) return;
    this.key = key;
    const anything = views.length || robots.length;
    this.canvas.hidden = !anything || Boolean(this.problem);
    $("scene-home").hidden = !anything;
    $("scene-legend").hidden = this.canvas.hidden;
    $("scene-empty").hidden = !this.canvas.hidden;
    if (this.canvas.hidden) { $("scene-caption").textContent = ""; $("scene-empty").textContent = this.problem || "Nothing to show yet"; if (!anything) this.clear(); return; }
    if (!three) { load().then(() => { this.key = null; this.update(state, selected, over); }, (error) => { this.problem = `The scene cannot be drawn: ${error.message}`; this.key = null; }); return; }
    if (!this.begin()) return;
    if (this.run !== state.run?.run) { this.clear(); this.run = state.run?.run; this.mine = true; }
    this.selected = selected;
    this.place(new Map(views), state);
    for (const [topic, { poses, trace, t }] of robots) this.placeRobot(topic, state.bodies.get(topic), poses, trace, t);
    for (const topic of [...this.robots.keys()]) if (!robots.some(([other]) => other === topic)) { this.drop(this.robots.get(topic).group); this.robots.delete(topic); }
    if (this.ways) this.drop(this.ways);
    this.ways = new three.Group();
    for (const way of ways) this.ways.add(rodOf(corners(way), "muted"));
    this.scene.add(this.ways);
    for (const { group, node } of this.topics.values()) emphasize(group, selected && node === selected);
    this.tell(views, robots, ways);
    if (this.mine) this.home(); else this.draw();
  }

  begin() {
    if (this.renderer) return true;
    try { this.renderer = new three.WebGLRenderer({ canvas: new OffscreenCanvas(1, 1), antialias: hasGraphicsCard(), alpha: true }); } catch {
      this.problem = "This browser has no WebGL: the scene cannot be drawn.";
      this.key = null;
      return false;
    }
    this.shown = this.canvas.getContext("bitmaprenderer");
    this.scene = new three.Scene();
    this.camera = new three.PerspectiveCamera(FIELD, 1, 0.01, 50);
    this.camera.up.set(0, 0, 1);
    const sun = new three.DirectionalLight(0xffffff, 1.9);
    sun.position.set(0.35, -0.5, 0.8);
    this.scene.add(new three.AmbientLight(0xffffff, 1.7), sun);
    this.controls = new three.OrbitControls(this.camera, this.canvas);
    this.controls.addEventListener("change", () => this.draw());
    this.controls.addEventListener("start", () => { this.mine = false; });
    return true;
  }

  clear() {
    for (const { group } of [...this.topics.values(), ...this.robots.values()]) this.drop(group);
    this.topics.clear();
    this.robots.clear();
    this.seen = null;
    if (this.renderer) this.draw();
  }

  drop(group) {
    this.scene.remove(group);
    group.traverse((thing) => { thing.geometry?.dispose(); });
  }

  place(views, state) {
    for (const [topic, view] of views) {
      const before = this.topics.get(topic);
      if (before?.t === view.t) continue;
      if (before) this.drop(before.group);
      const group = built(view);
      group.userData = { node: view.node, what: `${state.byPath.get(view.node)?.name ?? ""} ${topic}`.trim() };
      this.topics.set(topic, { group, t: view.t, node: view.node });
      this.scene.add(group);
      if (view.cloud) cloudOf(view).then((points) => { if (points && this.topics.get(topic)?.group === group) { group.add(points); this.draw(); } });
    }
    for (const topic of [...this.topics.keys()]) if (!views.has(topic)) { this.drop(this.topics.get(topic).group); this.topics.delete(topic); }
  }

  placeRobot(topic, bodies, poses, trace, t) {
    let robot = this.robots.get(topic);
    if (robot?.bodies !== bodies) {
      if (robot) this.drop(robot.group);
      const group = new three.Group();
      const parts = bodies.map((body) => { const mesh = meshOf(body); group.add(mesh); return mesh; });
      robot = { group, bodies, parts, line: null, t: null };
      this.robots.set(topic, robot);
      this.scene.add(group);
    }
    if (robot.t === t) return;
    robot.t = t;
    robot.parts.forEach((part, i) => { const p = poses[i]; part.visible = Boolean(p); if (p) { part.position.set(p[0], p[1], p[2]); part.quaternion.set(p[3], p[4], p[5], p[6]); } });
    if (robot.line) { robot.group.remove(robot.line); robot.line.geometry.dispose(); robot.line = null; }
    if (trace.length > 1) { robot.line = rodOf(corners(trace), "executed"); robot.group.add(robot.line); }
  }

  tell(views, robots, ways) {
    const labels = new Map();
    for (const [, view] of [...views].reverse()) for (const part of [...list(view.lines), ...list(view.points), ...list(view.meshes)]) if (part.label) labels.set(part.label, part.style);
    if (robots.some(([, { trace }]) => trace.length > 1)) labels.set("executed path", "executed");
    if (ways.length) labels.set("path of the run over it", "muted");
    if (views.some(([, view]) => view.cloud)) labels.set("depth of the look", null);
    const words = JSON.stringify([...labels]);
    if ($("scene-legend").dataset.key !== words) {
      $("scene-legend").dataset.key = words;
      $("scene-labels").replaceChildren(...[...labels].map(([label, style]) => { const dot = h("i"); dot.style.background = style ? colour(style) : "conic-gradient(#c8452f, #2f86c9, #11703f, #c8452f)"; return h("span", {}, dot, label); }));
    }
    $("scene-caption").textContent = $("scene-caption").title = views.map(([, v]) => (v.cloud ? "" : v.caption)).filter(Boolean).join(" · ");
  }

  // From the initial direction, as near as robot, fruit and paths are wholly in the picture. The view only grows during a run: a
  // moving arm does not move it.
  home() {
    if (!this.renderer) return;
    const box = new three.Box3(), things = [];
    for (const { group } of [...this.topics.values(), ...this.robots.values()]) { box.union(new three.Box3().setFromObject(group)); group.traverse((thing) => { if (thing.visible && FRAMED.has(thing.userData.kind)) things.push(new three.Box3().setFromObject(thing)); }); }
    if (box.isEmpty()) return;
    const { yaw, pitch } = HOME;
    const toward = new three.Vector3(Math.sin(yaw) * Math.cos(pitch), -Math.cos(yaw) * Math.cos(pitch), Math.sin(pitch)), right = new three.Vector3(Math.cos(yaw), Math.sin(yaw), 0), up = toward.clone().cross(right);
    if (!this.seen) Object.assign(this, { seen: new three.Box3(), far: 0.1 }); // along these three
    const ends = [];
    for (const { min, max } of things.length ? things : [box]) for (const x of [min.x, max.x]) for (const y of [min.y, max.y]) for (const z of [min.z, max.z]) {
      const corner = new three.Vector3(x, y, z);
      ends.push(new three.Vector3(corner.dot(right), corner.dot(up), corner.dot(toward)));
    }
    for (const end of ends) this.seen.expandByPoint(end);
    const at = this.seen.getCenter(new three.Vector3());
    for (const { x, y, z } of ends) this.far = Math.max(this.far, z - at.z + AIR * Math.max(Math.abs(y - at.y), Math.abs(x - at.x) / (this.camera.aspect || 1)) / Math.tan((FIELD / 2) * Math.PI / 180));
    this.controls.target.set(0, 0, 0).addScaledVector(right, at.x).addScaledVector(up, at.y).addScaledVector(toward, at.z);
    this.camera.position.copy(this.controls.target).addScaledVector(toward, this.far);
    this.floor(box);
    this.controls.update();
    this.draw();
  }

  floor(box) {
    const wide = Math.ceil(Math.max(box.max.x - box.min.x, box.max.y - box.min.y, 0.4) * 10) / 10 + 0.2;
    const tint = colour("--floor"), low = Math.min(0, box.min.z);
    const key = `${wide}|${low.toFixed(3)}|${tint}`;
    if (this.floorKey === key) return;
    this.floorKey = key;
    if (this.grid) this.drop(this.grid);
    this.grid = new three.GridHelper(wide, Math.round(wide * 10), tint, tint); // squares of 100 mm
    this.grid.rotation.x = Math.PI / 2;
    this.grid.position.set(Math.round((box.min.x + box.max.x) * 5) / 10, Math.round((box.min.y + box.max.y) * 5) / 10, low);
    this.scene.add(this.grid);
  }

  turnedByKey(e) {
    const step = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1], "+": 1 / 1.15, "-": 1.15 }[e.key];
    if (!step || !this.renderer) return;
    this.mine = false;
    const arm = this.camera.position.clone().sub(this.controls.target);
    if (Array.isArray(step)) {
      const flat = Math.hypot(arm.x, arm.y), far = arm.length();
      const yaw = Math.atan2(arm.y, arm.x) - step[0], pitch = Math.max(-1.4, Math.min(1.5, Math.atan2(arm.z, flat) + step[1]));
      arm.set(Math.cos(yaw) * Math.cos(pitch), Math.sin(yaw) * Math.cos(pitch), Math.sin(pitch)).multiplyScalar(far);
    } else arm.multiplyScalar(step);
    this.camera.position.copy(this.controls.target).add(arm);
    this.controls.update();
    this.draw();
    e.preventDefault(); e.stopPropagation();
  }

  pick(e) {
    if (!this.renderer) return;
    const box = this.canvas.getBoundingClientRect();
    const at = new three.Vector2(((e.clientX - box.left) / box.width) * 2 - 1, 1 - ((e.clientY - box.top) / box.height) * 2);
    const ray = new three.Raycaster();
    ray.params.Points.threshold = 0.01;
    ray.params.Line2 = { threshold: 8 };
    ray.setFromCamera(at, this.camera);
    const known = [...this.topics.values()].filter(({ node }) => node).map(({ group }) => group);
    const hits = ray.intersectObjects(known, true);
    const hit = hits.find(({ object }) => object.userData.mesh) ?? hits[0]; // a fruit before the points around it
    if (!hit) return;
    let group = hit.object;
    while (group && !group.userData.node) group = group.parent;
    if (group) this.onPick?.(group.userData.node);
  }

  draw() {
    const { renderer, canvas } = this;
    if (!renderer || canvas.hidden) return;
    const [w, ht] = [canvas.parentElement.clientWidth, canvas.parentElement.clientHeight];
    if (!w || !ht) return;
    $("scene-legend").open = this.unfolded ?? w >= ROOM;
    const ratio = Math.min(devicePixelRatio || 1, 2);
    if (this.size !== `${w}|${ht}|${ratio}`) {
      this.size = `${w}|${ht}|${ratio}`;
      renderer.setPixelRatio(ratio);
      renderer.setSize(w, ht, false);
      const first = !this.camera.aspect || this.mine;
      this.camera.aspect = w / ht;
      this.camera.updateProjectionMatrix();
      if (first && !this.fitting) { this.fitting = true; this.home(); this.fitting = false; return; }
    }
    if (this.drawing) this.again = true; else this.begun();
  }

  // A drawing is shown once it is ready. Reading it earlier would block the page, without a graphics card for longer than a
  // frame.
  begun() {
    const { renderer, size } = this, gl = renderer.getContext();
    Object.assign(this, { drawing: true, again: false });
    renderer.render(this.scene, this.camera);
    const ready = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
    const look = () => {
      if (ready && gl.getSyncParameter(ready, gl.SYNC_STATUS) !== gl.SIGNALED && !gl.isContextLost()) { requestAnimationFrame(look); return; }
      gl.deleteSync(ready);
      if (this.size === size) this.shown.transferFromImageBitmap(renderer.domElement.transferToImageBitmap()); // else it is empty, and drawn again
      this.drawing = false;
      if (this.again) this.begun();
    };
    requestAnimationFrame(look);
  }

  // Light and dark have other colours, so everything is built anew.
  repaint() { this.clear(); materials.clear(); this.floorKey = null; this.key = null; $("scene-legend").dataset.key = ""; }
}

let loading = null;
const load = () => (loading ??= import("./vendor/three.js").then((module) => { three = module; }));

// The scenes, and the newest look that has depth.
function shownViews(state) {
  const looks = [...state.images].filter(([, view]) => view.cloud).sort(([, a], [, b]) => a.t - b.t).slice(-1);
  return [...state.scenes, ...looks.map(([topic, { cloud, t, node, caption }]) => [`look ${topic}`, { cloud, t, node, caption }])];
}

function built(view) {
  const group = new three.Group();
  for (const cloud of list(view.points)) {
    const points = list(cloud.points);
    if (!points.length) continue;
    const cells = cloud.style === "occupied" || cloud.style === "muted";
    group.add(cells && points.length <= MOST_CUBES ? cubesOf(points, cloud) : pointsOf(new Float32Array(points.flat()), cloud));
  }
  for (const mesh of list(view.meshes)) if (Array.isArray(mesh.vertices)) group.add(meshOf(mesh));
  for (const line of list(view.lines)) if (list(line.points).length > 1) group.add(lineOf(line.points, line.style));
  return group;
}

// All cubes as one mesh: without a graphics card each instance costs as much as a mesh of its own.
function cubesOf(points, { size, style }) {
  const box = new three.BoxGeometry(size, size, size), { position, normal } = box.attributes, n = position.count;
  const places = new Float32Array(points.length * n * 3), normals = new Float32Array(places.length), corners = [];
  points.forEach((point, i) => {
    for (let v = 0; v < 3 * n; v++) places[3 * n * i + v] = position.array[v] + point[v % 3];
    normals.set(normal.array, 3 * n * i);
    for (const corner of box.index.array) corners.push(n * i + corner);
  });
  return painted(places, normals, corners, "solid", style);
}

// A path as a thin rod: three flat sides about each piece of it.
function rodOf(points, style, thick = ROD) {
  const places = [], corners = [], up = new three.Vector3(), side = new three.Vector3(), at = new three.Vector3();
  for (let i = 1; i < points.length; i++) {
    const [from, to] = [points[i - 1], points[i]].map((p) => new three.Vector3(...p)), way = to.clone().sub(from).normalize();
    up.set(0, 0, 1);
    if (Math.abs(way.z) > 0.9) up.set(1, 0, 0);
    side.crossVectors(way, up).normalize();
    up.crossVectors(side, way);
    const first = places.length / 3;
    for (const end of [from, to]) for (const turn of [0, 2.0944, 4.1888]) places.push(...at.copy(end).addScaledVector(side, Math.cos(turn) * thick).addScaledVector(up, Math.sin(turn) * thick).toArray());
    for (const k of [0, 1, 2]) { const next = (k + 1) % 3; corners.push(first + k, first + next, first + 3 + k, first + next, first + 3 + next, first + 3 + k); }
  }
  const rod = painted(new Float32Array(places), null, corners, "rod", style);
  rod.renderOrder = 1; // visible through other things
  return rod;
}

function painted(places, normals, corners, kind, style) {
  const geometry = new three.BufferGeometry();
  geometry.setAttribute("position", new three.BufferAttribute(places, 3));
  geometry.setIndex(corners);
  if (normals) geometry.setAttribute("normal", new three.BufferAttribute(normals, 3)); else geometry.computeVertexNormals();
  const mesh = new three.Mesh(geometry, materialOf(kind, style));
  mesh.userData = { kind, style };
  return mesh;
}

function pointsOf(positions, { size = 0.005, style = null }, colours = null) {
  const geometry = new three.BufferGeometry();
  geometry.setAttribute("position", new three.BufferAttribute(positions, 3));
  if (colours) geometry.setAttribute("color", new three.BufferAttribute(colours, 3, true));
  return new three.Points(geometry, materialOf(colours ? "look" : "points", style, false, Math.max(size, 0.004)));
}

function meshOf({ vertices, faces, style }) {
  const geometry = new three.BufferGeometry();
  geometry.setAttribute("position", new three.BufferAttribute(new Float32Array(list(vertices).flat()), 3));
  geometry.setIndex(list(faces).flat());
  const shown = style === "object" ? geometry : geometry.toNonIndexed(); // a fruit is smooth; parts of a robot have edges
  shown.computeVertexNormals();
  if (shown !== geometry) geometry.dispose();
  const mesh = new three.Mesh(shown, materialOf("sheet", style));
  mesh.userData = { mesh: true, kind: "sheet", style };
  return mesh;
}

function lineOf(points, style) {
  const line = new three.Line2(new three.LineGeometry().setPositions(points.flat()), materialOf("line", style));
  line.userData = { kind: "line", style };
  line.renderOrder = 1; // visible through other things
  return line;
}

// The look's depth points in the base frame: millimetres and colours, packed; a record has their address.
async function cloudOf(view) {
  let { cloud } = view;
  if (typeof cloud === "string") {
    try { cloud = await (await fetch(withToken(cloud))).json(); } catch { return null; }
  }
  if (!cloud?.mm) return null;
  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const mm = new Int16Array(bytes(cloud.mm).buffer);
  return pointsOf(Float32Array.from(mm, (v) => v / 1000), { size: 0.005 }, bytes(cloud.rgb));
}

// Materials, shared and kept: the browser would compile a new one's program for 50 ms without a graphics card at every
// motion of an arm.
const materials = new Map();
const MAKE = {
  solid: (style, strong) => new three.MeshLambertMaterial({ color: colour(style), emissive: glow(strong) }),
  sheet: (style, strong) => new three.MeshLambertMaterial({ color: colour(style), emissive: glow(strong), side: three.DoubleSide }),
  rod: (style) => new three.MeshLambertMaterial({ color: 0x000000, emissive: new three.Color(colour(style)), depthTest: false, transparent: true, opacity: 0.95 }),
  line: (style, strong) => new three.LineMaterial({ color: colour(style), linewidth: strong ? 6 : 3, depthTest: false, transparent: true, opacity: 0.95 }),
  points: (style, _strong, size) => new three.PointsMaterial({ size, color: colour(style) }),
  look: (_style, _strong, size) => new three.PointsMaterial({ size, color: 0xffffff, vertexColors: true }),
};
const glow = (strong) => (strong ? new three.Color(colour("--accent")).multiplyScalar(0.55) : new three.Color(0x000000));

function materialOf(kind, style, strong = false, size = 0) {
  const key = `${kind}|${style}|${strong}|${size}`;
  if (!materials.has(key)) materials.set(key, MAKE[kind](style, strong, size));
  return materials.get(key);
}

function emphasize(group, on) {
  group.traverse((thing) => { const { kind, style } = thing.userData; if (kind) thing.material = materialOf(kind, style, Boolean(on)); });
}

// The newest points of a path, without those on the straight line between two others.
function corners(points) {
  const kept = [points.at(-1)];
  for (let i = points.length - 2, from = points.length - 1; i >= 0 && kept.length < MOST_CORNERS; i--) {
    if (i > 0 && passes(points, from, i - 1)) continue;
    kept.push(points[i]);
    from = i;
  }
  return kept.reverse();
}

// Return true if the straight line between two points of a path passes near all points between them.
function passes(points, from, to) {
  const [a, b] = [points[from], points[to]], way = b.map((v, k) => v - a[k]), length = Math.hypot(...way);
  if (from - to > 40) return false; // far enough
  for (let i = to + 1; i < from; i++) {
    const arm = points[i].map((v, k) => v - a[k]);
    const along = length ? Math.max(0, Math.min(1, arm.reduce((sum, v, k) => sum + v * way[k], 0) / length ** 2)) : 0;
    if (Math.hypot(...arm.map((v, k) => v - along * way[k])) > OFF_PATH) return false;
  }
  return true;
}

// Without one the processor draws; smoothing edges would take it four times as long.
function hasGraphicsCard() {
  const probe = document.createElement("canvas").getContext("webgl2");
  const named = probe?.getExtension("WEBGL_debug_renderer_info");
  const card = probe?.getParameter(named ? named.UNMASKED_RENDERER_WEBGL : probe.RENDERER) ?? "";
  probe?.getExtension("WEBGL_lose_context")?.loseContext();
  return !/swiftshader|llvmpipe|softpipe|software|basic render/i.test(card);
}

const list = (v) => (Array.isArray(v) ? v : []);

export function colour(style) {
  return getComputedStyle(document.documentElement).getPropertyValue(style.startsWith("--") ? style : STYLE[style] ?? "--accent").trim();
}
