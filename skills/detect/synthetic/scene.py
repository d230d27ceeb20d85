"""Random scenes with fruit: a picking table, randomised clutter, an orchard; rendered with exact labels."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

import cv2
import numpy as np
from numpy.typing import NDArray

from skills.detect.cuboid import cuboid_keypoints
from skills.detect.symmetry import STEM_AXIS, label_rotation, minimal_rotation
from skills.detect.synthetic import shapes, textures
from skills.detect.synthetic.raster import draw_shadow_map, rasterise, shade
from skills.detect.synthetic.shapes import Shape
from skills.fruit import FruitModel

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]

SHADOW_CELLS = 320


class SceneKind(StrEnum):
    """What a frame looks like: a robot's table, a domain-randomised heap, or an orchard row."""

    TABLE = "table"
    RANDOM = "random"
    ORCHARD = "orchard"


@dataclass(frozen=True, slots=True)
class SceneOptions:
    """What a data set is made of.

    Attributes:
        width, height: picture size [px].
        camera: fx, fy, cx, cy [px].
        instances: fewest and most fruit in a frame.
        distractors: things that are no fruit, per frame.
        scale: range of the fruit's size against the CAD model.
        height_ratio: range of height over width against the CAD model's; an apple's is then 0.75 to 1.0.
        exact: part of the instances that keep the CAD model's own size and proportions.
        kinds: how often each kind of scene appears.
    """

    width: int = 640
    height: int = 480
    camera: tuple[float, float, float, float] = (610.6, 610.6, 317.7, 238.1)
    instances: tuple[int, int] = (5, 10)
    distractors: int = 5
    scale: tuple[float, float] = (0.6, 1.15)
    height_ratio: tuple[float, float] = (0.85, 1.133)
    exact: float = 0.15
    kinds: tuple[float, float, float] = (0.5, 0.3, 0.2)


@dataclass(frozen=True, slots=True, eq=False)
class FruitTruth:
    """One fruit of a rendered frame.

    Attributes:
        T_camera_object: the label's pose: the swing rule's rotation, the true centre.
        dimensions: true cuboid along the object's axes [m].
        scale: size of the CAD model that fits best (least squares over the three dimensions).
        keypoints: the scaled CAD cuboid in the picture, (9, 2) [px].
        visibility: part of the silhouette that is in the picture and not covered.
        box: x, y, w, h of the visible pixels [px]; zeros when none.
    """

    T_camera_object: F64
    dimensions: F64
    scale: float
    keypoints: F64
    visibility: float
    box: tuple[int, int, int, int]


@dataclass(frozen=True, slots=True, eq=False)
class RenderedFrame:
    """A picture (h, w, 3) uint8 RGB, z-depth (h, w) float32 [m], and the truth about its fruit and its decoys."""

    colour: NDArray[np.uint8]
    depth: F32
    fruit: tuple[FruitTruth, ...]
    decoys: tuple[tuple[float, float, float], ...]
    kind: SceneKind


@dataclass(slots=True)
class _Item:
    shape: Shape
    rotation: F64
    scale: F64
    centre: F64
    albedo: F32
    grain_frequency: float
    material: tuple[float, float, float]
    fruit: int = -1
    openness: float = 1.0


@dataclass(slots=True)
class _Scene:
    kind: SceneKind
    T_world_camera: F64
    table: bool
    items: list[_Item] = field(default_factory=list)
    spheres: list[tuple[F64, float]] = field(default_factory=list)
    truths: list[tuple[F64, F64, F64, bool]] = field(default_factory=list)
    decoys: list[tuple[F64, float]] = field(default_factory=list)


def render_scene(fruit: FruitModel, options: SceneOptions, seed: int) -> RenderedFrame:
    """Compose and render the scene of a seed; the same seed and options give the same frame."""
    rng = np.random.default_rng((23, seed))
    kind = list(SceneKind)[rng.choice(3, p=np.asarray(options.kinds) / sum(options.kinds))]
    scene = _compose(fruit, options, kind, rng)
    return _render(fruit, options, scene, rng)


# ------------------------------------------------------------------------------------------------ composition


