"""Composing a random scene: the camera, fruit, things that are none, leaves, trees and a gripper's fingers."""

from __future__ import annotations

import numpy as np

from pomona.executive.values.arrays import Float64
from pomona.skills.perception.detection.close_look import STEM_AXIS, minimal_rotation
from pomona.skills.perception.fruit import FruitModel
from pomona.tools.training import shapes
from pomona.tools.training.contents import Item, SyntheticScene
from pomona.tools.training.foliage import grow_tree
from pomona.tools.training.options import SceneKind, SceneOptions
from pomona.tools.training.paint import plain_paint, skin_paint, skins

OUTDOORS = (SceneKind.ORCHARD, SceneKind.TREE)

_DEPTHS = {
    SceneKind.RANDOM: (0.32, 1.0),
    SceneKind.ORCHARD: (0.4, 1.4),
    SceneKind.TREE: (0.45, 1.4),
}
"""Least and greatest distance of fruit that stands on nothing [m]."""


def compose(
    fruit: FruitModel, options: SceneOptions, kind: SceneKind, rng: np.random.Generator
) -> SyntheticScene:
    """Draw a scene: camera, fruit, leaves and other things, all from `rng`."""
    scene = SyntheticScene(
        kind, _camera_pose(kind, rng), table=kind is SceneKind.TABLE or rng.random() < 0.15
    )
    if kind is SceneKind.TABLE and rng.random() < 0.06:
        scene.table = False
    count = int(rng.integers(options.instances[0], options.instances[1] + 1))
    style = rng.uniform(0.0, 1.0, 3)  # fruit of one frame resemble each other
    plain = rng.random() < 0.22
    for _ in range(count):
        _add_fruit(fruit, options, scene, style, plain, rng)
    tree = kind is SceneKind.TREE
    for _ in range(
        int(rng.integers(0, options.distractors + 1)) // 2 if tree else options.distractors
    ):
        _add_decoy(options, scene, style, rng)
    if tree:
        grow_tree(options, scene, rng)
    elif kind is SceneKind.ORCHARD or rng.random() < 0.12:
        _add_leaves(options, scene, rng)
    if kind not in OUTDOORS and rng.random() < 0.15:
        _add_finger(scene, rng)
    return scene


def _camera_pose(kind: SceneKind, rng: np.random.Generator) -> Float64:
    """T_world_camera, looking at the neighbourhood of the world's origin (the table's surface is z = 0)."""
    if kind in OUTDOORS:
        elevation = np.deg2rad(rng.uniform(-25.0, 40.0))
        distance = rng.uniform(0.55, 1.2)
    else:
        elevation = np.deg2rad(90.0 - 60.0 * rng.uniform(0.03, 1.0) ** 1.2)
        distance = rng.uniform(0.35, 0.85)
    azimuth = rng.uniform(0.0, 2.0 * np.pi)
    roll = rng.normal(0.0, np.deg2rad(8.0)) if rng.random() < 0.7 else rng.uniform(0.0, 2.0 * np.pi)
    forward = -np.array(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ]
    )
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    down = np.cross(forward, right)
    R = np.stack([right, down, forward], axis=1)
    spin = np.array(
        [[np.cos(roll), -np.sin(roll), 0.0], [np.sin(roll), np.cos(roll), 0.0], [0.0, 0.0, 1.0]]
    )
    T = np.eye(4)
    T[:3, :3] = R @ spin
    T[:3, 3] = np.array([0.0, 0.0, 0.03]) - distance * forward
    return T


def _random_rotation(rng: np.random.Generator) -> Float64:
    q = rng.normal(size=4)
    x, y, z, w = q / np.linalg.norm(q)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def _fruit_rotation(kind: SceneKind, rng: np.random.Generator) -> Float64:
    """R_world_object: on a table mostly upright or lying, on a tree hanging, else in any orientation."""
    draw = rng.random()
    if kind is SceneKind.RANDOM or draw < 0.12:
        return _random_rotation(rng)
    if kind in OUTDOORS:
        tilt = abs(rng.normal(0.0, np.deg2rad(28.0)))
    elif draw < 0.78:
        tilt = abs(rng.normal(0.0, np.deg2rad(9.0)))
    else:
        tilt = rng.uniform(np.deg2rad(45.0), np.deg2rad(125.0))
    azimuth = rng.uniform(0.0, 2.0 * np.pi)
    stem = np.array([np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), np.cos(tilt)])
    spin = rng.uniform(0.0, 2.0 * np.pi)
    about_stem = np.array(
        [[np.cos(spin), 0.0, np.sin(spin)], [0.0, 1.0, 0.0], [-np.sin(spin), 0.0, np.cos(spin)]]
    )
    rotation: Float64 = minimal_rotation(STEM_AXIS, stem) @ about_stem
    return rotation


