from typing import Any

import numpy as np
import pytest
from py_trees.common import Status

from executive.skill_testing import drive
from skills.release import Release
from tests.skills.picking_scene import HOME, WORKSPACE, PickingScene, a_grasp, scene_with_pose, seen_map

GRASP = a_grasp()
START = GRASP.q_pre_grasp[0]


def over_ground(ground: float | None, **changes: Any) -> PickingScene:
    """A held fruit of 1.5 N above a ground that carries it from a height of the TCP on."""
    scene = PickingScene(q=START.copy(), width=0.08, **changes)

    def feel(_now: float) -> np.ndarray:
        wrenches = np.zeros((2, 6))
        if scene.gripper.width < 0.081:
            wrenches[:, 2] = -2.0
            wrenches[:, 0] = 0.75 if ground is None or scene.tcp[2, 3] > ground else 0.0
        return wrenches

    scene.fingers.feel = feel
    scene.clock.advance(0.01)
    return scene


def test_it_lowers_until_the_fruit_is_carried_then_opens_and_rises():
    before = PickingScene(q=START.copy()).tcp[2, 3]
    scene = over_ground(before - 0.06)
    heights = []

    def watch(_tick: int) -> None:
        if scene.gripper.moves:
            heights.append(scene.tcp[2, 3])

    outcome = drive(Release(), {}, scene.devices, clock=scene.clock, each_tick=watch)
    assert outcome.status is Status.SUCCESS
    assert before - 0.068 < heights[0] < before - 0.06
    assert scene.gripper.moves[0].speed <= 0.03
    assert scene.gripper.width == pytest.approx(0.10, abs=1e-3)
    assert scene.tcp[2, 3] == pytest.approx(before, abs=1e-3)


def test_over_nothing_the_fruit_stays_held():
    scene = over_ground(None)
    outcome = drive(Release(), {"depth": 0.05}, scene.devices, clock=scene.clock)
    assert outcome.reason.code == "NO_CONTACT"
    assert scene.gripper.moves == []


def test_empty_fingers_have_nothing_to_release():
    scene = PickingScene(q=START.copy(), width=0.08)
    scene.clock.advance(0.01)
    assert drive(Release(), {}, scene.devices, clock=scene.clock).reason.code == "NOT_HELD"
    assert scene.arm.followed == []


def test_it_first_goes_to_the_pose_it_is_given():
    scene = over_ground(None)
    outcome = drive(Release(), {"into": "home", "depth": 0.02}, scene.devices, clock=scene.clock)
    assert outcome.reason.code == "NO_CONTACT"
    np.testing.assert_allclose(scene.arm.followed[0].q[-1], HOME, atol=1e-9)


def test_a_fruit_lost_on_the_way_down_is_told():
    scene = over_ground(None)

    def drop(tick: int) -> None:
        if tick == 20:
            scene.fingers.feel = lambda _now: np.zeros((2, 6))

    outcome = drive(Release(), {}, scene.devices, clock=scene.clock, each_tick=drop)
    assert outcome.reason.code == "LOST"
    assert scene.arm.settled()
    assert scene.gripper.moves == []


def test_a_fruit_whose_floor_takes_the_pressing_force_from_one_finger_is_put_down():
    scene = over_ground(None)
    calm = scene.fingers.feel

    def touch(tick: int) -> None:
        if tick == 20:
            pushed = calm(0.0)
            pushed[0, 2], pushed[:, 0] = -0.05, -0.7
            scene.fingers.feel = lambda _now: pushed

    outcome = drive(Release(), {}, scene.devices, clock=scene.clock, each_tick=touch)
    assert outcome.status is Status.SUCCESS
    assert len(scene.gripper.moves) == 1


def test_a_jolt_on_the_way_down_opens_nothing():
    scene = over_ground(None)
    calm = scene.fingers.feel

    def jolt(tick: int) -> None:
        weight = np.zeros((2, 6))
        weight[0, 0] = 2.0 if tick in (20, 21) else 0.0  # an arm whose controller halts
        scene.fingers.feel = lambda now: calm(now) + weight

    outcome = drive(Release(), {}, scene.devices, clock=scene.clock, each_tick=jolt)
    assert outcome.reason.code == "NO_CONTACT"
    assert "jolt" in outcome.reason.message
    assert scene.gripper.moves == []