def _compose(fruit: FruitModel, options: SceneOptions, kind: SceneKind, rng: np.random.Generator) -> _Scene:
    scene = _Scene(kind, _camera_pose(kind, rng), table=kind is SceneKind.TABLE or rng.random() < 0.15)
    if kind is SceneKind.TABLE and rng.random() < 0.06:
        scene.table = False
    count = int(rng.integers(options.instances[0], options.instances[1] + 1))
    style = rng.uniform(0.0, 1.0, 3)  # fruit of one frame resemble each other
    plain = rng.random() < 0.22
    for _ in range(count):
        _add_fruit(fruit, options, scene, style, plain, rng)
    for _ in range(options.distractors):
        _add_decoy(options, scene, style, rng)
    if kind is SceneKind.ORCHARD or rng.random() < 0.12:
        _add_leaves(options, scene, rng)
    if kind is not SceneKind.ORCHARD and rng.random() < 0.15:
        _add_finger(scene, rng)
    return scene


def _camera_pose(kind: SceneKind, rng: np.random.Generator) -> F64:
    """T_world_camera, looking at the neighbourhood of the world's origin (the table's surface is z = 0)."""
    if kind is SceneKind.ORCHARD:
        elevation, distance = np.deg2rad(rng.uniform(-25.0, 40.0)), rng.uniform(0.55, 1.2)
    else:
        elevation, distance = np.deg2rad(90.0 - 60.0 * rng.uniform(0.03, 1.0) ** 1.2), rng.uniform(0.35, 0.85)
    azimuth = rng.uniform(0.0, 2.0 * np.pi)
    roll = rng.normal(0.0, np.deg2rad(8.0)) if rng.random() < 0.7 else rng.uniform(0.0, 2.0 * np.pi)
    forward = -np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    down = np.cross(forward, right)
    R = np.stack([right, down, forward], axis=1)
    spin = np.array([[np.cos(roll), -np.sin(roll), 0.0], [np.sin(roll), np.cos(roll), 0.0], [0.0, 0.0, 1.0]])
    T = np.eye(4)
    T[:3, :3] = R @ spin
    T[:3, 3] = np.array([0.0, 0.0, 0.03]) - distance * forward
    return T


def _random_rotation(rng: np.random.Generator) -> F64:
    q = rng.normal(size=4)
    x, y, z, w = q / np.linalg.norm(q)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def _fruit_rotation(kind: SceneKind, rng: np.random.Generator) -> F64:
    """R_world_object: on a table mostly upright or lying, on a tree hanging, else anyhow."""
    draw = rng.random()
    if kind is SceneKind.RANDOM or draw < 0.12:
        return _random_rotation(rng)
    if kind is SceneKind.ORCHARD:
        tilt = abs(rng.normal(0.0, np.deg2rad(28.0)))
    elif draw < 0.78:
        tilt = abs(rng.normal(0.0, np.deg2rad(9.0)))
    else:
        tilt = rng.uniform(np.deg2rad(45.0), np.deg2rad(125.0))
    azimuth = rng.uniform(0.0, 2.0 * np.pi)
    stem = np.array([np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), np.cos(tilt)])
    spin = rng.uniform(0.0, 2.0 * np.pi)
    about_stem = np.array([[np.cos(spin), 0.0, np.sin(spin)], [0.0, 1.0, 0.0], [-np.sin(spin), 0.0, np.cos(spin)]])
    rotation: F64 = minimal_rotation(STEM_AXIS, stem) @ about_stem
    return rotation


