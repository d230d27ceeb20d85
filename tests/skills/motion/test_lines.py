from dataclasses import replace

import numpy as np
import pytest

from pomona.skills.geometry import rot_x, transform
from pomona.skills.motion.lines import straight_line
from tests.skills.picking_scene import OBSERVE, ROBOT_MODEL


def goal_along_approach(way: float) -> np.ndarray:
    T = ROBOT_MODEL.tcp(OBSERVE)
    T[:3, 3] += way * T[:3, 2]
    return T


def test_the_tool_stays_on_the_line_and_keeps_its_orientation():
    T_start, T_goal = ROBOT_MODEL.tcp(OBSERVE), goal_along_approach(0.12)
    line = straight_line(ROBOT_MODEL, OBSERVE, T_goal)
    assert line.complete
    assert line.length == pytest.approx(0.12)
    np.testing.assert_array_equal(line.q[0], OBSERVE)
    for share, q in zip(np.linspace(0.0, 1.0, len(line.q)), line.q, strict=True):
        T = ROBOT_MODEL.tcp(q)
        np.testing.assert_allclose(
            T[:3, 3], T_start[:3, 3] + share * 0.12 * T_start[:3, 2], atol=1e-8
        )
        np.testing.assert_allclose(T[:3, :3], T_start[:3, :3], atol=1e-8)


def test_between_two_poses_the_tool_leaves_the_line_by_micrometres():
    T_start = ROBOT_MODEL.tcp(OBSERVE)
    line = straight_line(ROBOT_MODEL, OBSERVE, goal_along_approach(0.12))
    for a, b in zip(line.q[:-1], line.q[1:], strict=True):
        offset = ROBOT_MODEL.tcp((a + b) / 2.0)[:3, 3] - T_start[:3, 3]
        assert np.linalg.norm(offset - (offset @ T_start[:3, 2]) * T_start[:3, 2]) < 2e-5


def test_joints_change_steadily():
    line = straight_line(ROBOT_MODEL, OBSERVE, goal_along_approach(0.12))
    assert np.abs(np.diff(line.q, axis=0)).max() < 0.05
    assert np.abs(np.diff(line.q, 2, axis=0)).max() < 0.005


def test_a_goal_with_another_orientation_is_reached_evenly():
    T_goal = goal_along_approach(0.06) @ transform(rot_x(0.2))
    line = straight_line(ROBOT_MODEL, OBSERVE, T_goal)
    np.testing.assert_allclose(ROBOT_MODEL.tcp(line.q[-1]), T_goal, atol=1e-8)
    halfway = ROBOT_MODEL.tcp(line.q[len(line.q) // 2])
    turned = ROBOT_MODEL.tcp(OBSERVE)[:3, :3].T @ halfway[:3, :3]
    assert np.arccos((np.trace(turned) - 1.0) / 2.0) == pytest.approx(0.1, abs=0.02)


def test_beyond_reach_the_failure_states_the_reached_distance():
    line = straight_line(ROBOT_MODEL, OBSERVE, goal_along_approach(0.8))
    assert not line.complete
    assert 0.0 < line.reached < 1.0
    assert line.reason


def test_a_joint_limit_ends_the_line():
    model = replace(ROBOT_MODEL, upper=np.where(np.arange(7) == 3, -0.2, ROBOT_MODEL.upper))
    line = straight_line(model, OBSERVE, goal_along_approach(-0.2))
    free = straight_line(ROBOT_MODEL, OBSERVE, goal_along_approach(-0.2))
    assert line.reason == "a joint is at its limit"
    assert line.q[-1][3] <= -0.2 + 1e-9 < free.q[-1][3]
