"""The convex hull of a mesh part contains it, and is no larger than necessary at its faces."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import trimesh
from hypothesis import given, settings, strategies as st
from py_trees.common import Status
from scipy.optimize import nnls

from pomona.drivers.interfaces import Hull
from pomona.drivers.workspace import read_parts
from pomona.executive.skill_testing import drive
from pomona.skills.motion.collision import CollisionWorld, Convex
from pomona.skills.move_to import MoveTo
from tests.skills.picking_scene import OBSERVE, ROBOT_MODEL, WORKSPACE, PickingScene

FAR = OBSERVE + np.array([1.2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000), st.integers(4, 30))
def test_a_hull_contains_its_points_and_bounds_the_distance_from_below(seed: int, count: int) -> None:
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


def test_a_planner_goes_around_a_mesh(tmp_path: Path) -> None:
    path = tmp_path / "post.stl"
    middle = ROBOT_MODEL.tcp((FAR + OBSERVE) / 2.0)[:3, 3]
    trimesh.creation.cylinder(0.07, 0.15).apply_translation(middle).export(path)
    workspace = replace(WORKSPACE, hulls=tuple(replace(part, name="post") for part in read_parts(path, detail=0.08)))
    scene = PickingScene(q=FAR.copy(), workspace=workspace)
    outcome = drive(MoveTo(), {"pose": "observe"}, scene.devices, clock=scene.clock)
    assert outcome.status is Status.SUCCESS
    world = CollisionWorld.build(ROBOT_MODEL, workspace)
    hit = world.check_path(np.array([FAR, OBSERVE]), scene.width)
    assert hit is not None
    assert hit.other == "post"
    assert world.check_path(scene.arm.followed[0].q, scene.width) is None