def _place(
    scene: _Scene, options: SceneOptions, radius: float, lowest: float, gap: float, rng: np.random.Generator
) -> F64 | None:
    """A free place in view for a body of `radius` whose centre is `lowest` above its lowest point; None when full."""
    fx, fy, cx, cy = options.camera
    T = scene.T_world_camera
    for _ in range(25):
        u = rng.uniform(-0.04, 1.04) * options.width
        v = rng.uniform(-0.04, 1.04) * options.height
        ray = T[:3, :3] @ np.array([(u - cx) / fx, (v - cy) / fy, 1.0])
        if scene.kind is SceneKind.TABLE:
            if ray[2] > -0.15:
                continue
            depth = (lowest - T[2, 3]) / ray[2]
            if not 0.25 < depth < 1.3:
                continue
        else:
            near, far = (0.32, 1.0) if scene.kind is SceneKind.RANDOM else (0.4, 1.4)
            depth = 1.0 / rng.uniform(1.0 / far, 1.0 / near)
        centre: F64 = T[:3, 3] + depth * ray
        if all(np.linalg.norm(centre - other) > gap * (radius + size) for other, size in scene.spheres):
            scene.spheres.append((centre, radius))
            return centre
    return None


def _add_fruit(
    fruit: FruitModel, options: SceneOptions, scene: _Scene, style: F64, plain: bool, rng: np.random.Generator
) -> None:
    exact = rng.random() < options.exact
    index = 0 if exact or rng.random() < 0.2 else int(rng.integers(1, 64))
    if exact:
        dimensions = fruit.dimensions.copy()
    else:
        width = rng.uniform(*options.scale) * 0.5 * (fruit.dimensions[0] + fruit.dimensions[2])
        oval = rng.normal(0.0, 0.02)
        own_ratio = fruit.dimensions[1] / (0.5 * (fruit.dimensions[0] + fruit.dimensions[2]))
        dimensions = width * np.array([1.0 + oval, own_ratio * rng.uniform(*options.height_ratio), 1.0 - oval])
    shape = shapes.fruit_relative(fruit, index)
    stretch = dimensions / fruit.dimensions
    rotation = _fruit_rotation(scene.kind, rng)
    lowest = -float(((shape.vertices * stretch) @ rotation[2]).min())
    centre = _place(scene, options, 0.5 * float(dimensions.max()), lowest, rng.uniform(0.92, 1.3), rng)
    if centre is None:
        return
    albedo = _plain_paint(shape, style, rng) if plain else _skin_paint(shape, _skins(fruit), style, rng)
    gloss = (rng.uniform(0.0, 0.45), 10.0 ** rng.uniform(0.7, 2.1), 0.0 if plain else rng.uniform(0.0, 0.14))
    order = len(scene.truths)
    open_hollows = 0.0 if plain and rng.random() < 0.7 else 1.0
    scene.items.append(
        _Item(shape, rotation, stretch, centre, albedo, rng.uniform(300.0, 2500.0), gloss, order, open_hollows)
    )
    has_stem = rng.random() < (0.5 if plain else 0.72) and fruit.stem is not None
    scene.truths.append((rotation, centre, dimensions, has_stem))
    if has_stem:
        part = shapes.stem(int(rng.integers(0, 16)))
        brown = np.array([0.10, 0.06, 0.03]) * rng.uniform(0.4, 3.0) * rng.uniform(0.8, 1.2, 3)
        paint = np.broadcast_to(brown.astype(np.float32), part.vertices.shape)
        thick = stretch * np.array([1.0, 1.0, 1.0])
        scene.items.append(_Item(part, rotation, thick, centre, paint, 900.0, (0.02, 10.0, 0.1), order))


_SKINS = np.array(
    [
        [(0.42, 0.015, 0.02), (0.55, 0.06, 0.03)],  # red
        [(0.20, 0.008, 0.015), (0.36, 0.02, 0.02)],  # dark red
        [(0.50, 0.05, 0.03), (0.68, 0.50, 0.12)],  # red on yellow
        [(0.28, 0.42, 0.05), (0.42, 0.55, 0.10)],  # green
        [(0.66, 0.52, 0.10), (0.62, 0.58, 0.18)],  # yellow
        [(0.60, 0.16, 0.10), (0.62, 0.60, 0.22)],  # pink on pale green
        [(0.42, 0.06, 0.03), (0.34, 0.44, 0.07)],  # red on green
    ]
)


