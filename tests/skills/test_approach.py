from dataclasses import replace

import numpy as np
import pytest
from py_trees.common import Status

from pomona.drivers.interfaces import Box, MotionState
from pomona.drivers.path_motion import PathMotion
from pomona.executive.skill_testing import drive
from pomona.skills.approach import Approach
from pomona.skills.geometry import apply, inverse, transform
from pomona.skills.motion.collision import fruit_points
from pomona.skills.motion.grasps.gripper_shape import gripper_shape
from pomona.skills.shared.touch import FLAT, SINKS, landing_speeds
from tests.skills.overhead import comes_near, watched
from tests.skills.picking_scene import ROBOT_MODEL, PickingScene, a_grasp, seen_map

GRASP = a_grasp(theta=np.pi / 12.0)


def at_pre_grasp() -> PickingScene:
    return PickingScene(q=GRASP.q_pre_grasp[0].copy(), width=0.06)


def touch_after(scene: PickingScene, time: float, force: float) -> None:
    """The right finger meets something from a time on."""

    def feel(now: float) -> np.ndarray:
        wrenches = np.full((2, 6), 0.1)
        wrenches[1, 0] -= force if now > time else 0.0
        return wrenches

    scene.fingers.feel = feel


def test_it_opens_first_and_then_goes_straight_to_the_grasp():
    scene = at_pre_grasp()
    opened_at = []
    outcome = drive(
        Approach(), {"grasp": GRASP}, scene.devices, clock=scene.clock,
        each_tick=lambda _tick: opened_at.append(scene.gripper.width) if not scene.arm.followed else None,
    )  # fmt: skip
    assert outcome.status is Status.SUCCESS
    assert opened_at[-1] == pytest.approx(GRASP.width, abs=1e-3)
    np.testing.assert_allclose(scene.tcp, GRASP.T_base_grasp, atol=1e-6)
    assert outcome.duration < 1.8


def test_a_touch_stops_the_arm_and_names_the_place():
    scene = at_pre_grasp()
    touch_after(scene, 0.7, 2.0)
    outcome = drive(Approach(), {"grasp": GRASP}, scene.devices, clock=scene.clock)
    assert outcome.reason.code == "CONTACT"
    assert outcome.reason.data["finger"] == "right"
    assert 0.02 < outcome.reason.data["before_grasp_m"] < 0.11
    assert scene.arm.settled()
    left = np.linalg.norm(scene.tcp[:3, 3] - GRASP.T_base_grasp[:3, 3])
    assert (
        outcome.reason.data["before_grasp_m"] - 0.06 < left < outcome.reason.data["before_grasp_m"]
    )


def test_a_finger_that_lands_on_the_fruit_records_how_far_it_lies_from_its_measured_skin():
    scene = at_pre_grasp()
    touch_after(scene, 0.7, 2.0)
    outcome = drive(Approach(), {"grasp": GRASP}, scene.devices, clock=scene.clock)
    (touches,) = [value for topic, value in outcome.published if topic == "touches"]
    assert touches.left is None
    assert touches.right.force == pytest.approx(2.0)
    points = apply(inverse(touches.T_base_tcp), fruit_points(GRASP.fruit))
    way = gripper_shape(ROBOT_MODEL).way_to(points, GRASP.width, "right")
    np.testing.assert_allclose(touches.landed, touches.T_base_tcp[:3, :3] @ way, atol=1e-9)
    assert 0.0 < np.linalg.norm(way) < outcome.reason.data["before_grasp_m"]


def test_a_touch_stops_the_arm_before_the_next_tick(monkeypatch):
    scene = at_pre_grasp()
    touch_after(scene, 0.7, 2.0)
    stopped, plain = [], PathMotion.stop

    def stop(motion: PathMotion) -> None:
        stopped.append(scene.clock.now())
        plain(motion)

    monkeypatch.setattr(PathMotion, "stop", stop)
    outcome = drive(Approach(), {"grasp": GRASP}, scene.devices, clock=scene.clock)
    assert outcome.reason.code == "CONTACT"
    assert 0.7 < stopped[0] < 0.71  # three samples of 2 ms; the next tick is at 0.72 s


