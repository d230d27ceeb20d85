"""Scenes for the tests of Refine: fruit on a table, as a D435i-like camera sees it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from benchmarks.synthetic_depth import StandingFruit, as_d435i, looking_at, standing, true_depth
from pomona.drivers.interfaces import Intrinsics
from pomona.executive.values.arrays import Float64
from pomona.skills.geometry import apply, inverse, rot_y, transform
from pomona.skills.perception.fruit import FruitModel, load_fruit
from pomona.skills.perception.refinement.cloud import Plane, horizontal_plane

PAPER_APPLES = ((89, 81, 89), (91, 85, 91), (93, 73, 93), (73, 64, 73), (62, 47, 62))
"""True dimensions of the paper's five apples [mm]."""

CORNERS = np.array(
    [[1, -1, 1], [-1, -1, 1], [-1, 1, 1], [1, 1, 1], [1, -1, -1], [-1, -1, -1], [-1, 1, -1], [1, 1, -1], [0, 0, 0]]
) / 2.0  # fmt: skip

CLOSE_UP = Intrinsics(610.6, 610.6, 161.3, 119.6, 320, 240)
"""A part of the D435i's image: the scenes render faster."""


@dataclass(frozen=True, eq=False)
class Scene:
    """A camera's frame, a detector's output for it, and the truth."""

    depth: NDArray[np.float32]
    intrinsics: Intrinsics
    T_base_camera: Float64
    T_camera_detected: Float64
    T_camera_true: Float64
    dimensions: Float64
    table: Plane

    def errors(self, T_camera_object: Float64, dimensions: Float64) -> tuple[float, float]:
        """Of the centroid and of the dimensions (norms) [mm]."""
        centroid = np.linalg.norm(T_camera_object[:3, 3] - self.T_camera_true[:3, 3])
        return 1e3 * float(centroid), 1e3 * float(np.linalg.norm(dimensions - self.dimensions))


def detected(
    fruit: StandingFruit, model: FruitModel, T_base_camera: Float64, camera: Intrinsics, rng
) -> Float64:
    """The pose that PnP finds with the CAD cuboid for the true cuboid's corners, seen with 1.5 px of error."""
    T = inverse(T_base_camera) @ fruit.T_base_object
    towards = T[:3, :3].T @ -T[:3, 3]
    T = T @ transform(rot_y(np.arctan2(towards[0], towards[2]) + np.pi + rng.normal(0.0, 0.1)))
    corners = apply(T, CORNERS * fruit.dimensions)
    pixels = corners[:, :2] / corners[:, 2:] * [camera.fx, camera.fy] + [camera.cx, camera.cy]
    pixels += rng.normal(0.0, 1.5, pixels.shape)
    model_corners = CORNERS * model.dimensions
    _, turn, shift = cv2.solvePnP(model_corners, pixels, camera.K, None, flags=cv2.SOLVEPNP_EPNP)
    turn, shift = cv2.solvePnPRefineLM(model_corners, pixels, camera.K, None, turn, shift)
    return transform(cv2.Rodrigues(turn)[0], shift[:, 0])


def make_scene(
    model: FruitModel,
    dimensions_mm: tuple[float, float, float],
    elevation_deg: float,
    seed: int = 0,
    *,
    occluder: Callable[[Float64, Float64], Float64] | None = None,
    camera: Intrinsics = CLOSE_UP,
    lifted: float = 0.0,
    aside: float = 0.0,
) -> Scene:
    """A fruit that stands on the table (or is held `lifted` over it, or is seen `aside` of the image's middle) [m].

    `occluder(true depth, depth of the fruit alone)` may put something in front.
    """
    rng = np.random.default_rng(seed)
    tilt, azimuth = rng.uniform(0.0, np.radians(12.0)), rng.uniform(-np.pi, np.pi)
    lean = tuple(rng.normal(0.0, 0.02, 2))
    fruit = standing(
        model,
        np.array(dimensions_mm) / 1e3,
        (0.0, 0.0),
        tilt,
        azimuth,
        dents=0.004,
        lean=lean,
        rng=rng,
    )
    fruit.T_base_object[2, 3] += lifted
    target = fruit.T_base_object[:3, 3] + np.array([0.0, aside, 0.0])
    T_base_camera = looking_at(target, 0.6, np.radians(elevation_deg))
    depth = true_depth([fruit], T_base_camera, camera)
    if occluder is not None:
        depth = occluder(depth, true_depth([fruit], T_base_camera, camera, table=False))
    T_true = inverse(T_base_camera) @ fruit.T_base_object
    T_detected = detected(fruit, model, T_base_camera, camera, rng)
    return Scene(
        as_d435i(depth, rng, camera), camera, T_base_camera, T_detected, T_true, fruit.dimensions,
        horizontal_plane(T_base_camera, 0.0),
    )  # fmt: skip


@pytest.fixture(scope="session")
def apple() -> FruitModel:
    return load_fruit("apple")


@pytest.fixture
def camera() -> Intrinsics:
    return Intrinsics(610.6, 610.6, 322.3, 241.9, 640, 480)


@pytest.fixture(scope="session")
def scene(apple):
    """`scene(dimensions_mm, elevation_deg, seed, ...)`: see `make_scene`."""
    return lambda *args, **options: make_scene(apple, *args, **options)