def _skins(fruit: FruitModel) -> F64:
    """Pairs of blush and ground colour, linear RGB: an apple's many, or shades of another fruit's own colour."""
    if fruit.name == "apple":
        return _SKINS
    own = np.asarray(fruit.colour) ** 2.2
    return np.array([[own, own * 1.2], [own * (0.8, 1.0, 0.7), own * (1.1, 1.0, 1.0)], [own * (0.5, 0.9, 0.6), own]])


def _skin_paint(shape: Shape, skins: F64, style: F64, rng: np.random.Generator) -> F32:
    """Skin colour per vertex: ground colour, blush on the sunny side, streaks along meridians, russet hollows."""
    skin = skins[int(style[0] * len(skins)) if rng.random() < 0.7 else int(rng.integers(len(skins)))]
    skin = skin * np.exp(rng.normal(0.0, 0.18, (2, 3))) * np.exp(rng.normal(0.0, 0.15))
    x, y, z = shape.vertices.T
    angle = np.arctan2(z, x)
    height = y / (np.abs(y).max() + 1e-9)
    wobble = np.zeros_like(angle)
    for _ in range(4):
        wobble += rng.normal(0.0, 0.35) * np.cos(
            rng.integers(1, 5) * angle + rng.uniform(0, 6.28) + rng.normal() * height * 2
        )
    streak_table = rng.normal(0.0, 1.0, 40)
    streaks = streak_table[np.round((angle / (2 * np.pi) + 0.5) * 40).astype(int) % 40] * rng.uniform(0.0, 0.7)
    blush = 1.0 / (1.0 + np.exp(-(rng.normal(0.8, 1.2) + rng.uniform(0.5, 2.0) * wobble + streaks)))
    colour = skin[0] * blush[:, None] + skin[1] * (1.0 - blush[:, None])
    inner = np.clip(1.0 - np.hypot(x, z) / (0.30 * np.abs(x).max()), 0.0, 1.0)[:, None]
    hollow = np.where(y[:, None] < 0, [0.36, 0.34, 0.10], [0.20, 0.15, 0.07]) * rng.uniform(0.5, 1.2)
    hollow_strength = rng.uniform(0.0, 1.0)
    colour = colour * (1.0 - hollow_strength * inner) + hollow * hollow_strength * inner
    tip = ((y > 0) & (np.hypot(x, z) < 0.09 * np.abs(x).max()))[:, None]
    colour = np.where(tip, np.array([0.06, 0.045, 0.03]) * rng.uniform(0.3, 2.0), colour)
    return colour.astype(np.float32)


def _plain_paint(shape: Shape, style: F64, rng: np.random.Generator) -> F32:
    """One colour all over, as simulators paint fruit."""
    skin = _SKINS[int(style[1] * len(_SKINS))][0] if rng.random() < 0.8 else rng.uniform(0.02, 0.8, 3)
    skin = skin * np.exp(rng.normal(0.0, 0.3, 3))
    return np.broadcast_to(skin.astype(np.float32), shape.vertices.shape)