def test_fingers_that_are_blocked_at_the_pre_grasp_end_the_attempt_and_the_arm_stays():
    scene = at_pre_grasp()

    def block(_tick: int) -> None:
        if scene.gripper.moves:
            scene.gripper.moves[-1].end(MotionState.FAILED, "the fingers are blocked at 62.0 mm")

    outcome = drive(Approach(), {"grasp": GRASP}, scene.devices, clock=scene.clock, each_tick=block)
    assert outcome.reason.code == "CONTACT"
    assert "at the pre-grasp the fingers are blocked at 62.0 mm" in outcome.reason.message
    assert scene.arm.followed == []


def test_fingers_that_something_pushes_from_outside_stop_the_arm():
    scene = at_pre_grasp()

    def push(_tick: int) -> None:
        if scene.clock.now() > 0.8:
            scene.gripper.width = GRASP.width - 0.0025

    outcome = drive(Approach(), {"grasp": GRASP}, scene.devices, clock=scene.clock, each_tick=push)
    assert outcome.reason.code == "CONTACT"
    assert "pushed the fingers" in outcome.reason.message
    assert scene.arm.settled()
    assert np.linalg.norm(scene.tcp[:3, 3] - GRASP.T_base_grasp[:3, 3]) > 0.02


def test_pushed_fingers_give_way_until_the_arm_stands():
    scene = at_pre_grasp()
    scene.gripper.motor_force = -10.0

    def push() -> None:
        if scene.clock.now() > 0.8:
            reached = GRASP.width - min(0.02 * (scene.clock.now() - 0.8), 0.006)
            scene.gripper.width = min(scene.gripper.width, reached)
        scene.gripper.check()  # raises without a command that explains the motion

    scene.clock.each_step.append(push)
    outcome = drive(Approach(), {"grasp": GRASP}, scene.devices, clock=scene.clock)
    assert outcome.reason.code == "CONTACT"
    assert scene.arm.settled()


def test_it_is_slow_where_a_fingertip_may_land_on_level_skin_and_quick_elsewhere():
    scene = at_pre_grasp()
    end = drive(Approach(), {"grasp": GRASP, "unseen": 0.03}, scene.devices, clock=scene.clock)
    assert end.status is Status.SUCCESS
    trajectory = scene.arm.followed[-1]
    tcp = np.array([ROBOT_MODEL.tcp(q)[:3, 3] for q in trajectory.q])
    before = np.linalg.norm(tcp - GRASP.T_base_grasp[:3, 3], axis=1)
    speed = np.linalg.norm(np.gradient(tcp, trajectory.t, axis=0), axis=1)
    most = landing_speeds(gripper_shape(ROBOT_MODEL), GRASP, (), GRASP.width, before[0], 0.03)
    allowed = np.interp(
        before, np.linspace(0.0, before[0], len(most)), np.minimum(most, 0.25)[::-1]
    )
    assert allowed.min() < 2.0 * FLAT
    flat = allowed < 1.2 * allowed.min()
    assert flat.sum() > 10
    assert np.median(speed[flat]) < 1.3 * allowed.min()
    assert speed.max() > 4.0 * allowed.min()


def test_an_arm_that_brakes_late_lands_more_slowly():
    slowest = []
    for reaction in (0.0, SINKS):
        scene = at_pre_grasp()
        scene.arm.limits = replace(scene.arm.limits, reaction=reaction)
        drive(Approach(), {"grasp": GRASP, "unseen": 0.03}, scene.devices, clock=scene.clock)
        trajectory = scene.arm.followed[-1]
        tcp = np.array([ROBOT_MODEL.tcp(q)[:3, 3] for q in trajectory.q])
        speed = np.linalg.norm(np.gradient(tcp, trajectory.t, axis=0), axis=1)
        before = np.linalg.norm(tcp - GRASP.T_base_grasp[:3, 3], axis=1)
        slowest.append(speed[(before > 0.02) & (before < before[0] - 0.02)].min())
    assert slowest[1] == pytest.approx(0.5 * slowest[0], rel=0.05)


