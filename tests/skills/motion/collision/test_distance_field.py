"""The distance field never promises more room than there is, and little less."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings, strategies as st
from py_trees.common import Status
from scipy.ndimage import distance_transform_edt
from scipy.optimize import nnls

from pomona.drivers.interfaces import Hull
from pomona.drivers.workspace import read_parts
from pomona.executive.skill_testing import drive
from pomona.skills.motion.collision import CollisionWorld, Convex, DistanceField
from pomona.skills.motion.collision.distance_field import INTERPOLATION_ERROR
from pomona.skills.move_to import MoveTo
from tests.skills.picking_scene import OBSERVE, ROBOT_MODEL, WORKSPACE, PickingScene

RESOLUTION, LIMIT = 0.02, 0.30
ORIGIN = np.array([-0.2, 0.1, 0.3])


def grid(seed: int, shape: tuple[int, int, int] = (17, 13, 15), share: float = 0.01) -> np.ndarray:
    blocked = np.random.default_rng(seed).uniform(size=shape) < share
    blocked[3, 4, 5] = True
    return blocked


def distance_to_cubes(points: np.ndarray, blocked: np.ndarray) -> np.ndarray:
    lower = ORIGIN + np.argwhere(blocked) * RESOLUTION
    outside = np.maximum(
        np.maximum(lower[None] - points[:, None], points[:, None] - lower[None] - RESOLUTION), 0.0
    )
    return np.linalg.norm(outside, axis=2).min(axis=1)


@settings(max_examples=25)
@given(st.integers(0, 10_000))
def test_inside_the_grid_the_field_bounds_the_distance_from_below_and_closely(seed: int) -> None:
    blocked = grid(seed)
    field = DistanceField.of_blocked(blocked, ORIGIN, RESOLUTION, LIMIT)
    upper = ORIGIN + np.array(blocked.shape) * RESOLUTION
    points = np.random.default_rng(seed).uniform(ORIGIN, upper, (400, 3))
    told, true = field.distance(points), distance_to_cubes(points, blocked)
    assert np.all(told <= true + 1e-6)
    assert np.all(
        told >= true - (INTERPOLATION_ERROR + np.sqrt(0.75)) * RESOLUTION
    )  # half a diagonal of a cell


@settings(max_examples=10)
@given(st.integers(0, 10_000))
def test_outside_the_grid_the_field_still_bounds_from_below(seed: int) -> None:
    blocked = grid(seed)
    field = DistanceField.of_blocked(blocked, ORIGIN, RESOLUTION, LIMIT)
    points = np.random.default_rng(seed).uniform(ORIGIN - 0.3, ORIGIN + 0.8, (400, 3))
    assert np.all(field.distance(points) <= distance_to_cubes(points, blocked) + 1e-6)


def test_the_worst_interpolation_error_is_beside_a_corner_and_within_its_bound() -> None:
    blocked = np.zeros((4, 4, 4), dtype=bool)
    blocked[0, 0, 0] = True
    field = DistanceField.of_blocked(blocked, np.zeros(3), 1.0, 100.0)
    shares = np.linspace(0.0, 1.0, 41)
    points = np.stack(np.meshgrid(shares, shares, shares), axis=-1).reshape(-1, 3) + 1.0
    true = np.linalg.norm(points - 1.0, axis=1)
    worst = float((field.distance(points) + INTERPOLATION_ERROR - true).max())
    assert 0.25 < worst < INTERPOLATION_ERROR


def test_the_field_equals_scipys_transform_at_the_corners() -> None:
    blocked = grid(5, (30, 25, 20), 0.003)
    corners = np.zeros(np.add(blocked.shape, 1), dtype=bool)
    for i, j, k in np.argwhere(blocked):
        corners[i : i + 2, j : j + 2, k : k + 2] = True
    expected = np.minimum(distance_transform_edt(~corners) * RESOLUTION, LIMIT)
    field = DistanceField.of_blocked(blocked, ORIGIN, RESOLUTION, LIMIT)
    assert np.allclose(field.values, expected, atol=1e-6)


def test_an_empty_grid_is_as_far_as_the_limit() -> None:
    field = DistanceField.of_blocked(np.zeros((5, 6, 7), dtype=bool), ORIGIN, RESOLUTION, LIMIT)
    assert np.allclose(field.values, LIMIT)


FAR = OBSERVE + np.array([1.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000), st.integers(4, 30))
def test_a_hull_contains_its_points_and_bounds_the_distance_from_below(
    seed: int, count: int
) -> None:
    rng = np.random.default_rng(seed)
    points = rng.uniform(-0.3, 0.3, (count, 3))
    convex = Convex.of_hull(Hull("part", points, np.eye(3)))
    weights = rng.dirichlet(np.ones(count), 50)
    assert convex.distance(weights @ points).max() < 1e-9
    outside = rng.uniform(-1.0, 1.0, (50, 3))
    # The nearest convex combination of the points, by least squares with the weights' sum held at 1.
    combined = np.vstack((points.T, np.full(count, 1e3)))
    true = np.array([nnls(combined, np.append(point, 1e3))[1] for point in outside])
    assert np.all(convex.distance(outside) <= true + 1e-4)


def test_before_its_faces_the_distance_is_exact(tmp_path: Path) -> None:
    turn = trimesh.transformations.rotation_matrix(0.4, (0.3, 1.0, 0.2))
    path = tmp_path / "board.stl"
    trimesh.creation.box((0.4, 0.3, 0.02), turn).export(path)
    (part,) = read_parts(path)
    point = turn[:3, :3] @ [0.05, 0.03, 0.01 + 0.07]
    assert abs(Convex.of_hull(part).distance(point[None])[0] - 0.07) < 2e-4


@pytest.mark.slow
def test_a_planner_goes_around_a_mesh(tmp_path: Path) -> None:
    path = tmp_path / "post.stl"
    middle = ROBOT_MODEL.tcp((FAR + OBSERVE) / 2.0)[:3, 3]
    trimesh.creation.cylinder(0.07, 0.15).apply_translation(middle).export(path)
    workspace = replace(
        WORKSPACE, hulls=tuple(replace(part, name="post") for part in read_parts(path, detail=0.08))
    )
    scene = PickingScene(q=FAR.copy(), workspace=workspace)
    outcome = drive(MoveTo(), {"pose": "observe"}, scene.devices, clock=scene.clock)
    assert outcome.status is Status.SUCCESS
    world = CollisionWorld.build(ROBOT_MODEL, workspace)
    hit = world.check_path(np.array([FAR, OBSERVE]), scene.width)
    assert hit is not None
    assert hit.other == "post"
    assert world.check_path(scene.arm.followed[0].q, scene.width) is None