def _add_decoy(options: SceneOptions, scene: _Scene, style: F64, rng: np.random.Generator) -> None:
    """Balls, capsules, boxes, cylinders, turned bodies; many in the fruit's own colours."""
    choice = rng.choice(["ball", "capsule", "box", "cylinder", "turned"], p=[0.28, 0.2, 0.2, 0.12, 0.2])
    size = rng.uniform(0.012, 0.055)
    scale = np.full(3, size)
    if choice == "ball":
        shape = shapes.ball()
        if rng.random() < 0.3:
            scale = scale * rng.uniform(0.75, 1.2, 3)
    elif choice == "capsule":
        shape = shapes.capsule(rng.uniform(0.5, 3.5), 1.0)
        scale = np.full(3, rng.uniform(0.01, 0.045))
    elif choice == "box":
        shape, scale = shapes.box(), rng.uniform(0.012, 0.07, 3)
    elif choice == "cylinder":
        shape, scale = shapes.cylinder(), np.array([1.0, rng.uniform(0.3, 2.0), 1.0]) * rng.uniform(0.015, 0.045)
    else:
        shape, scale = shapes.turned_body(rng), np.full(3, rng.uniform(0.018, 0.04))
    rotation = _random_rotation(rng)
    extent = np.abs(shape.vertices * scale)
    radius = float(min(extent.max(), 0.09))
    lowest = -float(((shape.vertices * scale) @ rotation[2]).min())
    centre = _place(scene, options, 0.8 * radius, lowest, rng.uniform(0.8, 1.3), rng)
    if centre is None:
        return
    if rng.random() < 0.55:
        paint = _plain_paint(shape, style, rng)
    else:
        colour = rng.uniform(0.02, 0.85) * np.exp(rng.normal(0.0, 0.5, 3))
        paint = np.broadcast_to(colour.astype(np.float32), shape.vertices.shape)
    if rng.random() < 0.3:
        bands = np.sin(shape.vertices[:, 1] * rng.uniform(1.0, 8.0) + shape.vertices[:, 0] * rng.uniform(0.0, 6.0))
        paint = paint * (1.0 + 0.6 * np.sign(bands)[:, None]).astype(np.float32) * np.float32(0.7)
    gloss = (rng.uniform(0.0, 0.5), 10.0 ** rng.uniform(0.7, 2.1), rng.uniform(0.0, 0.3) * (rng.random() < 0.5))
    scene.items.append(_Item(shape, rotation, scale, centre, paint, rng.uniform(100.0, 2500.0), gloss))
    scene.decoys.append((centre, radius))


def _add_leaves(options: SceneOptions, scene: _Scene, rng: np.random.Generator) -> None:
    """Leaves and twigs between, before and behind the fruit."""
    T = scene.T_world_camera
    fx, fy, cx, cy = options.camera
    for _ in range(int(rng.integers(4, 22))):
        u, v = rng.uniform(0, options.width), rng.uniform(0, options.height)
        depth = rng.uniform(0.3, 1.3)
        centre = T[:3, 3] + T[:3, :3] @ (np.array([(u - cx) / fx, (v - cy) / fy, 1.0]) * depth)
        green = np.array([0.08, 0.20, 0.03]) * np.exp(rng.normal(0.0, 0.4, 3)) * rng.uniform(0.5, 1.8)
        shape = shapes.leaf(int(rng.integers(0, 32)))
        paint = np.broadcast_to(green.astype(np.float32), shape.vertices.shape)
        size = np.full(3, rng.uniform(0.03, 0.10))
        scene.items.append(_Item(shape, _random_rotation(rng), size, centre, paint, 800.0, (0.1, 12.0, 0.15)))
    for _ in range(int(rng.integers(0, 4))):
        u, v = rng.uniform(0, options.width), rng.uniform(0, options.height)
        centre = T[:3, 3] + T[:3, :3] @ (np.array([(u - cx) / fx, (v - cy) / fy, 1.0]) * rng.uniform(0.45, 1.3))
        shape = shapes.capsule(1.0, rng.uniform(0.008, 0.04))
        brown = np.array([0.14, 0.10, 0.07]) * rng.uniform(0.3, 1.8)
        paint = np.broadcast_to(brown.astype(np.float32), shape.vertices.shape)
        size = np.full(3, rng.uniform(0.2, 0.5))
        scene.items.append(_Item(shape, _random_rotation(rng), size, centre, paint, 600.0, (0.02, 8.0, 0.3)))


def _add_finger(scene: _Scene, rng: np.random.Generator) -> None:
    """Bars close to the camera that reach into the picture from one side, as a gripper's fingers do."""
    T = scene.T_world_camera
    side = rng.uniform(0.0, 2.0 * np.pi) if rng.random() < 0.4 else -0.5 * np.pi
    outwards = np.array([np.cos(side), np.sin(side), 0.0])
    grey = np.full(3, rng.uniform(0.02, 0.5)) * rng.uniform(0.85, 1.15, 3)
    for sign in (-1.0, 1.0):
        across = np.array([-outwards[1], outwards[0], 0.0]) * sign * rng.uniform(0.015, 0.055)
        centre = outwards * rng.uniform(0.07, 0.13) + across + np.array([0.0, 0.0, rng.uniform(0.13, 0.24)])
        R = T[:3, :3] @ np.stack([outwards, [-outwards[1], outwards[0], 0.0], [0.0, 0.0, 1.0]], axis=1)
        scale = np.array([rng.uniform(0.008, 0.05), rng.uniform(0.004, 0.012), rng.uniform(0.01, 0.05)])
        paint = np.broadcast_to(grey.astype(np.float32), shapes.box().vertices.shape)
        world = T[:3, 3] + T[:3, :3] @ centre
        scene.items.append(_Item(shapes.box(), R, scale, world, paint, 500.0, (rng.uniform(0.0, 0.6), 30.0, 0.0)))


