"""SampleHanging: grasps of a hanging fruit that can be rolled, level ones first, each once."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from py_trees.common import Status

from pomona.applications.harvest.hanging import free_roll, hanging_orientation, knuckle_of
from pomona.applications.harvest.sample_hanging import SampleHanging
from pomona.drivers.interfaces import Arm, Box, Workspace
from pomona.executive.skill_testing import SkillEnd, drive
from pomona.skills.geometry import transform
from pomona.skills.motion.lines import straight_line
from pomona.skills.motion.occupancy import OccupancyMap
from pomona.skills.motion.planning.arm_space import arm_space
from pomona.skills.motion.robot import RobotModel
from pomona.skills.perception.measured_fruit import MeasuredFruit
from pomona.tools.mock import MockArm, MockClock
from pomona.tools.mock.arm import ROBOT
from tests.skills.picking_scene import apple_at

OBSERVE = np.array([-1.538, -1.243, -0.002, -0.952, 0.059, -0.571, -0.057])
DOWN = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
ROBOT_MODEL = RobotModel.load(ROBOT)
FREE = Workspace(table_z=None, lower=np.array([-0.8, -1.1, -0.4]), upper=np.array([0.8, 0.3, 1.1]))


def hanging_at(x: float, y: float, z: float) -> MeasuredFruit:
    return replace(
        apple_at(1, 1),
        T_base_fruit=transform(DOWN, [x, y, z]),
        dimensions=np.array([0.076, 0.068, 0.076]),
    )


def sample(
    fruit: MeasuredFruit,
    skill: SampleHanging | None = None,
    workspace: Workspace = FREE,
    **inputs: Any,
) -> SkillEnd:
    clock = MockClock()
    devices: dict[type, object] = {Arm: MockArm(clock, OBSERVE), Workspace: workspace}
    return drive(skill or SampleHanging(), {"around": fruit, **inputs}, devices, clock=clock)


def test_candidates_are_level_first_and_roll_far_enough() -> None:
    fruit = hanging_at(0.0, -0.6, 0.4)
    end = sample(fruit)
    assert end.status is Status.SUCCESS, end.reason
    grasps = end.outputs["candidates"].grasps
    assert np.degrees(grasps[0].theta) == pytest.approx(90.0)
    for grasp in grasps:
        assert grasp.T_base_grasp[:3, 3] == pytest.approx([0.0, -0.6, 0.4], abs=0.01)
        assert 0.076 < grasp.width <= 0.103
        for q in grasp.q_pre_grasp:
            line = straight_line(ROBOT_MODEL, q, grasp.T_base_grasp)
            rolls = [
                free_roll(ROBOT_MODEL, line.q[-1], knuckle_of(fruit), way, 2.1)
                for way in (1.0, -1.0)
            ]
            assert max(rolls) >= np.radians(70.0)


def test_a_candidate_that_was_tried_is_not_given_again_for_the_same_fruit() -> None:
    skill, fruit = SampleHanging(), hanging_at(0.0, -0.6, 0.4)
    first = sample(fruit, skill).outputs["candidates"].grasps[0]
    second = sample(fruit, skill, tried=first).outputs["candidates"]
    assert first.index not in {grasp.index for grasp in second.grasps}
    assert second.attempt == 2
    elsewhere = sample(hanging_at(0.2, -0.6, 0.4), skill, tried=first).outputs["candidates"]
    assert elsewhere.attempt == 1
    again = sample(fruit, skill, tried=elsewhere.grasps[0]).outputs[
        "candidates"
    ]  # in a later round
    assert first.index not in {grasp.index for grasp in again.grasps}


def test_a_large_fruit_measured_within_four_millimetres_has_candidates() -> None:
    fruit = replace(hanging_at(0.0, -0.6, 0.4), dimensions=np.array([0.088, 0.078, 0.088]))
    end = sample(replace(fruit, covariance=np.eye(6) * 0.004**2))
    assert end.status is Status.SUCCESS, end.reason


def test_a_fruit_beyond_the_arm_has_no_candidate_and_the_reasons_are_counted() -> None:
    end = sample(hanging_at(0.0, -1.6, 0.4))
    assert end.reason is not None
    assert end.reason.code == "NO_CANDIDATE"
    assert "200 unreachable" in end.reason.message


def test_a_map_that_is_too_old_is_not_used() -> None:
    old = OccupancyMap.empty(FREE.lower, FREE.upper, 0.02)
    end = sample(hanging_at(0.0, -0.6, 0.4), map=old)
    assert end.reason is not None
    assert end.reason.code == "MAP_STALE"


def test_an_obstacle_beside_the_fruit_ends_the_roll_on_its_side() -> None:
    fruit = hanging_at(0.0, -0.6, 0.4)
    grasp = sample(fruit).outputs["candidates"].grasps[0]
    q = straight_line(ROBOT_MODEL, grasp.q_pre_grasp[0], grasp.T_base_grasp).q[-1]
    arm = MockArm(MockClock(), q)
    side = grasp.T_base_grasp[:3, 1] * (0.076 / 2.0 + 0.05) + np.array([0.0, 0.0, 0.06])
    blocks = replace(
        FREE,
        obstacles=(
            Box("branch", transform(None, fruit.T_base_fruit[:3, 3] + side), (0.01, 0.1, 0.01)),
        ),
    )
    free, blocked = (
        arm_space(arm, place, None, 0.08, 0.004, target=fruit) for place in (FREE, blocks)
    )
    ways = (1.0, -1.0)
    before = [free_roll(ROBOT_MODEL, q, knuckle_of(fruit), way, 2.0, free) for way in ways]
    after = [free_roll(ROBOT_MODEL, q, knuckle_of(fruit), way, 2.0, blocked) for way in ways]
    assert min(after) < 0.5 * min(before)


def test_orientations_point_at_the_wall_with_the_fingers_level() -> None:
    R = hanging_orientation(0.0, 0.0, 0.0)
    assert R[:, 2] == pytest.approx([0.0, -1.0, 0.0])
    assert R[2, 1] == pytest.approx(0.0)
    assert np.linalg.det(R) == pytest.approx(1.0)
    assert hanging_orientation(0.0, 0.3, 0.0)[2, 2] == pytest.approx(np.sin(0.3))


def test_a_stem_that_leans_too_far_is_taken_as_vertical() -> None:
    fruit = hanging_at(0.0, -0.6, 0.4)
    height = 0.025 + 0.44 * 0.068
    assert knuckle_of(fruit) - fruit.T_base_fruit[:3, 3] == pytest.approx([0.0, 0.0, height])
    lying = replace(fruit, T_base_fruit=transform(np.eye(3), fruit.T_base_fruit[:3, 3]))
    assert knuckle_of(lying) - fruit.T_base_fruit[:3, 3] == pytest.approx([0.0, 0.0, height])
