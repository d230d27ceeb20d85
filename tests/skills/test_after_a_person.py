"""Once something has come near, no skill moves before the cameras show its way free, or an operator says so."""

from __future__ import annotations

import numpy as np
import pytest
from py_trees.common import Status

from pomona.drivers.interfaces import Arm, MotionState, Trajectory
from pomona.executive.errors import NotOwnerError
from pomona.executive.lease import notice_of
from pomona.executive.skill import Skill, Work
from pomona.executive.skill_testing import BenchContext, drive
from pomona.skills.feel_friction import FeelFriction
from pomona.skills.follow import Follow
from pomona.skills.grasp import Grasp
from pomona.skills.lift import Lift
from pomona.skills.motion.lines import straight_line
from pomona.skills.motion.planning.timing import time_polyline
from pomona.skills.open_fingers import OpenFingers
from pomona.skills.retreat import Retreat
from pomona.skills.slip_avoid_grasp import SlipAvoidGrasp
from tests.skills.overhead import Overhead, watched
from tests.skills.picking_scene import HOME, OBSERVE, ROBOT_MODEL, PickingScene, a_grasp
from tests.skills.test_feel_friction import Standing

GRASP = a_grasp(theta=np.pi / 6.0)
LINE = straight_line(ROBOT_MODEL, GRASP.q_pre_grasp[0], GRASP.T_base_grasp).q


def ways(scene: PickingScene) -> dict[str, tuple[Skill, dict[str, object]]]:
    path = time_polyline(np.array([scene.arm.q, HOME]), scene.arm.limits)
    return {
        "Retreat": (Retreat(), {"grasp": GRASP}),
        "Grasp": (Grasp(), {}),
        "Lift": (Lift(), {"grasp": GRASP}),
        "OpenFingers": (OpenFingers(), {"grasp": GRASP, "path": path}),
        "SlipAvoidGrasp": (SlipAvoidGrasp(), {}),
        "Follow": (Follow(), {"path": path}),
    }


def standing(name: str, camera: bool = True) -> tuple[PickingScene, dict[type, object], Overhead]:
    """A hand that stands where the skill begins, in a run that something has come near to."""
    scene = PickingScene(q=LINE[-1].copy(), width=0.06 if name == "OpenFingers" else 0.084)
    scene.hold_fruit()
    scene.clock.advance(0.2)
    notice_of(scene.clock).why = "a moving object entered"
    seen, above = watched(scene)
    return scene, seen if camera else scene.devices, above


@pytest.mark.parametrize(
    "name", ["Retreat", "Grasp", "Lift", "OpenFingers", "SlipAvoidGrasp", "Follow"]
)
def test_where_no_camera_watches_nothing_moves_without_an_operator(name: str) -> None:
    scene, devices, _ = standing(name, camera=False)
    q = scene.arm.q.copy()
    skill, inputs = ways(scene)[name]
    end = drive(skill, inputs, devices, clock=scene.clock)
    assert end.reason is not None
    assert end.reason.code == "PATH_BLOCKED"
    np.testing.assert_array_equal(scene.arm.q, q)
    assert scene.gripper.moves == []


class Stranger(Skill):
    """Moves the arm without a watch."""

    devices = (Arm,)

    def run(self, path: Trajectory) -> Work[None]:
        motion = self.device(Arm).follow(path)
        while motion.state is MotionState.RUNNING:
            yield None


def test_a_skill_that_watches_nothing_is_refused_until_an_operator_clears_the_notice() -> None:
    scene, devices, _ = standing("Follow")
    inputs: dict[str, object] = {
        "path": time_polyline(np.array([scene.arm.q, HOME]), scene.arm.limits)
    }
    with pytest.raises(NotOwnerError, match="nothing watches its motion after 'a moving object"):
        drive(Stranger(), inputs, devices, clock=scene.clock)
    assert scene.arm.followed == []
    notice_of(scene.clock).why = ""
    assert drive(Stranger(), inputs, devices, clock=scene.clock).status is Status.SUCCESS


@pytest.mark.parametrize("name", ["Retreat", "Grasp", "Lift", "OpenFingers", "SlipAvoidGrasp"])
@pytest.mark.parametrize("code", ["POSE_MISMATCH", "DEPTH_MISMATCH"])
def test_a_camera_whose_frames_are_untrue_lets_nothing_move(name: str, code: str) -> None:
    scene, devices, above = standing(name)
    above.untrue = code
    skill, inputs = ways(scene)[name]
    end = drive(skill, inputs, devices, clock=scene.clock)
    assert end.reason is not None
    assert end.reason.code == code
    assert scene.arm.followed == []
    assert scene.gripper.moves == []


@pytest.mark.parametrize("code", ["PATH_BLOCKED", "POSE_MISMATCH", "DEPTH_MISMATCH"])
def test_the_pads_do_not_slide_over_the_fruit_either(code: str) -> None:
    scene = Standing()
    hold = scene.grasp()
    notice_of(scene.clock).why = "a moving object entered"
    devices, above = watched(scene)
    above.untrue = "" if code == "PATH_BLOCKED" else code
    q = scene.arm.q.copy()
    seen = scene.devices if code == "PATH_BLOCKED" else devices
    end = drive(FeelFriction(), {"hold": hold}, seen, clock=scene.clock)
    assert end.reason is not None
    assert end.reason.code == code
    assert hold.holds
    np.testing.assert_array_equal(scene.arm.q, q)


