"""A carried load stays upright on the whole path, not only at its ends."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from pomona.drivers.interfaces import Box
from pomona.skills.geometry import transform
from pomona.skills.motion.planning.arm_space import SLACK, ArmSpace, UprightSpace, arm_space
from pomona.skills.motion.planning.plan import PlanRequest, plan
from tests.skills.picking_scene import ROBOT_MODEL, WORKSPACE, PickingScene, a_grasp

START = a_grasp(1, 3).q_pre_grasp[0]
GOAL = np.array([-1.922, -0.388, 1.301, -0.034, -0.382, -1.637, 0.167])
"""The tool is as plumb there, and the straight way to it tilts it by 21°."""
UP = ROBOT_MODEL.tcp(START)[2, :3]


def tilts(path: np.ndarray, per_segment: int = 20) -> np.ndarray:
    """Return the angles between the load's up and the world's along straight segments, computed independently."""
    found = []
    for a, b in itertools.pairwise(path):
        for share in np.linspace(0.0, 1.0, per_segment):
            up = (
                ROBOT_MODEL.fk(a + share * (b - a))[:3, :3]
                @ ROBOT_MODEL.fk(START)[:3, :3].T
                @ [0.0, 0.0, 1.0]
            )
            found.append(np.arctan2(np.linalg.norm(up[:2]), up[2]))
    return np.array(found)


def around(*obstacles: Box) -> ArmSpace:
    scene = PickingScene()
    workspace = replace(WORKSPACE, obstacles=(*WORKSPACE.obstacles, *obstacles))
    return arm_space(scene.arm, workspace, None, 0.08, 0.005)


@pytest.mark.parametrize("degrees", [5.0, 15.0])
@pytest.mark.parametrize("obstructed", [False, True])
def test_a_planned_and_timed_path_keeps_it_upright_everywhere(
    degrees: float, obstructed: bool
) -> None:
    middle = ROBOT_MODEL.tcp((START + GOAL) / 2.0)[:3, 3]
    post = Box("post", transform(None, middle - (0.0, 0.0, 0.05)), (0.03, 0.03, 0.12))
    inner = around(post) if obstructed else around()
    space = UprightSpace(inner, UP, np.radians(degrees))
    limits = PickingScene().arm.limits
    result = plan(
        PlanRequest(space, START, GOAL[None], limits, improve="", budget=2.0, seed=3, patience=60.0)
    )
    np.testing.assert_allclose(result.path.q[-1], GOAL, atol=1e-9)
    assert np.degrees(tilts(result.path.q, 3)).max() < degrees + np.degrees(2.0 * SLACK)
    assert inner.first_blocked(result.path.q) is None
    if obstructed:
        assert inner.first_blocked(np.array([START, GOAL])) is not None


def test_without_the_bound_the_same_way_tilts_it() -> None:
    result = plan(
        PlanRequest(around(), START, GOAL[None], PickingScene().arm.limits, improve="", seed=3)
    )
    assert np.degrees(tilts(result.path.q, 3)).max() > 15.5


@pytest.mark.slow
def test_a_segment_is_free_only_where_every_point_of_it_is() -> None:
    rng = np.random.default_rng(5)
    space = UprightSpace(around(), UP, np.radians(15.0))
    said = []
    for _ in range(200):
        a, b = (START + rng.normal(0.0, 0.12, START.size) for _ in range(2))
        largest = tilts(np.array([a, b]), 200).max()
        free = not space._tilted_between(a, b, 0.0)
        if free:
            assert largest <= space.most + SLACK
        else:
            assert largest > space.most - SLACK
        said.append(free)
    assert 20 < sum(said) < 180


def test_too_narrow_a_bound_is_reported_for_a_posture() -> None:
    space = UprightSpace(around(), UP, np.radians(5.0))
    tilted = START.copy()
    tilted[5] += 0.2
    words, data = space.explain(tilted)
    assert "tilted by 11°, 5° are allowed" in words
    assert data["tilt_rad"] == pytest.approx(0.2, abs=0.01)
    assert not space.free(tilted)