def test_it_lands_slowly_on_the_wall_of_a_crate_that_may_have_been_moved():
    places = (GRASP.T_base_grasp[:3, 3] + [x, 0.0, 0.07] for x in (0.0, 0.4))
    walls = (Box("source", transform(None, place), (0.004, 0.2, 0.01)) for place in places)
    below, far = (
        landing_speeds(gripper_shape(ROBOT_MODEL), GRASP, (box,), GRASP.width, 0.12, 0.03)
        for box in walls
    )
    above = np.linspace(0.12, 0.0, len(below)) > 0.07  # higher than the fruit
    assert below[above].min() == pytest.approx(FLAT)
    assert np.isinf(far[above]).all()


def test_an_obstacle_as_large_as_a_hall_takes_no_more_memory_than_a_small_one():
    floor = Box(
        "floor", transform(None, GRASP.T_base_grasp[:3, 3] + [30.0, 0.0, 0.06]), (40.0, 40.0, 0.01)
    )
    most = landing_speeds(gripper_shape(ROBOT_MODEL), GRASP, (floor,), GRASP.width, 0.12, 0.001)
    assert most.min() == pytest.approx(FLAT)


def test_an_offset_of_the_sensor_and_a_single_spike_are_no_touch():
    scene = at_pre_grasp()

    def feel(now: float) -> np.ndarray:
        wrenches = np.full((2, 6), 0.5)
        wrenches[0, 1] += 5.0 if 0.5 < now < 0.503 else 0.0
        return wrenches

    scene.fingers.feel = feel
    scene.clock.advance(0.01)
    outcome = drive(Approach(), {"grasp": GRASP}, scene.devices, clock=scene.clock)
    assert outcome.status is Status.SUCCESS


def test_fingers_that_feel_nothing_any_more_stop_the_arm():
    scene = at_pre_grasp()

    def lose(tick: int) -> None:
        if scene.arm.followed and tick % 10 == 0:
            scene.fingers.lose(10.0)

    outcome = drive(Approach(), {"grasp": GRASP}, scene.devices, clock=scene.clock, each_tick=lose)
    assert outcome.reason.code == "SENSOR_STALE"
    assert scene.arm.settled()


def test_it_does_not_start_from_anywhere_else():
    scene = PickingScene()
    outcome = drive(Approach(), {"grasp": GRASP}, scene.devices, clock=scene.clock)
    assert outcome.reason.code == "NOT_AT_PRE_GRASP"
    assert scene.arm.followed == []
    assert scene.gripper.moves == []


def test_interrupted_it_stops_on_the_line():
    scene = at_pre_grasp()
    outcome = drive(
        Approach(), {"grasp": GRASP}, scene.devices, clock=scene.clock, interrupt_after=35
    )
    assert outcome.status is Status.INVALID
    assert scene.arm.settled()
    offset = scene.tcp[:3, 3] - GRASP.T_base_pre_grasp[:3, 3]
    approach = GRASP.T_base_grasp[:3, 2]
    assert 0.005 < offset @ approach < 0.115
    np.testing.assert_allclose(offset, (offset @ approach) * approach, atol=1e-4)


@pytest.mark.parametrize("code", ["REFUSED", "STOPPED", "MOTION_FAILED"])
def test_an_arm_that_does_not_move_as_asked_is_a_reason(code):
    scene = at_pre_grasp()
    trouble = scene.arm_trouble(code)
    outcome = drive(
        Approach(), {"grasp": GRASP}, scene.devices, clock=scene.clock, each_tick=trouble
    )
    assert outcome.reason.code == code
    assert scene.arm.settled()