# -------------------------------------------------------------------------------------------------- rendering


def _render(fruit: FruitModel, options: SceneOptions, scene: _Scene, rng: np.random.Generator) -> RenderedFrame:
    h, w = options.height, options.width
    T_wc = scene.T_world_camera
    R_cw, eye = T_wc[:3, :3].T, T_wc[:3, 3]
    points, normals, albedo, grain, openness, faces, face_object = [], [], [], [], [], [], []
    start = 0
    for k, item in enumerate(scene.items):
        local = item.shape.vertices * item.scale.astype(np.float32)
        R = (R_cw @ item.rotation).astype(np.float32)
        points.append(local @ R.T + (R_cw @ (item.centre - eye)).astype(np.float32))
        bent = (item.shape.normals / item.scale.astype(np.float32)) @ R.T
        normals.append(bent / (np.linalg.norm(bent, axis=1, keepdims=True) + np.float32(1e-12)))
        albedo.append(item.albedo)
        grain.append((local + np.float32(0.37 * (k + 1))) * np.float32(item.grain_frequency))
        openness.append(1.0 - item.openness * (1.0 - item.shape.openness))
        faces.append(item.shape.faces + start)
        face_object.append(np.full(len(item.shape.faces), k, np.int32))
        start += len(local)
    P = np.ascontiguousarray(np.concatenate(points), np.float32)
    F = np.ascontiguousarray(np.concatenate(faces), np.int32)
    owner_of_face = np.concatenate(face_object)
    camera = np.asarray(options.camera, np.float32)
    two_sided = np.array([item.shape.two_sided for item in scene.items])
    depth, face_index = np.zeros((h, w), np.float32), np.full((h, w), -1, np.int32)
    weights = np.zeros((h, w, 2), np.float32)
    rasterise(P, F, owner_of_face, two_sided, camera, depth, face_index, weights)

    picture = _backdrop(options, scene, rng)
    owner = np.empty((h, w), np.int32)
    lights, up, ambient = _lights(scene, R_cw, rng)
    shadow, light_map = _shadow(P, F, lights[0, :3], rng)
    plane, plane_axes, plane_look = _table(scene, T_wc, rng)
    spheres = np.array([[*(R_cw @ (c - eye)), r] for c, r in scene.spheres], np.float32).reshape(-1, 4)
    shade(
        P,
        np.ascontiguousarray(np.concatenate(normals), np.float32),
        np.ascontiguousarray(np.concatenate(albedo), np.float32),
        np.ascontiguousarray(np.concatenate(grain), np.float32),
        np.ascontiguousarray(np.concatenate(openness), np.float32),
        F,
        owner_of_face,
        np.array([item.material for item in scene.items], np.float32),
        camera,
        depth,
        face_index,
        weights,
        plane,
        plane_axes,
        plane_look,
        spheres if rng.random() < 0.8 else spheres[:0],
        lights,
        up,
        ambient,
        light_map,
        shadow,
        float(rng.uniform(0.4, 1.0) if rng.random() < 0.75 else 0.0),
        textures.table_top(int(rng.integers(0, 96))),
        textures.grain(),
        picture,
        owner,
    )
    truths = _truths(fruit, options, scene, owner, P, F, owner_of_face)
    colour = _photograph(picture, rng)
    decoys = tuple(_decoy_circle(options, R_cw @ (c - eye), r) for c, r in scene.decoys)
    return RenderedFrame(colour, depth, truths, decoys, scene.kind)


