from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from py_trees.common import Status

from pomona.drivers.gripper_supervisor import GripperMotion
from pomona.drivers.interfaces import Box, MotionState
from pomona.executive.skill_testing import drive
from pomona.skills.geometry import transform
from pomona.skills.motion.lines import STEP, straight_line
from pomona.skills.retreat import Retreat
from tests.skills.overhead import watched
from tests.skills.picking_scene import HOME, OBSERVE, ROBOT_MODEL, WORKSPACE, PickingScene, a_grasp

GRASP = a_grasp(theta=np.pi / 6.0)
LINE = straight_line(ROBOT_MODEL, GRASP.q_pre_grasp[0], GRASP.T_base_grasp).q


def lifted(height: float) -> np.ndarray:
    T = GRASP.T_base_grasp.copy()
    T[2, 3] += height
    return straight_line(ROBOT_MODEL, LINE[-1], T).q[-1]


def retreat(scene: PickingScene, **inputs: Any):
    return drive(Retreat(), {"grasp": GRASP, **inputs}, scene.devices, clock=scene.clock)


def test_from_the_grasp_it_opens_and_goes_straight_back():
    scene = PickingScene(q=LINE[-1].copy(), width=0.084)
    scene.hold_fruit()
    outcome = retreat(scene)
    assert outcome.status is Status.SUCCESS
    assert scene.gripper.width == pytest.approx(GRASP.width, abs=1e-3)
    np.testing.assert_allclose(scene.tcp, GRASP.T_base_pre_grasp, atol=1e-6)
    assert len(scene.arm.followed) == 1
    offsets = (
        np.array([ROBOT_MODEL.tcp(q)[:3, 3] for q in scene.arm.followed[0].q])
        - GRASP.T_base_grasp[:3, 3]
    )
    along = offsets @ GRASP.T_base_grasp[:3, 2]
    np.testing.assert_allclose(offsets, along[:, None] * GRASP.T_base_grasp[:3, 2], atol=1e-4)