def test_a_grasp_out_of_reach_is_known_before_anything_moves():
    scene = at_pre_grasp()
    deep = GRASP.T_base_grasp @ transform(None, [0.0, 0.0, 0.6])
    outcome = drive(
        Approach(), {"grasp": replace(GRASP, T_base_grasp=deep)}, scene.devices, clock=scene.clock
    )
    assert outcome.reason.code == "NO_STRAIGHT_LINE"
    assert 0.0 < outcome.reason.data["reached_m"] < 0.72
    assert scene.arm.followed == []
    assert scene.gripper.moves == []


def test_something_on_the_way_is_known_before_anything_moves():
    scene = at_pre_grasp()
    finger = GRASP.T_base_pre_grasp @ transform(None, [0.0, GRASP.width / 2.0, 0.06])
    outcome = drive(
        Approach(),
        {"grasp": GRASP, "map": seen_map(blocked=(finger[:3, 3],))},
        scene.devices,
        clock=scene.clock,
    )
    assert outcome.reason.code == "IN_COLLISION"
    assert outcome.reason.data["obstacle"] == "map"
    assert scene.arm.followed == []
    assert scene.gripper.moves == []


def test_a_stale_map_is_not_free():
    scene = at_pre_grasp()
    outcome = drive(
        Approach(), {"grasp": GRASP, "map": seen_map(-1000.0)}, scene.devices, clock=scene.clock
    )
    assert outcome.reason.code == "MAP_STALE"
    assert scene.arm.followed == []


def test_an_approaching_object_in_view_stops_the_arm():
    scene = at_pre_grasp()
    devices, camera = watched(scene)
    come = comes_near(scene, camera)
    outcome = drive(Approach(), {"grasp": GRASP}, devices, clock=scene.clock, each_tick=come)
    assert outcome.reason.code == "PATH_BLOCKED"
    assert scene.arm.settled()


@pytest.mark.parametrize("code", ["POSE_MISMATCH", "DEPTH_MISMATCH"])
def test_a_camera_that_shows_the_table_elsewhere_starts_no_motion(code):
    scene = at_pre_grasp()
    devices, camera = watched(scene)
    camera.untrue = code
    outcome = drive(Approach(), {"grasp": GRASP}, devices, clock=scene.clock)
    assert outcome.reason.code == code
    assert outcome.reason.data["tilt_rad"] > 0.08
    assert "above: " in outcome.reason.message
    assert scene.arm.followed == []


# ------------------------------------------------------------------------------------ without a force sensor


def test_without_a_force_sensor_it_opens_and_goes_straight_to_the_grasp():
    scene = at_pre_grasp()
    outcome = drive(Approach(), {"grasp": GRASP}, scene.without_sensor, clock=scene.clock)
    assert outcome.status is Status.SUCCESS
    np.testing.assert_allclose(scene.tcp, GRASP.T_base_grasp, atol=1e-6)


def test_without_a_force_sensor_a_push_on_the_fingers_is_a_contact():
    scene = at_pre_grasp()

    def push() -> None:
        if scene.clock.now() > 0.7:
            scene.gripper.width = max(scene.gripper.width - 0.1e-3, GRASP.width - 0.003)

    scene.clock.each_step.append(push)
    outcome = drive(Approach(), {"grasp": GRASP}, scene.without_sensor, clock=scene.clock)
    assert outcome.reason.code == "CONTACT"
    assert "pushed the fingers" in outcome.reason.message
    assert scene.arm.settled()


def test_without_a_force_sensor_an_interruption_stops_the_arm():
    scene = at_pre_grasp()
    outcome = drive(
        Approach(), {"grasp": GRASP}, scene.without_sensor, clock=scene.clock, interrupt_after=40
    )
    assert outcome.status is Status.INVALID
    assert scene.arm.settled()
