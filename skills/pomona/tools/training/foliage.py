"""A fruit tree from near: sprays of leaves that hang over the fruit and all around it, branches, fruit far behind."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np

from pomona.executive.values.arrays import Float32, Float64
from pomona.tools.training import shapes
from pomona.tools.training.contents import Item, SyntheticScene
from pomona.tools.training.options import SceneOptions
from pomona.tools.training.shapes import ShadedMesh

# different sprays of leaves; each is turned, stretched and coloured anew wherever it grows
SPRAYS = 64

UP = np.array([0.0, 0.0, 1.0])


def grow_tree(options: SceneOptions, scene: SyntheticScene, rng: np.random.Generator) -> None:
    """Put leaves over most fruit of a scene, and leaves and branches everywhere else."""
    eye = scene.T_world_camera[:3, 3]
    # leaves of one tree resemble each other
    hue = rng.uniform(0.0, 1.0)
    thickness = rng.uniform(0.5, 2.0)
    for centre, radius in list(scene.spheres):
        if rng.random() < 0.25:
            continue
        towards_camera = (eye - centre) / np.linalg.norm(eye - centre)
        for _ in range(int(rng.integers(1, 4))):
            # Leaves spring from the twig that the fruit hangs on.
            root = centre + 1.1 * radius * UP + rng.uniform(-0.3, 1.0) * radius * towards_camera
            root = root + rng.normal(0.0, 0.6 * radius, 3)
            along = rng.uniform(-0.3, 0.6) * towards_camera - 0.3 * UP + rng.normal(0.0, 0.6, 3)
            _add_spray(scene, root, along, rng.uniform(0.05, 0.11), hue, rng)
    for _ in range(int(thickness * rng.integers(8, 28))):
        place = _in_view(options, scene, 1.0 / rng.uniform(1.0 / 1.8, 1.0 / 0.4), rng)
        _add_spray(scene, place, rng.normal(size=3) - 0.2 * UP, rng.uniform(0.05, 0.13), hue, rng)
    for _ in range(int(rng.integers(1, 7))):
        place = _in_view(options, scene, rng.uniform(0.5, 1.6), rng)
        _add_branch(scene, place, rng)


def _in_view(
    options: SceneOptions, scene: SyntheticScene, depth: float, rng: np.random.Generator
) -> Float64:
    fx, fy, cx, cy = options.camera
    u = rng.uniform(0.0, options.width)
    v = rng.uniform(0.0, options.height)
    ray = np.array([(u - cx) / fx, (v - cy) / fy, 1.0])
    place: Float64 = scene.T_world_camera[:3, 3] + scene.T_world_camera[:3, :3] @ (depth * ray)
    return place


@lru_cache(maxsize=SPRAYS)
def spray(index: int) -> ShadedMesh:
    """Three to nine leaves of up to unit length along a twig that begins at the origin and points along +z."""
    rng = np.random.default_rng((29, index))
    vertices = []
    faces = []
    for k in range(int(rng.integers(3, 10))):
        leaf = shapes.leaf(int(rng.integers(0, 32)))
        outwards = np.array([0.0, 0.0, 0.8]) + rng.normal(0.0, 0.6, 3)
        turned = leaf.vertices.astype(np.float64) @ _frame(outwards, rng).T
        vertices.append(rng.uniform(0.5, 1.0) * turned + [0.0, 0.0, rng.uniform(0.0, 0.9)])
        faces.append(leaf.faces + k * len(leaf.vertices))
    return shapes.make_shape(np.concatenate(vertices), np.concatenate(faces), two_sided=True)


def _frame(along: Float64, rng: np.random.Generator) -> Float64:
    """Return a rotation that takes +z to `along` (any length), at a random angle about it."""
    z = along / np.linalg.norm(along)
    x = np.cross(z, rng.normal(size=3))
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)


def _add_spray(
    scene: SyntheticScene,
    root: Float64,
    along: Float64,
    length: float,
    hue: float,
    rng: np.random.Generator,
) -> None:
    shape = spray(int(rng.integers(SPRAYS)))
    each = len(shapes.leaf(0).vertices)
    leaves = len(shape.vertices) // each
    green = np.array([0.05 + 0.10 * hue, 0.13 + 0.07 * hue, 0.03])
    tones = green * np.exp(rng.normal(0.0, 0.12, 3)) * np.exp(rng.normal(0.0, 0.35, (leaves, 1)))
    pale = rng.random((leaves, 1)) < 0.2  # the under side
    tones = np.where(pale, 0.5 * tones + 0.12 * np.array([0.9, 1.0, 0.75]), tones)
    yellow = rng.random((leaves, 1)) < 0.04
    tones = np.where(yellow, np.array([0.35, 0.26, 0.06]) * rng.uniform(0.4, 1.2), tones)
    paint = np.repeat(tones, each, axis=0).reshape(leaves, -1, 3, 3)
    paint[:, :, 1] *= rng.uniform(1.0, 1.6)  # the rib in the middle
    scale = length * np.exp(rng.normal(0.0, 0.12, 3))
    look = (rng.uniform(0.0, 0.35), 10.0 ** rng.uniform(0.7, 1.6), rng.uniform(0.0, 0.2))
    albedo = paint.reshape(-1, 3).astype(np.float32)
    scene.items.append(
        Item(shape, _frame(along, rng), scale, root, albedo, rng.uniform(300.0, 1500.0), look)
    )


def _add_branch(scene: SyntheticScene, centre: Float64, rng: np.random.Generator) -> None:
    shape = shapes.capsule(1.0, rng.uniform(0.006, 0.05))
    bark = np.array([0.14, 0.11, 0.09]) * rng.uniform(0.3, 2.2)
    paint = np.broadcast_to(bark.astype(np.float32), shape.vertices.shape)
    size = np.full(3, rng.uniform(0.3, 0.9))
    rotation = _frame(rng.normal(size=3), rng)
    scene.items.append(
        Item(shape, rotation, size, centre, paint, 600.0, (0.02, 8.0, rng.uniform(0.1, 0.5)))
    )


def add_far_fruit(picture: Float32, colours: Float64, rng: np.random.Generator) -> None:
    """Paint fruit of the next rows into a backdrop: too small and too far to be asked for."""
    height, width = picture.shape[:2]
    for _ in range(int(rng.integers(0, 70))):
        radius = rng.uniform(0.002, 0.009) * width
        centre = rng.uniform((0.0, 0.0), (width, height))
        colour = colours[int(rng.integers(len(colours))), 0] * rng.uniform(0.4, 1.3)
        for part, tone in ((1.0, 0.6), (0.7, 1.0), (0.3, 1.3)):
            at = centre - (1.0 - part) * 0.4 * radius
            spot = np.round(at * 8).astype(int).tolist()
            cv2.circle(
                picture,
                spot,
                max(1, round(8 * part * radius)),
                (tone * colour).tolist(),
                -1,
                cv2.LINE_AA,
                3,
            )