def _decoy_circle(options: SceneOptions, centre: F64, radius: float) -> tuple[float, float, float]:
    fx, fy, cx, cy = options.camera
    return (
        float(fx * centre[0] / centre[2] + cx),
        float(fy * centre[1] / centre[2] + cy),
        float(fx * radius / centre[2]),
    )


def _backdrop(options: SceneOptions, scene: _Scene, rng: np.random.Generator) -> F32:
    index = int(rng.integers(0, 160))
    if scene.kind is SceneKind.ORCHARD and rng.random() < 0.85:
        index = 4 * (index // 4) + 3
    picture = textures.background(index, options.height // 2, options.width // 2)
    if rng.random() < 0.5:
        picture = picture[:, ::-1]
    if rng.random() < 0.3:
        picture = picture[::-1]
    picture = cv2.resize(np.ascontiguousarray(picture), (options.width, options.height))
    cast = np.exp(rng.normal(0.0, 0.25)) * np.exp(rng.normal(0.0, 0.1, 3))
    return np.asarray(picture * cast, np.float32)


def _lights(scene: _Scene, R_cw: F64, rng: np.random.Generator) -> tuple[F32, F32, F32]:
    count = int(rng.integers(1, 4))
    lights = np.zeros((count, 6), np.float32)
    total = rng.uniform(0.5, 1.4)
    for k in range(count):
        direction = rng.normal(size=3)
        direction[2] = abs(direction[2]) + rng.uniform(0.1, 2.0)
        if scene.kind is SceneKind.RANDOM and rng.random() < 0.4:
            direction = rng.normal(size=3)
        if k == count - 1 and rng.random() < 0.3:
            direction = -R_cw.T[:, 2] + rng.normal(0.0, 0.2, 3)  # a lamp at the camera
        share = total * (1.0 if k == 0 else rng.uniform(0.1, 0.6))
        lights[k, :3] = R_cw @ (direction / np.linalg.norm(direction))
        lights[k, 3:] = share * np.exp(rng.normal(0.0, 0.10, 3))
    ambient = rng.uniform(0.12, 0.8) * np.exp(rng.normal(0.0, 0.10, 3))
    return lights, R_cw[:, 2].astype(np.float32), ambient.astype(np.float32)


def _shadow(P: F32, F: NDArray[np.int32], light: F32, rng: np.random.Generator) -> tuple[F32, F32]:
    """Shadow map of the key light and the map (3, 4) from camera coordinates to its cells and distance."""
    d = light.astype(np.float64)
    a = np.cross(d, [1.0, 0.0, 0.0] if abs(d[0]) < 0.8 else [0.0, 1.0, 0.0])
    a /= np.linalg.norm(a)
    b = np.cross(d, a)
    axes = np.stack([a, b, -d])
    middle, half = np.array([0.0, 0.0, 0.6]), 0.55
    cells = 0.5 * SHADOW_CELLS / half
    scaling = np.array([cells, cells, 1.0])
    matrix = np.zeros((3, 4))
    matrix[:, :3] = axes * scaling[:, None]
    matrix[:, 3] = -(axes @ middle) * scaling + np.array([0.5 * SHADOW_CELLS, 0.5 * SHADOW_CELLS, 0.0])
    light_map = matrix.astype(np.float32)
    shadow = np.full((SHADOW_CELLS, SHADOW_CELLS), 1e6, np.float32)
    draw_shadow_map(P @ light_map[:, :3].T + light_map[:, 3], F, shadow)
    return shadow, light_map


def _table(scene: _Scene, T_wc: F64, rng: np.random.Generator) -> tuple[F32, F32, F32]:
    R_cw, eye = T_wc[:3, :3].T, T_wc[:3, 3]
    normal = R_cw[:, 2]
    offset = -float(eye[2]) if scene.table else 0.0
    turn = rng.uniform(0.0, 2.0 * np.pi)
    s, t = np.array([np.cos(turn), np.sin(turn), 0.0]), np.array([-np.sin(turn), np.cos(turn), 0.0])
    axes = np.array([[*(R_cw @ s), -(s @ eye)], [*(R_cw @ t), -(t @ eye)]], np.float32)
    reach = rng.uniform(0.25, 0.6) if rng.random() < 0.3 else 9.0
    look = [rng.uniform(200.0, 1500.0), rng.uniform(0.0, 0.25) * (rng.random() < 0.4), rng.uniform(5.0, 60.0), reach]
    return np.array([*normal, offset], np.float32), axes, np.array(look, np.float32)


def _truths(
    fruit: FruitModel,
    options: SceneOptions,
    scene: _Scene,
    owner: NDArray[np.int32],
    P: F32,
    F: NDArray[np.int32],
    owner_of_face: NDArray[np.int32],
) -> tuple[FruitTruth, ...]:
    fx, fy, cx, cy = options.camera
    T_wc = scene.T_world_camera
    R_cw, eye = T_wc[:3, :3].T, T_wc[:3, 3]
    cad = cuboid_keypoints(fruit.dimensions)
    flesh = {item.fruit: k for k, item in enumerate(scene.items) if item.fruit >= 0 and len(item.shape.faces) > 500}
    truths = []
    for order, (rotation, centre_world, dimensions, _) in enumerate(scene.truths):
        centre = R_cw @ (centre_world - eye)
        scale = float(dimensions @ fruit.dimensions / (fruit.dimensions @ fruit.dimensions))
        T = np.eye(4)
        T[:3, :3] = label_rotation(R_cw @ rotation @ STEM_AXIS, centre)
        T[:3, 3] = centre
        corners = (scale * cad) @ T[:3, :3].T + centre
        keypoints = corners[:, :2] / corners[:, 2:] * (fx, fy) + (cx, cy)
        k = flesh[order]
        first = np.searchsorted(owner_of_face, k)
        own = P[np.unique(F[first : np.searchsorted(owner_of_face, k, side="right")])]
        outline = own[:, :2] / own[:, 2:] * (fx, fy) + (cx, cy)
        silhouette = cv2.contourArea(cv2.convexHull(outline.astype(np.float32)))
        v, u = np.nonzero(owner == k)
        box = (int(u.min()), int(v.min()), int(np.ptp(u)) + 1, int(np.ptp(v)) + 1) if len(u) else (0, 0, 0, 0)
        truths.append(FruitTruth(T, dimensions, scale, keypoints, min(1.0, len(u) / max(silhouette, 1.0)), box))
    return tuple(truths)


def _photograph(picture: F32, rng: np.random.Generator) -> NDArray[np.uint8]:
    """Exposure, lens blur, gamma, shot and read noise, quantisation."""
    h, w = picture.shape[:2]
    bright = float(np.percentile(picture[::8, ::8], 90.0)) + 1e-3
    exposure = rng.uniform(0.55, 1.35) / bright if rng.random() < 0.8 else rng.uniform(0.6, 1.5)
    picture = np.clip(picture * np.float32(exposure), 0.0, 1.6)
    if rng.random() < 0.85:
        picture = cv2.GaussianBlur(picture, (0, 0), rng.uniform(0.35, 1.1))
    if rng.random() < 0.08:
        length = int(rng.integers(2, 5))
        kernel = np.zeros((2 * length + 1, 2 * length + 1), np.float32)
        angle = rng.uniform(0.0, np.pi)
        for s in np.linspace(-length, length, 6 * length):
            kernel[round(length + s * np.sin(angle)), round(length + s * np.cos(angle))] += 1.0
        picture = cv2.filter2D(picture, -1, kernel / kernel.sum())
    coded = (
        np.sqrt(np.clip(picture, 0.0, 1.0))
        if rng.random() < 0.75
        else np.clip(picture, 0.0, 1.0) ** rng.uniform(0.4, 1.0)
    )
    if rng.random() < 0.8:
        level = rng.uniform(0.002, 0.03) * rng.uniform(0.2, 1.0)
        noise = textures.sensor_noise()
        for c in range(3):
            y, x = rng.integers(0, noise.shape[0] - h), rng.integers(0, noise.shape[1] - w)
            coded[..., c] += np.float32(level) * noise[y : y + h, x : x + w]
    return (np.clip(coded, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)