def _place(
    scene: SyntheticScene,
    options: SceneOptions,
    radius: float,
    lowest: float,
    gap: float,
    rng: np.random.Generator,
) -> Float64 | None:
    """A free place in view for a body of `radius` whose centre is `lowest` above its lowest point; None when full."""
    fx, fy, cx, cy = options.camera
    T = scene.T_world_camera
    for _ in range(25):
        if (
            scene.kind is SceneKind.TREE and scene.spheres and rng.random() < 0.4
        ):  # fruit hang in bunches
            other, size = scene.spheres[int(rng.integers(len(scene.spheres)))]
            aside = rng.normal(size=3)
            beside: Float64 = other + (radius + size) * rng.uniform(
                0.95, 1.25
            ) * aside / np.linalg.norm(aside)
            if all(np.linalg.norm(beside - c) > 0.92 * (radius + r) for c, r in scene.spheres):
                scene.spheres.append((beside, radius))
                return beside
            continue
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
            near, far = _DEPTHS[scene.kind]
            depth = 1.0 / rng.uniform(1.0 / far, 1.0 / near)
        centre: Float64 = T[:3, 3] + depth * ray
        if all(
            np.linalg.norm(centre - other) > gap * (radius + size) for other, size in scene.spheres
        ):
            scene.spheres.append((centre, radius))
            return centre
    return None


def _add_fruit(
    fruit: FruitModel,
    options: SceneOptions,
    scene: SyntheticScene,
    style: Float64,
    plain: bool,
    rng: np.random.Generator,
) -> None:
    exact = rng.random() < options.exact
    index = 0 if exact or rng.random() < 0.2 else int(rng.integers(1, 64))
    if exact:
        dimensions = fruit.dimensions.copy()
    else:
        width = rng.uniform(*options.scale) * 0.5 * (fruit.dimensions[0] + fruit.dimensions[2])
        oval = rng.normal(0.0, 0.02)
        own_ratio = fruit.dimensions[1] / (0.5 * (fruit.dimensions[0] + fruit.dimensions[2]))
        dimensions = width * np.array(
            [1.0 + oval, own_ratio * rng.uniform(*options.height_ratio), 1.0 - oval]
        )
    shape = shapes.fruit_relative(fruit, index)
    stretch = dimensions / fruit.dimensions
    rotation = _fruit_rotation(scene.kind, rng)
    lowest = -float(((shape.vertices * stretch) @ rotation[2]).min())
    centre = _place(
        scene, options, 0.5 * float(dimensions.max()), lowest, rng.uniform(0.92, 1.3), rng
    )
    if centre is None:
        return
    albedo = (
        plain_paint(shape, style, rng) if plain else skin_paint(shape, skins(fruit), style, rng)
    )
    gloss = (
        rng.uniform(0.0, 0.45),
        10.0 ** rng.uniform(0.7, 2.1),
        0.0 if plain else rng.uniform(0.0, 0.14),
    )
    order = len(scene.truths)
    open_hollows = 0.0 if plain and rng.random() < 0.7 else 1.0
    scene.items.append(
        Item(
            shape,
            rotation,
            stretch,
            centre,
            albedo,
            rng.uniform(300.0, 2500.0),
            gloss,
            order,
            open_hollows,
        )
    )
    has_stem = rng.random() < (0.5 if plain else 0.72) and fruit.stem is not None
    scene.truths.append((rotation, centre, dimensions, has_stem))
    if has_stem:
        part = shapes.stem(int(rng.integers(0, 16)))
        brown = np.array([0.10, 0.06, 0.03]) * rng.uniform(0.4, 3.0) * rng.uniform(0.8, 1.2, 3)
        paint = np.broadcast_to(brown.astype(np.float32), part.vertices.shape)
        thick = stretch * np.array([1.0, 1.0, 1.0])
        scene.items.append(
            Item(part, rotation, thick, centre, paint, 900.0, (0.02, 10.0, 0.1), order)
        )