def test_halfway_on_the_approach_the_open_fingers_stay_as_they_are():
    scene = PickingScene(q=LINE[len(LINE) // 2].copy(), width=GRASP.width)
    assert retreat(scene).status is Status.SUCCESS
    assert scene.gripper.moves == []
    np.testing.assert_allclose(scene.tcp, GRASP.T_base_pre_grasp, atol=1e-6)


def test_a_hand_that_a_branch_holds_beside_the_pre_grasp_does_not_go_back_there():
    T = GRASP.T_base_pre_grasp.copy()
    T[:3, 3] += [2e-3, 0.0, 2e-3]
    scene = PickingScene(q=straight_line(ROBOT_MODEL, LINE[0], T).q[-1], width=GRASP.width)
    assert retreat(scene).status is Status.SUCCESS
    assert scene.arm.followed == []


def test_empty_fingers_that_something_blocks_from_outside_still_go_back():
    scene = PickingScene(q=LINE[len(LINE) // 2].copy(), width=GRASP.width - 0.004)

    def move(width: float, speed: float) -> GripperMotion:
        blocked = GripperMotion(width, speed, scene.gripper.width, lambda _: None)
        blocked.end(MotionState.FAILED, "the fingers are blocked")
        blocked.settled = True
        return blocked

    scene.gripper.move = move  # type: ignore[method-assign, assignment]
    assert retreat(scene).status is Status.SUCCESS
    np.testing.assert_allclose(scene.tcp, GRASP.T_base_pre_grasp, atol=1e-6)


def test_fingers_that_are_pushed_on_the_way_back_give_way():
    scene = PickingScene(q=LINE[-1].copy(), width=GRASP.width)
    scene.gripper.motor_force = -10.0

    def push() -> None:
        reached = GRASP.width - min(0.02 * max(scene.clock.now() - 0.35, 0.0), 0.006)
        scene.gripper.width = min(scene.gripper.width, reached)
        scene.gripper.check()  # raises without a command that explains the motion

    scene.clock.each_step.append(push)
    assert retreat(scene).status is Status.SUCCESS
    np.testing.assert_allclose(scene.tcp, GRASP.T_base_pre_grasp, atol=1e-6)


def test_a_lifted_fruit_is_put_down_before_the_fingers_open():
    scene = PickingScene(q=lifted(0.10), width=0.084)
    scene.hold_fruit()
    opened_at = []

    def watch(_tick: int) -> None:
        if scene.gripper.moves and not opened_at:
            opened_at.append(scene.tcp[2, 3])

    outcome = drive(Retreat(), {"grasp": GRASP}, scene.devices, clock=scene.clock, each_tick=watch)
    assert outcome.status is Status.SUCCESS
    assert opened_at[0] == pytest.approx(GRASP.T_base_grasp[2, 3], abs=1e-3)
    np.testing.assert_allclose(scene.tcp, GRASP.T_base_pre_grasp, atol=1e-6)


def test_a_fruit_that_meets_its_support_earlier_is_let_go_there():
    scene = PickingScene(q=lifted(0.10), width=0.084)

    def feel(_now: float) -> np.ndarray:
        wrenches = np.zeros((2, 6))
        wrenches[:, 2] = -2.0
        wrenches[:, 0] = -1.0 if scene.tcp[2, 3] > GRASP.T_base_grasp[2, 3] + 0.03 else 0.0
        return wrenches

    scene.fingers.feel = feel
    scene.clock.advance(0.01)
    outcome = retreat(scene)
    assert outcome.status is Status.SUCCESS
    lowest = min(ROBOT_MODEL.tcp(q)[2, 3] for q in [scene.arm.followed[1].q[0]])
    assert GRASP.T_base_grasp[2, 3] + 0.01 < lowest < GRASP.T_base_grasp[2, 3] + 0.031


def test_the_last_millimetres_are_slow_and_end_where_the_fruit_is_felt_to_stand():
    scene = PickingScene(q=lifted(0.10), width=0.084)

    def feel(_now: float) -> np.ndarray:
        wrenches = np.zeros((2, 6))
        wrenches[:, 2] = -2.0
        wrenches[:, 0] = -0.5 if scene.tcp[2, 3] > GRASP.T_base_grasp[2, 3] + 0.005 else -0.25
        return wrenches

    scene.fingers.feel = feel
    scene.clock.advance(0.01)
    assert retreat(scene).status is Status.SUCCESS
    quickly, gently, back = scene.arm.followed
    heights = [ROBOT_MODEL.tcp(q)[2, 3] - GRASP.T_base_grasp[2, 3] for q in gently.q]
    assert 0.015 <= heights[0] <= 0.015 + STEP
    assert np.abs(np.gradient(heights, gently.t)).max() < 0.031
    assert np.abs(np.gradient([ROBOT_MODEL.tcp(q)[2, 3] for q in quickly.q], quickly.t)).max() > 0.1
    stands = ROBOT_MODEL.tcp(back.q[0])[2, 3] - GRASP.T_base_grasp[2, 3]
    assert 0.003 < stands < 0.005  # 30 mm/s, seen within three samples and a tick


def test_above_the_grasp_with_nothing_held_nothing_moves():
    scene = PickingScene(q=lifted(0.15), width=0.05)
    assert retreat(scene).status is Status.SUCCESS
    assert scene.arm.followed == []
    assert scene.gripper.moves == []


@pytest.mark.parametrize("q", [OBSERVE, HOME])
def test_far_from_the_grasp_nothing_moves(q):
    scene = PickingScene(q=q.copy())
    assert retreat(scene).status is Status.SUCCESS
    assert scene.arm.followed == []


def test_before_any_grasp_there_is_nothing_to_retreat_from():
    scene = PickingScene()
    assert drive(Retreat(), {}, scene.devices, clock=scene.clock).status is Status.SUCCESS


def test_interrupted_while_lowering_the_fingers_stay_closed():
    scene = PickingScene(q=lifted(0.10), width=0.084)
    scene.hold_fruit()
    outcome = drive(
        Retreat(), {"grasp": GRASP}, scene.devices, clock=scene.clock, interrupt_after=20
    )
    assert outcome.status is Status.INVALID
    assert scene.arm.settled()
    assert scene.gripper.moves == []


@pytest.mark.parametrize("code", ["REFUSED", "STOPPED", "MOTION_FAILED"])
def test_an_arm_that_does_not_move_as_asked_is_a_reason(code):
    scene = PickingScene(q=LINE[-1].copy(), width=GRASP.width)
    outcome = drive(
        Retreat(), {"grasp": GRASP}, scene.devices, clock=scene.clock, each_tick=scene.arm_trouble(code)
    )  # fmt: skip
    assert outcome.reason.code == code
    assert scene.arm.settled()


def test_a_pre_grasp_out_of_reach_is_no_way_back():
    scene = PickingScene(q=LINE[-1].copy(), width=GRASP.width)
    far = GRASP.T_base_pre_grasp @ transform(None, [0.0, 0.0, -0.9])
    outcome = drive(
        Retreat(), {"grasp": replace(GRASP, T_base_pre_grasp=far)}, scene.devices, clock=scene.clock
    )  # fmt: skip
    assert outcome.reason.code == "RETREAT_BLOCKED"
    assert scene.arm.followed == []


def test_something_fixed_on_the_way_back_stops_it_before_it_moves():
    behind = GRASP.T_base_pre_grasp @ transform(None, [0.0, 0.0, -0.1])
    box = Box("lamp", behind, (0.02, 0.15, 0.02))
    scene = PickingScene(
        q=LINE[-1].copy(), width=GRASP.width, workspace=replace(WORKSPACE, obstacles=(box,))
    )
    outcome = retreat(scene)
    assert outcome.reason.code == "RETREAT_BLOCKED"
    assert outcome.reason.data["obstacle"] == "lamp"
    assert scene.arm.followed == []


# ------------------------------------------------------------------------------------ without a force sensor


def plain(height: float, width: float = 0.084, motor_force: float | None = 5.0) -> PickingScene:
    scene = PickingScene(q=lifted(height) if height else LINE[-1].copy(), width=width)
    scene.grip_plainly(motor_force)
    return scene


@pytest.mark.parametrize("motor_force", [5.0, None])
def test_without_a_force_sensor_a_lifted_fruit_is_put_back_to_its_height_before_the_fingers_open(
    motor_force: float | None,
):
    scene, opened_at = plain(0.10, motor_force=motor_force), []

    def watch(_tick: int) -> None:
        if len(scene.gripper.moves) > 1 and not opened_at:
            opened_at.append(scene.tcp[2, 3])
            scene.drop_plainly()

    outcome = drive(
        Retreat(), {"grasp": GRASP}, scene.without_sensor, clock=scene.clock, each_tick=watch
    )
    assert outcome.status is Status.SUCCESS
    assert opened_at[0] == pytest.approx(GRASP.T_base_grasp[2, 3], abs=1e-3)
    np.testing.assert_allclose(scene.tcp, GRASP.T_base_pre_grasp, atol=1e-6)


def test_without_a_force_sensor_above_the_grasp_with_empty_fingers_nothing_moves():
    scene = PickingScene(q=lifted(0.15), width=0.05)
    assert (
        drive(Retreat(), {"grasp": GRASP}, scene.without_sensor, clock=scene.clock).status
        is Status.SUCCESS
    )
    assert scene.arm.followed == []
    assert scene.gripper.moves == []


def test_without_a_force_sensor_an_interrupted_retreat_opens_nothing():
    scene = plain(0.10)
    outcome = drive(
        Retreat(), {"grasp": GRASP}, scene.without_sensor, clock=scene.clock, interrupt_after=20
    )
    assert outcome.status is Status.INVALID
    assert scene.arm.settled()
    assert len(scene.gripper.moves) == 1


def test_the_arm_does_not_go_back_to_where_a_camera_sees_a_hand():
    scene = PickingScene(q=LINE[len(LINE) // 2].copy(), width=GRASP.width)
    devices, camera = watched(scene)
    scene.clock.advance(0.2)
    x, y, z = GRASP.T_base_pre_grasp[:3, 3]
    camera.balls = ((x + 0.12, y, z, 0.04),)
    outcome = drive(Retreat(), {"grasp": GRASP}, devices, clock=scene.clock)
    assert outcome.status is Status.FAILURE
    assert outcome.reason.code == "PATH_BLOCKED"
    np.testing.assert_allclose(scene.arm.q, LINE[len(LINE) // 2], atol=0.02)
