"""Backdrop, table and lights of a synthetic scene."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float32, Float64
from pomona.skills.perception.fruit import FruitModel
from pomona.tools.training import textures
from pomona.tools.training.contents import SyntheticScene
from pomona.tools.training.foliage import add_far_fruit
from pomona.tools.training.options import SceneKind, SceneOptions
from pomona.tools.training.paint import skins
from pomona.tools.training.raster import shadow_map

SHADOW_CELLS = 320


def draw_backdrop(
    fruit: FruitModel, options: SceneOptions, scene: SyntheticScene, rng: np.random.Generator
) -> Float32:
    """Return the picture behind everything, (h, w, 3) float32."""
    index = int(rng.integers(0, 160))
    tree = scene.kind is SceneKind.TREE
    if tree or (scene.kind is SceneKind.ORCHARD and rng.random() < 0.85):
        index = 4 * (index // 4) + 3
    picture = textures.background(index, options.height // 2, options.width // 2)
    if rng.random() < 0.5:
        picture = picture[:, ::-1]
    if rng.random() < 0.3:
        picture = picture[::-1]
    picture = cv2.resize(np.ascontiguousarray(picture), (options.width, options.height))
    if tree:
        add_far_fruit(picture, skins(fruit), rng)
        if rng.random() < 0.5:
            picture = cv2.GaussianBlur(picture, (0, 0), rng.uniform(0.5, 3.0))
        if rng.random() < 0.5:  # against the light: the sky is far brighter than the tree
            picture = picture * np.float32(rng.uniform(1.0, 5.0))
    cast = np.exp(rng.normal(0.0, 0.25)) * np.exp(rng.normal(0.0, 0.1, 3))
    return np.asarray(picture * cast, np.float32)


def set_lights(
    scene: SyntheticScene, R_cw: Float64, rng: np.random.Generator
) -> tuple[Float32, Float32, Float32]:
    """One to three lamps (n, 6), direction and colour, which way is up (3,), ambient light (3,); camera frame."""
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


def cast_shadow(
    P: Float32, F: NDArray[np.int32], light: Float32, rng: np.random.Generator
) -> tuple[Float32, Float32]:
    """Shadow map of the key light and the map (3, 4) from camera coordinates to its cells and distance."""
    d = light.astype(np.float64)
    a = np.cross(d, [1.0, 0.0, 0.0] if abs(d[0]) < 0.8 else [0.0, 1.0, 0.0])
    a /= np.linalg.norm(a)
    b = np.cross(d, a)
    axes = np.stack([a, b, -d])
    middle = np.array([0.0, 0.0, 0.6])
    half = 0.55
    cells = 0.5 * SHADOW_CELLS / half
    scaling = np.array([cells, cells, 1.0])
    matrix = np.zeros((3, 4))
    matrix[:, :3] = axes * scaling[:, None]
    matrix[:, 3] = -(axes @ middle) * scaling + np.array(
        [0.5 * SHADOW_CELLS, 0.5 * SHADOW_CELLS, 0.0]
    )
    light_map = matrix.astype(np.float32)
    shadow = shadow_map(P @ light_map[:, :3].T + light_map[:, 3], F, SHADOW_CELLS, 1e6)
    return shadow, light_map


def lay_table(
    scene: SyntheticScene, T_wc: Float64, rng: np.random.Generator
) -> tuple[Float32, Float32, Float32]:
    """Return the table's plane (4,), its texture's axes (2, 4) and its paint (4,), in the camera's frame [m]."""
    R_cw = T_wc[:3, :3].T
    eye = T_wc[:3, 3]
    normal = R_cw[:, 2]
    offset = -float(eye[2]) if scene.table else 0.0
    turn = rng.uniform(0.0, 2.0 * np.pi)
    s = np.array([np.cos(turn), np.sin(turn), 0.0])
    t = np.array([-np.sin(turn), np.cos(turn), 0.0])
    axes = np.array([[*(R_cw @ s), -(s @ eye)], [*(R_cw @ t), -(t @ eye)]], np.float32)
    reach = rng.uniform(0.25, 0.6) if rng.random() < 0.3 else 9.0
    look = [
        rng.uniform(200.0, 1500.0),
        rng.uniform(0.0, 0.25) * (rng.random() < 0.4),
        rng.uniform(5.0, 60.0),
        reach,
    ]
    return np.array([*normal, offset], np.float32), axes, np.array(look, np.float32)