def seen_and_stopped(scene: PickingScene, above: Overhead, devices: dict[type, object]) -> None:
    """A hand comes near to the moving arm, which stops."""
    path = time_polyline(np.array([scene.arm.q, HOME]), scene.arm.limits)

    def come(_tick: int) -> None:
        if scene.arm.followed and above.frames > 3 and not above.balls:
            x, y, z = scene.tcp[:3, 3]
            above.balls = ((x + 0.12, y, z, 0.04),)

    end = drive(Follow(), {"path": path}, devices, clock=scene.clock, each_tick=come)
    assert end.reason is not None
    assert end.reason.code == "PATH_BLOCKED"


@pytest.fixture
def stopped(monkeypatch: pytest.MonkeyPatch) -> tuple[PickingScene, dict[type, object], Overhead]:
    monkeypatch.setattr("pomona.skills.shared.live_watch.PATIENCE", 0.1)
    scene = PickingScene(q=OBSERVE.copy())
    devices, above = watched(scene)
    seen_and_stopped(scene, above, devices)
    return scene, devices, above


Stopped = tuple[PickingScene, dict[type, object], Overhead]


def test_while_the_hand_stays_the_arm_rests_and_the_next_motion_fails(stopped: Stopped) -> None:
    scene, devices, _ = stopped
    q = scene.arm.q.copy()
    back = time_polyline(np.array([q, OBSERVE]), scene.arm.limits)
    end = drive(Follow(), {"path": back}, devices, clock=scene.clock)
    assert end.reason is not None
    assert end.reason.code == "PATH_BLOCKED"
    assert "has come in" in end.reason.message
    assert end.duration >= 0.1
    np.testing.assert_array_equal(scene.arm.q, q)


def test_a_hand_that_only_some_frames_show_lets_nothing_move(
    stopped: Stopped, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pomona.skills.shared.live_watch.PATIENCE", 2.0)
    scene, devices, above = stopped
    hand = above.balls
    q = scene.arm.q.copy()
    back = time_polyline(np.array([q, OBSERVE]), scene.arm.limits)

    def flicker(tick: int) -> None:
        above.balls = hand if tick % 20 < 3 else ()

    end = drive(Follow(), {"path": back}, devices, clock=scene.clock, each_tick=flicker)
    assert end.reason is not None
    assert end.reason.code == "PATH_BLOCKED"
    np.testing.assert_array_equal(scene.arm.q, q)


@pytest.mark.parametrize("leaves", [False, True])
def test_a_hand_that_vanishes_beside_the_robot_is_still_there(
    stopped: Stopped, monkeypatch: pytest.MonkeyPatch, leaves: bool
) -> None:
    monkeypatch.setattr("pomona.skills.shared.live_watch.PATIENCE", 3.0)
    scene, devices, above = stopped
    ((x, y, z, radius),) = above.balls
    q = scene.arm.q.copy()
    back = time_polyline(np.array([q, OBSERVE]), scene.arm.limits)

    def go(tick: int) -> None:
        if leaves:
            x_now = x + 0.02 * max(tick - 10, 0)
            above.balls = ((x_now, y, z, radius),) if x_now < x + 0.4 else ()
        elif tick > 10:
            above.balls = ()

    end = drive(Follow(), {"path": back}, devices, clock=scene.clock, each_tick=go)
    if leaves:
        assert end.status is Status.SUCCESS
    else:
        assert end.reason is not None
        assert "last seen beside the robot" in end.reason.message
        np.testing.assert_array_equal(scene.arm.q, q)


class Touched(Skill):
    """Has met something where nothing was expected."""

    failures = ("CONTACT",)

    def run(self) -> None:
        raise self.failure("CONTACT", "the hand touched something", unexpected=True)


@pytest.mark.parametrize("leaves", [False, True])
def test_what_touched_the_robot_unseen_is_beside_it_until_it_is_seen_to_leave(
    monkeypatch: pytest.MonkeyPatch, leaves: bool
) -> None:
    monkeypatch.setattr("pomona.skills.shared.live_watch.PATIENCE", 3.0)
    scene = PickingScene(q=OBSERVE.copy())
    devices, above = watched(scene)
    drive(Touched(), {}, {}, clock=scene.clock)
    x, y, z = scene.tcp[:3, 3]
    path = time_polyline(np.array([scene.arm.q, HOME]), scene.arm.limits)

    def go(tick: int) -> None:
        x_now = x + 0.12 + 0.02 * (tick - 20)
        above.balls = ((x_now, y, z, 0.04),) if leaves and 20 <= tick < 40 else ()

    end = drive(Follow(), {"path": path}, devices, clock=scene.clock, each_tick=go)
    if leaves:
        assert end.status is Status.SUCCESS
    else:
        assert end.reason is not None
        assert "last seen beside the robot" in end.reason.message
        assert scene.arm.followed == []


def test_a_way_that_no_camera_shows_is_not_taken(
    stopped: Stopped, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, devices, above = stopped
    monkeypatch.setattr(above, "latest_depth", lambda: None)
    above.balls = ()
    q = scene.arm.q.copy()
    aside = q + np.array([0.8, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    path = time_polyline(np.array([q, aside]), scene.arm.limits)
    end = drive(Follow(), {"path": path}, devices, clock=scene.clock)
    assert end.reason is not None
    assert "no camera shows" in end.reason.message
    np.testing.assert_array_equal(scene.arm.q, q)


def test_an_operator_who_sees_nobody_lets_the_arm_move_on(
    stopped: Stopped, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, devices, above = stopped
    asked: list[str] = []
    monkeypatch.setattr(BenchContext, "pause", lambda _context, why: asked.append(why) is None)
    back = time_polyline(np.array([scene.arm.q, OBSERVE]), scene.arm.limits)
    above.balls = ()
    end = drive(Follow(), {"path": back}, devices, clock=scene.clock)
    assert end.status is Status.SUCCESS
    assert len(asked) <= 1
    np.testing.assert_allclose(scene.arm.q, OBSERVE, atol=1e-6)