@pytest.mark.parametrize("axis", [0, 1])
def test_fingers_that_drift_are_not_taken_for_a_floor(axis):
    scene = over_ground(None)
    calm = scene.fingers.feel

    def drifting(now: float) -> np.ndarray:
        wrenches = calm(now)
        wrenches[0, axis] -= 0.5 * now  # [N], 0.5 N/s
        return wrenches

    scene.fingers.feel = drifting
    outcome = drive(Release(), {"depth": 0.15}, scene.devices, clock=scene.clock)
    assert outcome.reason.code == "NO_CONTACT"
    assert "the fingers drift" in outcome.reason.message
    assert scene.gripper.moves == []


def test_interrupted_while_lowering_the_fruit_stays_held():
    scene = over_ground(None)
    outcome = drive(Release(), {}, scene.devices, clock=scene.clock, interrupt_after=30)
    assert outcome.status is Status.INVALID
    assert scene.arm.settled()
    assert scene.gripper.moves == []


@pytest.mark.parametrize("code", ["REFUSED", "STOPPED", "MOTION_FAILED"])
def test_an_arm_that_does_not_move_as_asked_is_a_reason_and_the_fruit_stays_held(code):
    scene = over_ground(None)
    outcome = drive(Release(), {}, scene.devices, clock=scene.clock, each_tick=scene.arm_trouble(code))
    assert outcome.reason.code == code
    assert scene.gripper.moves == []


@pytest.mark.parametrize(
    "code",
    ["START_IN_COLLISION", "GOAL_UNREACHABLE", "GOAL_IN_COLLISION", "NO_PATH", "TIMEOUT", "UNKNOWN_POSE", "MAP_STALE"],
)
def test_a_pose_that_cannot_be_reached_is_a_reason_and_the_fruit_stays_held(code):
    scene, given = scene_with_pose(code, width=0.08)
    scene.hold_fruit()
    inputs = {"into": "there", **given["inputs"]}
    outcome = drive(Release(), inputs, scene.devices, clock=scene.clock, **given["settings"])
    assert outcome.reason.code == code
    assert scene.arm.followed == []
    assert scene.gripper.moves == []


def test_variations_of_a_pose_are_places_for_one_fruit_after_the_other():
    scene = over_ground(None)
    inputs = {"into": "observe", "variation": 2, "depth": 0.02}
    drive(Release(), inputs, scene.devices, clock=scene.clock)
    np.testing.assert_allclose(scene.arm.followed[0].q[-1], WORKSPACE.poses["observe_2"], atol=1e-9)


def test_where_the_gripper_cannot_go_down_nothing_moves():
    scene = over_ground(None)
    below_finger = (scene.tcp @ [0.0, 0.045, 0.055, 1.0])[:3]
    outcome = drive(Release(), {"map": seen_map(blocked=(below_finger,))}, scene.devices, clock=scene.clock)
    assert outcome.reason.code == "LOWERING_BLOCKED"
    assert "map" in outcome.reason.message
    assert scene.arm.followed == []


def test_it_ends_before_the_gripper_would_touch_the_table():
    scene = over_ground(None)
    outcome = drive(Release(), {"depth": 0.5}, scene.devices, clock=scene.clock)
    assert outcome.reason.code == "NO_CONTACT"
    assert -0.12 + 0.012 < scene.tcp[2, 3] < -0.12 + 0.025  # the pads' tips are 12 mm below the TCP
    assert scene.gripper.moves == []


def test_it_is_quick_until_the_fruit_is_near_to_what_is_known():
    slow, quick = over_ground(-0.085), over_ground(-0.085)
    outcomes = [
        drive(Release(), inputs, scene.devices, clock=scene.clock)
        for scene, inputs in ((slow, {}), (quick, {"grasp": GRASP}))
    ]
    assert [outcome.status for outcome in outcomes] == [Status.SUCCESS] * 2
    assert outcomes[1].duration < 0.6 * outcomes[0].duration
    assert quick.arm.followed[1].duration > 0.5  # the last two centimetres