def _add_decoy(
    options: SceneOptions, scene: SyntheticScene, style: Float64, rng: np.random.Generator
) -> None:
    """Balls, capsules, boxes, cylinders, turned bodies; many in the fruit's own colours."""
    choice = rng.choice(
        ["ball", "capsule", "box", "cylinder", "turned"], p=[0.28, 0.2, 0.2, 0.12, 0.2]
    )
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
        shape = shapes.box()
        scale = rng.uniform(0.012, 0.07, 3)
    elif choice == "cylinder":
        shape = shapes.cylinder()
        scale = np.array([1.0, rng.uniform(0.3, 2.0), 1.0]) * rng.uniform(0.015, 0.045)
    else:
        shape = shapes.turned_body(rng)
        scale = np.full(3, rng.uniform(0.018, 0.04))
    rotation = _random_rotation(rng)
    extent = np.abs(shape.vertices * scale)
    radius = float(min(extent.max(), 0.09))
    lowest = -float(((shape.vertices * scale) @ rotation[2]).min())
    centre = _place(scene, options, 0.8 * radius, lowest, rng.uniform(0.8, 1.3), rng)
    if centre is None:
        return
    if rng.random() < 0.55:
        paint = plain_paint(shape, style, rng)
    else:
        colour = rng.uniform(0.02, 0.85) * np.exp(rng.normal(0.0, 0.5, 3))
        paint = np.broadcast_to(colour.astype(np.float32), shape.vertices.shape)
    if rng.random() < 0.3:
        bands = np.sin(
            shape.vertices[:, 1] * rng.uniform(1.0, 8.0)
            + shape.vertices[:, 0] * rng.uniform(0.0, 6.0)
        )
        paint = paint * (1.0 + 0.6 * np.sign(bands)[:, None]).astype(np.float32) * np.float32(0.7)
    gloss = (
        rng.uniform(0.0, 0.5),
        10.0 ** rng.uniform(0.7, 2.1),
        rng.uniform(0.0, 0.3) * (rng.random() < 0.5),
    )
    scene.items.append(
        Item(shape, rotation, scale, centre, paint, rng.uniform(100.0, 2500.0), gloss)
    )
    scene.decoys.append((centre, radius))


def _add_leaves(options: SceneOptions, scene: SyntheticScene, rng: np.random.Generator) -> None:
    """Leaves and twigs between, before and behind the fruit."""
    T = scene.T_world_camera
    fx, fy, cx, cy = options.camera
    for _ in range(int(rng.integers(4, 22))):
        u = rng.uniform(0, options.width)
        v = rng.uniform(0, options.height)
        depth = rng.uniform(0.3, 1.3)
        centre = T[:3, 3] + T[:3, :3] @ (np.array([(u - cx) / fx, (v - cy) / fy, 1.0]) * depth)
        green = (
            np.array([0.08, 0.20, 0.03]) * np.exp(rng.normal(0.0, 0.4, 3)) * rng.uniform(0.5, 1.8)
        )
        shape = shapes.leaf(int(rng.integers(0, 32)))
        paint = np.broadcast_to(green.astype(np.float32), shape.vertices.shape)
        size = np.full(3, rng.uniform(0.03, 0.10))
        scene.items.append(
            Item(shape, _random_rotation(rng), size, centre, paint, 800.0, (0.1, 12.0, 0.15))
        )
    for _ in range(int(rng.integers(0, 4))):
        u = rng.uniform(0, options.width)
        v = rng.uniform(0, options.height)
        centre = T[:3, 3] + T[:3, :3] @ (
            np.array([(u - cx) / fx, (v - cy) / fy, 1.0]) * rng.uniform(0.45, 1.3)
        )
        shape = shapes.capsule(1.0, rng.uniform(0.008, 0.04))
        brown = np.array([0.14, 0.10, 0.07]) * rng.uniform(0.3, 1.8)
        paint = np.broadcast_to(brown.astype(np.float32), shape.vertices.shape)
        size = np.full(3, rng.uniform(0.2, 0.5))
        scene.items.append(
            Item(shape, _random_rotation(rng), size, centre, paint, 600.0, (0.02, 8.0, 0.3))
        )


def _add_finger(scene: SyntheticScene, rng: np.random.Generator) -> None:
    """Bars close to the camera that reach into the picture from one side, as a gripper's fingers do."""
    T = scene.T_world_camera
    side = rng.uniform(0.0, 2.0 * np.pi) if rng.random() < 0.4 else -0.5 * np.pi
    outwards = np.array([np.cos(side), np.sin(side), 0.0])
    grey = np.full(3, rng.uniform(0.02, 0.5)) * rng.uniform(0.85, 1.15, 3)
    for sign in (-1.0, 1.0):
        across = np.array([-outwards[1], outwards[0], 0.0]) * sign * rng.uniform(0.015, 0.055)
        centre = (
            outwards * rng.uniform(0.07, 0.13)
            + across
            + np.array([0.0, 0.0, rng.uniform(0.13, 0.24)])
        )
        R = T[:3, :3] @ np.stack(
            [outwards, [-outwards[1], outwards[0], 0.0], [0.0, 0.0, 1.0]], axis=1
        )
        scale = np.array(
            [rng.uniform(0.008, 0.05), rng.uniform(0.004, 0.012), rng.uniform(0.01, 0.05)]
        )
        paint = np.broadcast_to(grey.astype(np.float32), shapes.box().vertices.shape)
        world = T[:3, 3] + T[:3, :3] @ centre
        scene.items.append(
            Item(shapes.box(), R, scale, world, paint, 500.0, (rng.uniform(0.0, 0.6), 30.0, 0.0))
        )
