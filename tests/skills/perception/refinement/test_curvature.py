"""Other objects: walls, posts and leaves that agree with a part of the model, beside partly visible fruit."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from pomona.drivers.depth_model import SIMULATED
from pomona.drivers.interfaces import Intrinsics
from pomona.skills.geometry import rot_x, rot_y, rotation_about, transform
from pomona.skills.perception.fruit import load_fruit
from pomona.skills.perception.refinement import DepthLook, refine
from pomona.skills.perception.refinement.curvature import least_curvature
from pomona.skills.perception.refinement.errors import RefineError
from pomona.skills.perception.refinement.render import Limits, render_depth

CAMERA = Intrinsics(305.3, 305.3, 159.5, 119.5, 320, 240)
APPLE = load_fruit("apple")
V, U = np.mgrid[:240, :320]
RAYS = np.stack([(U - CAMERA.cx) / CAMERA.fx, (V - CAMERA.cy) / CAMERA.fy, np.ones(U.shape)], -1)


def noisy(depth: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    measured = depth + rng.normal(0.0, 1.2e-3, depth.shape) * depth**2
    return np.where(depth > 0.0, measured, 0.0).astype(np.float32)


def plane(z: float, tilt: float, about: np.ndarray) -> np.ndarray:
    normal = rotation_about(about, tilt) @ np.array([0.0, 0.0, -1.0])
    depth = (normal[2] * z) / (RAYS @ normal)
    return np.where((depth > 0.0) & (depth < 6.0), depth, 0.0)


def post(z: float, radius: float, along: np.ndarray) -> np.ndarray:
    across = RAYS - (RAYS @ along)[..., None] * along
    centre = np.array([0.0, 0.0, z])
    square, product = (across**2).sum(-1), across @ centre
    root = product**2 - square * (z**2 - radius**2)
    return np.where(root > 0.0, (product - np.sqrt(np.maximum(root, 0.0))) / square, 0.0)


def look(depth: np.ndarray) -> DepthLook:
    return DepthLook(depth, CAMERA, SIMULATED, renderer="zbuffer")


@pytest.mark.parametrize("kind", ["wall", "post"])
def test_a_wall_and_a_post_are_no_fruit(kind: str) -> None:
    ends: Counter[str] = Counter()
    for seed in range(16):
        rng = np.random.default_rng(seed)
        z, angle = rng.uniform(0.4, 1.0), rng.uniform(0.0, 2.0 * np.pi)
        about = np.array([np.cos(angle), np.sin(angle), 0.0])
        depth = (
            plane(z, rng.uniform(0.0, 1.2), about)
            if kind == "wall"
            else post(z, rng.uniform(0.03, 0.12), about)
        )
        turn = rotation_about(np.array([0.6, 0.0, 0.8]), rng.uniform(0.0, 6.0))
        T = transform(turn, (0.0, 0.0, z * rng.uniform(0.8, 1.25)))
        for method in ("uniform", "shape") if seed < 3 else ("uniform",):
            try:
                refine(look(noisy(depth, rng)), T, APPLE, method=method)  # type: ignore[arg-type]
                ends["measured"] += 1
            except RefineError as error:
                ends[error.code] += 1
    assert ends["measured"] == 0
    assert ends["NOT_ITS_SHAPE"] >= 5


@pytest.mark.parametrize("hidden", [0.0, 0.5])
def test_fruit_is_as_curved_as_its_model_whole_and_half_hidden(hidden: float) -> None:
    for seed in range(12):
        rng = np.random.default_rng(seed)
        T = transform(
            rot_x(rng.uniform(-1.5, -0.2)) @ rot_y(rng.uniform(0.0, 6.0)), (0.0, 0.0, 0.5)
        )
        stretch = rng.uniform(0.7, 1.0) * np.array([1.0, rng.uniform(0.9, 1.1), 1.0])
        stretched = T.copy()
        stretched[:3, :3] *= stretch
        T[:3, 3] /= stretch.mean()
        virtual, box = render_depth(APPLE, stretched, CAMERA, using="zbuffer")
        depth = np.zeros(U.shape)
        depth[box.slices] = virtual
        depth[:, : round(box.left + hidden * virtual.shape[1])] = 0.42 if hidden else 0.0
        result = refine(look(noisy(depth, rng)), T, APPLE)
        found = least_curvature(
            noisy(depth, rng)[result.box.slices], result.virtual_depth, result.inliers, 4e-3, 12.0
        )
        assert found is None or found.least + 2.0 * found.deviation > 0.6


def test_a_leaf_in_front_that_agrees_with_a_smaller_fruit_is_reported() -> None:
    T = transform(rot_x(-0.9), (0.0, 0.0, 0.6))
    virtual, box = render_depth(APPLE, T, CAMERA, using="zbuffer")
    depth = np.zeros(U.shape)
    depth[box.slices] = virtual
    left, right = box.left - 5, round(box.left + 0.8 * virtual.shape[1])
    depth[box.top : box.bottom, left:right] = 0.53
    measured = noisy(depth, np.random.default_rng(0))
    with pytest.raises(RefineError) as error:
        refine(look(measured), T, APPLE, limits=Limits(min_inliers=0.2))
    assert error.value.code == "NOT_ITS_SHAPE"
    assert "a wall, a post or a leaf" in str(error.value)


def test_too_few_pixels_give_no_curvature() -> None:
    flat = np.full((6, 6), 0.5, np.float32)
    assert least_curvature(flat, flat, np.ones((6, 6), np.bool_), 4e-3, 12.0) is None
