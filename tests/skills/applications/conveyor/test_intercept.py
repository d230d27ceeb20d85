"""The skill Intercept on mock devices: success, every failure code, interruption; the hand rises and rests."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from py_trees.common import Status

from pomona.applications.conveyor.conveyor import ConveyorState
from pomona.applications.conveyor.intercept import Intercept
from pomona.drivers import Cameras, StopFailed
from pomona.executive import SkillEnd, SkillFailure, drive
from pomona.executive.lease import notice_of
from pomona.skills import LiveWatch
from pomona.skills.grip.closing import PickTouches
from pomona.skills.grip.hold import current_hold
from pomona.tools.mock import MockArm
from tests.skills.applications.conveyor.belt_rig import MODEL, SIZE, BeltRig, workspace
from tests.skills.overhead import Overhead


def code(end: SkillEnd) -> str:
    assert end.status is Status.FAILURE
    assert end.reason is not None
    assert len(end.reason.message) > 20
    return end.reason.code


def nothing_moved(rig: BeltRig) -> bool:
    return bool(np.ptp(np.array(rig.paths), axis=0).max() < 1e-9) and rig.gripper.width == 0.10


def rests_above_the_belt(rig: BeltRig, end: SkillEnd) -> bool:
    """The arm rests, and stands clear of the fruit on the belt."""
    before = rig.arm.q.copy()
    rig.clock.advance(0.2)
    return np.array_equal(before, rig.arm.q) and rig.arm.settled() and rig.height > 0.05


def drive_until(rig: BeltRig, phase: str, act: Callable[[], None], **how: Any) -> SkillEnd:
    """Drive the skill and act once when its feedback names a phase."""
    skill, done = Intercept(), []

    def tick(_: int) -> None:
        if phase in skill.feedback_message and not done:
            done.append(True)
            act()

    end = rig.intercept(skill, each_tick=tick, **how)
    assert done, f"it never came to {phase}"
    return end


def within_limits(rig: BeltRig) -> None:
    q = np.array(rig.paths)
    for order, limit in ((1, rig.arm.limits.velocity), (2, rig.arm.limits.acceleration)):
        assert (
            np.abs(np.diff(q, order, axis=0)).max(axis=0) / 0.002**order <= limit * 1.001 + 1e-6
        ).all()


@pytest.mark.parametrize("speed", [0.0, 0.15, 0.3])
def test_a_fruit_is_gripped_on_the_belt_and_lifted_and_the_hand_rests(speed: float) -> None:
    rig = BeltRig(speed, along=-0.1 if speed == 0.0 else -0.5)
    end = rig.intercept()
    assert end.status is Status.SUCCESS, end.reason
    assert rests_above_the_belt(rig, end)
    assert rig.height == pytest.approx(0.15, abs=5e-3)
    assert end.outputs["hold"].holds
    assert end.outputs["width"] == pytest.approx(0.073, abs=3e-3)
    belts = [view for topic, view in end.published if topic == "belt"]
    assert belts[0].lines
    assert [line.label for line in belts[-1].lines] == [
        "belt"
    ]  # the fruit is drawn no more where it lay
    within_limits(rig)


@pytest.mark.parametrize("speed", [0.4, 0.5])
def test_a_fruit_on_a_fast_belt_is_gripped_from_the_watch_pose_upstream(speed: float) -> None:
    rig = BeltRig(speed, along=-0.57)
    rig.arm = MockArm(rig.clock, workspace().poses["watch_2"])
    end = rig.intercept()
    assert end.status is Status.SUCCESS, end.reason
    assert rests_above_the_belt(rig, end)
    assert rig.height == pytest.approx(0.15, abs=5e-3)
    assert end.outputs["hold"].holds


def test_times_that_differ_count_by_the_speed_of_the_belt() -> None:
    codes = []
    for innovation in (9.0, 25.0):  # of 6 up to 0.3 m/s: 16.7
        rig = BeltRig(0.5, along=-0.57)
        rig.arm = MockArm(rig.clock, workspace().poses["watch_2"])

        def differ(rig: BeltRig = rig, innovation: float = innovation) -> None:
            rig.watch.alter = lambda track: replace(track, innovation=innovation, hits=40)

        end = drive_until(rig, "reaching", differ)
        codes.append("" if end.reason is None else end.reason.code)
    assert codes == ["", "POSE_MISMATCH"]


def test_the_hand_is_beside_the_fruit_to_a_millimetre_while_the_fingers_close() -> None:
    rig = BeltRig(0.3, along=-0.5)
    off: list[np.ndarray] = []
    skill = Intercept()

    def tick(_: int) -> None:
        if "closing" in skill.feedback_message:
            on_belt = np.array([-0.5 + rig.conveyor.travel(rig.clock.now()), -0.34])
            off.append(MODEL.tcp(rig.arm.q)[:2, 3] - on_belt)

    rig.intercept(skill, each_tick=tick)
    assert len(off) > 10
    assert np.abs(np.array(off)[2:]).max() < 2e-3


def test_the_grasp_that_it_gives_holds_the_fruit_at_the_hand() -> None:
    rig = BeltRig()
    grasp = rig.intercept().outputs["grasp"]
    assert grasp.T_base_grasp[:3, 3] == pytest.approx(grasp.fruit.T_base_fruit[:3, 3], abs=1e-6)
    assert grasp.T_base_grasp[2, 2] == pytest.approx(-1.0, abs=1e-3)


def test_the_first_touches_are_recorded_beside_the_fruit_that_the_belt_has_carried_on() -> None:
    rig = BeltRig(0.3, along=-0.5, aside=0.02)
    end = rig.intercept()
    (touches,) = [value for topic, value in end.published if topic == "touches"]
    assert isinstance(touches, PickTouches)
    assert touches.left is not None
    assert touches.right is not None
    assert touches.left.width == pytest.approx(SIZE[0], abs=1e-3)
    assert end.outputs["width"] == min(touches.left.width, touches.right.width)
    assert touches.T_base_fruit[:3, 3] == pytest.approx(
        rig.target.place, abs=1e-9
    )  # as it was measured
    assert touches.T_base_tcp[:2, 3] == pytest.approx(touches.T_base_fruit[:2, 3], abs=2e-3)
    assert rig.hand()[0, 3] - touches.T_base_tcp[0, 3] > 0.3  # and carried on by the belt since
    assert touches.skin == pytest.approx([SIZE[0] / 2.0] * 2, abs=3e-3)


def test_a_finger_that_touches_alone_is_recorded_as_well() -> None:
    rig = BeltRig()
    press(rig, 4.0, 0.0)
    (touches,) = [value for topic, value in rig.intercept().published if topic == "touches"]
    assert isinstance(touches, PickTouches)
    assert touches.left is not None
    assert touches.right is None


def test_a_fruit_that_has_passed_is_out_of_reach_and_nothing_moves() -> None:
    rig = BeltRig(0.3, along=0.25)
    end = rig.intercept()
    assert code(end) == "OUT_OF_REACH"
    assert end.reason is not None
    words = (
        r"the fruit has passed; 340 mm beside the base the hand reaches [5-9]\d\d mm along the belt"
    )
    assert re.match(words, end.reason.message)
    assert nothing_moved(rig)


def test_a_fruit_whose_place_is_unsure_is_let_pass_and_nothing_moves() -> None:
    rig = BeltRig()
    rig.watch.spread = 6e-3
    assert code(rig.intercept()) == "TOO_UNSURE"
    assert nothing_moved(rig)


def test_a_fruit_that_rolls_is_waited_for_and_let_pass_if_it_does_not_rest() -> None:
    rig = BeltRig()
    rig.watch.alter = lambda track: replace(track, likelier=-3.0)
    end = rig.intercept()
    assert code(end) == "TOO_UNSURE"
    assert "rolls" in end.reason.message  # type: ignore[union-attr]
    assert nothing_moved(rig)


def test_a_fruit_wider_than_the_hand_is_refused() -> None:
    rig = BeltRig(size=np.array([0.101, 0.09, 0.101]))
    assert code(rig.intercept()) == "TOO_WIDE"
    assert nothing_moved(rig)


@pytest.mark.slow
def test_a_neighbour_where_a_finger_would_come_down_lets_the_fruit_pass() -> None:
    rig = BeltRig(aside=0.0)
    rig.watch.fruit[1] = (-0.45, 0.082)
    assert code(rig.intercept()) == "NEIGHBOUR_AT_RISK"
    assert nothing_moved(rig)


OVER_THE_BELT, FRUIT = (-0.30, -0.42, 0.10), (-0.30, -0.36, -0.06)


def intercept_under_a_camera(
    rig: BeltRig,
    place: tuple[float, float, float],
    phase: str = "reaching",
    least: float = -1.0,
    **how: Any,
) -> SkillEnd:
    """Drive the skill under a camera above, which sees a ball at a place from a phase on, and a height of the hand."""
    overhead, skill = Overhead(rig.clock), Intercept()
    devices = {**rig.devices, Cameras: Cameras((rig.camera, overhead))}

    def tick(_: int) -> None:
        if phase in skill.feedback_message and rig.height > least and not overhead.balls:
            overhead.balls = ((*place, 0.045),)

    end = drive(
        skill,
        {"target": rig.target, "tracks": rig.watch},
        devices,
        clock=rig.clock,
        each_tick=tick,
        **how,
    )
    assert overhead.balls
    assert overhead.frames > 2
    return end


def rests(rig: BeltRig) -> bool:
    before = rig.arm.q.copy()
    rig.clock.advance(0.2)
    return np.array_equal(before, rig.arm.q)


def test_what_comes_over_the_belt_stops_hand_and_belt_at_once_where_they_are(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rig, ask, stopped = BeltRig(), LiveWatch.look, list[float]()

    def look(eyes: LiveWatch) -> str | None:
        try:
            return ask(eyes)
        except SkillFailure:
            stopped.append(rig.clock.now())
            raise

    monkeypatch.setattr(LiveWatch, "look", look)
    assert code(intercept_under_a_camera(rig, OVER_THE_BELT)) == "PATH_BLOCKED"
    assert rig.conveyor.stopped_at == stopped[0]
    assert rig.clock.now() < 5.0
    assert rests(rig)
    state = rig.conveyor.travelled()
    assert state is not None
    assert state.speed == 0.0


@pytest.mark.parametrize(
    ("phase", "least", "held"), [("closing", -1.0, False), ("rising", 0.02, True)]
)
def test_hand_and_belt_stop_also_at_the_fruit_which_stays_on_the_belt_or_in_the_hand(
    phase: str, least: float, held: bool
) -> None:
    rig = BeltRig()
    assert code(intercept_under_a_camera(rig, (-0.10, -0.52, 0.15), phase, least)) == "PATH_BLOCKED"
    assert rig.conveyor.stopped_at is not None
    assert rests(rig)
    assert rig.height < (0.1 if held else 0.01)  # on its way to 0.15 m, or beside the fruit
    rig.clock.advance(1.0)
    hold = current_hold(rig.gripper)
    assert (hold is not None and hold.holds) is held
    assert rig.gripper.width == pytest.approx(rig.size[0] if held else 0.103, abs=3e-3)


@pytest.mark.slow
@pytest.mark.parametrize("phase", ["letting the fruit go", "rising without the fruit"])
def test_the_way_up_after_a_failed_pick_is_watched_as_well(phase: str) -> None:
    rig = BeltRig()
    rig.there = False
    assert code(intercept_under_a_camera(rig, (0.05, -0.42, 0.10), phase)) == "PATH_BLOCKED"
    assert rig.conveyor.stopped_at is not None
    assert rests(rig)
    assert rig.gripper.width == pytest.approx(0.103, abs=1e-3)
    within_limits(rig)


def test_what_blocks_the_way_up_after_an_interruption_stops_hand_and_belt_and_is_no_error() -> None:
    rig, skill, ticks = BeltRig(), Intercept(), 40
    overhead = Overhead(rig.clock)

    def come() -> None:
        if rig.clock.now() > 0.02 * ticks and not overhead.balls:
            assert skill.feedback_message.startswith("reaching")
            x, y, z = rig.hand()[:3, 3]
            overhead.balls = ((x + 0.1, y, z + 0.1, 0.045),)

    rig.clock.each_step.append(come)
    devices = {**rig.devices, Cameras: Cameras((rig.camera, overhead))}
    inputs = {"target": rig.target, "tracks": rig.watch}
    end = drive(skill, inputs, devices, clock=rig.clock, interrupt_after=ticks)
    assert end.status is Status.INVALID
    assert rig.conveyor.stopped_at is not None
    assert rests(rig)


@pytest.mark.parametrize("seen", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_after_a_notice_a_pick_starts_only_where_its_whole_way_is_seen(seen: bool) -> None:
    rig = BeltRig()
    notice_of(rig.clock).why = "a moving object entered"
    overhead = (Overhead(rig.clock),) if seen else ()
    devices = {**rig.devices, Cameras: Cameras((rig.camera, *overhead))}
    inputs = {"target": rig.target, "tracks": rig.watch}
    end = drive(Intercept(), inputs, devices, clock=rig.clock)
    if seen:
        assert end.status is Status.SUCCESS
    else:
        assert code(end) == "PATH_BLOCKED"
        assert "no camera shows" in end.reason.message
        assert nothing_moved(rig)


@pytest.mark.slow
def test_fruit_on_the_belt_stops_neither_hand_nor_belt() -> None:
    rig = BeltRig()
    assert intercept_under_a_camera(rig, FRUIT).status is Status.SUCCESS
    assert rig.conveyor.stopped_at is None


def test_the_hand_stops_also_where_the_program_cannot_stop_the_belt() -> None:
    rig = BeltRig()
    rig.conveyor.stops = False
    assert code(intercept_under_a_camera(rig, OVER_THE_BELT)) == "PATH_BLOCKED"
    assert rests(rig)


def test_a_belt_that_does_not_stop_is_an_error_and_no_failure_that_a_tree_could_handle() -> None:
    rig = BeltRig()
    rig.conveyor.stops = StopFailed("conveyor", "the belt may run on: its contactor is welded")
    with pytest.raises(StopFailed, match="welded"):
        intercept_under_a_camera(rig, OVER_THE_BELT)
    rig.clock.advance(0.5)
    assert rests(rig)


@pytest.mark.slow
def test_a_box_over_the_belt_blocks_the_way_before_anything_moves(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from pomona.drivers import Box
    from tests.skills.applications.conveyor import belt_rig

    T = np.eye(4)
    T[:3, 3] = 0.0, -0.36, 0.03
    blocked = replace(belt_rig.workspace(), obstacles=(Box("bridge", T, (0.5, 0.2, 0.02)),))
    monkeypatch.setattr(belt_rig, "workspace", lambda: blocked)
    rig = BeltRig()
    end = rig.intercept()
    assert code(end) == "OUT_OF_REACH"
    assert "bridge" in end.reason.message  # type: ignore[union-attr]
    assert nothing_moved(rig)


def test_a_track_that_ends_before_or_during_the_reach_is_lost() -> None:
    rig = BeltRig()
    rig.watch.alter = lambda _: None
    assert code(rig.intercept()) == "TRACK_LOST"
    assert nothing_moved(rig)
    rig = BeltRig()

    def vanish() -> None:
        rig.watch.alter = lambda _: None

    end = drive_until(rig, "reaching", vanish)
    assert code(end) == "TRACK_LOST"
    assert rests_above_the_belt(rig, end)
    within_limits(rig)


def test_joints_whose_time_is_not_the_cameras_are_named_and_the_hand_rises() -> None:
    rig = BeltRig()

    def differ() -> None:
        rig.watch.alter = lambda track: replace(track, innovation=7.0, hits=40)

    end = drive_until(rig, "reaching", differ)
    assert code(end) == "POSE_MISMATCH"
    assert end.reason is not None
    assert "times of joints and frames differ" in end.reason.message
    assert rests_above_the_belt(rig, end)


def test_what_a_fast_camera_saw_before_the_hand_set_off_is_no_fault() -> None:
    rig = BeltRig()
    rig.watch.alter = lambda track: replace(track, innovation=12.0)
    assert rig.intercept().status is Status.SUCCESS


def test_an_arm_that_is_slowed_follows_no_fruit_and_nothing_moves() -> None:
    rig = BeltRig()
    rig.arm.go_at(0.15)
    end = rig.intercept()
    assert code(end) == "REFUSED"
    assert "15 %" in end.reason.message  # type: ignore[union-attr]
    assert nothing_moved(rig)


@pytest.mark.parametrize("phase", ["reaching", "closing"])
def test_a_hand_whose_arm_is_slowed_on_the_way_rises(phase: str) -> None:
    rig = BeltRig()
    end = drive_until(rig, phase, lambda: rig.arm.go_at(0.3))
    assert code(end) == "BEHIND"
    assert "30 %" in end.reason.message  # type: ignore[union-attr]
    assert rests_above_the_belt(rig, end)
    within_limits(rig)


def change_speed(rig: BeltRig, after: float) -> None:
    now, travel = rig.clock.now(), rig.conveyor.travel
    rig.conveyor.travel = lambda t: travel(min(t, now)) + after * max(t - now, 0.0)


@pytest.mark.parametrize("after", [0.0, 0.1, 0.25])
@pytest.mark.parametrize("phase", ["reaching", "closing"])
def test_a_belt_that_stops_slows_or_speeds_up_is_noticed_and_the_hand_rises(
    phase: str, after: float
) -> None:
    rig = BeltRig()
    changed: list[float] = []

    def change() -> None:
        changed.append(rig.clock.now())
        change_speed(rig, after)

    end = drive_until(rig, phase, change)
    assert code(end) == "BELT_CHANGED"
    assert rests_above_the_belt(rig, end)
    within_limits(rig)


@pytest.mark.parametrize("phase", ["reaching", "closing"])
def test_a_belt_that_creeps_is_noticed_within_200_ms(phase: str) -> None:
    rig, began, gave_up, skill = BeltRig(0.3, along=-0.5), list[float](), list[float](), Intercept()
    for t in (-0.5, -0.1):  # as Track has listened
        rig.watch.travel.note(ConveyorState(t, 0.3 * t, 0.3))

    def tick(_: int) -> None:
        now, travel = rig.clock.now(), rig.conveyor.travel
        if phase in skill.feedback_message and not began:
            began.append(now)
            rig.conveyor.travel = lambda t: travel(t) - 0.025 * max(t - now, 0.0) ** 2  # 50 mm/s²
        if (
            skill.feedback_message.startswith(("letting the fruit go", "rising without"))
            and not gave_up
        ):
            gave_up.append(now)

    end = rig.intercept(skill, each_tick=tick)
    assert code(end) == "BELT_CHANGED"
    assert gave_up[0] - began[0] < 0.2001
    assert rests_above_the_belt(rig, end)


def test_fingers_that_meet_nothing_open_and_the_hand_rises() -> None:
    rig = BeltRig()
    rig.there = False
    end = rig.intercept()
    assert code(end) == "NO_CONTACT"
    assert rig.gripper.width == pytest.approx(0.103, abs=1e-3)
    assert rests_above_the_belt(rig, end)


def press(rig: BeltRig, left: float, right: float) -> None:
    """Press the pads as soon as the fingers close beyond the fruit's width."""

    def feel(_now: float) -> np.ndarray:
        wrenches = np.zeros((2, 6))
        if rig.gripper.width < rig.size[0]:
            wrenches[:, 2] = -left, -right
        return wrenches

    rig.fingers.feel = feel


def test_a_fruit_that_presses_on_one_finger_alone_is_let_go() -> None:
    rig = BeltRig()
    press(rig, 4.0, 0.0)
    end = rig.intercept()
    assert code(end) == "ONE_FINGER"
    assert rests_above_the_belt(rig, end)


def test_force_before_the_fingers_close_ends_the_pick() -> None:
    rig = BeltRig()
    end = drive_until(
        rig, "reaching", lambda: setattr(rig.fingers, "feel", lambda _: np.full((2, 6), 5.0))
    )
    assert code(end) == "FORCE_LIMIT"
    assert rests_above_the_belt(rig, end)


def test_fingers_that_send_nothing_are_stale() -> None:
    rig = BeltRig()
    end = drive_until(rig, "closing", lambda: rig.fingers.lose(2.0))
    assert code(end) == "SENSOR_STALE"
    assert rests_above_the_belt(rig, end)


def test_saturated_fingers_end_the_pick() -> None:
    rig = BeltRig()
    end = drive_until(rig, "closing", lambda: setattr(rig.fingers, "saturated", (True, True)))
    assert code(end) == "SENSOR_SATURATED"
    assert rests_above_the_belt(rig, end)


def test_a_fruit_that_falls_during_the_lift_is_lost_and_the_hand_comes_to_rest() -> None:
    rig = BeltRig()
    end = drive_until(rig, "rising", lambda: setattr(rig, "there", False))
    assert code(end) == "LOST"
    assert rests_above_the_belt(rig, end)


def test_another_node_that_takes_the_fingers_over_ends_the_pick() -> None:
    from pomona.skills.grip import take_over

    rig = BeltRig()
    end = drive_until(rig, "closing", lambda: take_over(rig.gripper))
    assert code(end) == "LOST"
    assert rests_above_the_belt(rig, end)


def test_frames_that_stop_are_noticed_and_the_hand_rises() -> None:
    rig = BeltRig(along=-0.6)
    end = drive_until(rig, "waiting", lambda: setattr(rig.watch, "frames_until", rig.clock.now()))
    assert code(end) == "STALE_FRAME"
    assert nothing_moved(rig) or rests_above_the_belt(rig, end)


@pytest.mark.parametrize("phase", ["reaching", "closing", "rising"])
def test_frames_that_stop_are_noticed_within_200_ms_and_a_fruit_in_the_hand_is_lifted(
    phase: str,
) -> None:
    rig, stopped, gave_up, skill = BeltRig(), list[float](), list[float](), Intercept()
    words = (
        "rising with the fruit" if phase == "rising" else ("rising without", "letting the fruit go")
    )

    def tick(_: int) -> None:
        if phase in skill.feedback_message and not stopped:
            rig.watch.frames_until = rig.clock.now()
            stopped.append(rig.clock.now())
        if skill.feedback_message.startswith(words) and not gave_up:
            gave_up.append(rig.clock.now())

    end = rig.intercept(skill, each_tick=tick)
    assert code(end) == "STALE_FRAME"
    assert gave_up[0] - stopped[0] < 0.2001
    assert rests_above_the_belt(rig, end)
    within_limits(rig)
    if phase == "rising":
        assert rig.height == pytest.approx(0.15, abs=5e-3)  # as high as without it


@pytest.mark.slow
@pytest.mark.parametrize("phase", ["waiting", "reaching", "closing"])
def test_an_encoder_that_falls_silent_is_noticed_in_every_phase(phase: str) -> None:
    rig = BeltRig(along=-0.6)
    end = drive_until(rig, phase, lambda: setattr(rig.conveyor, "silent_from", rig.clock.now()))
    assert code(end) in ("ENCODER_FAULT", "BELT_CHANGED")
    assert nothing_moved(rig) or rests_above_the_belt(rig, end)


def test_an_encoder_that_counts_backwards_is_noticed() -> None:
    rig = BeltRig(along=-0.6)
    end = drive_until(rig, "waiting", lambda: change_speed(rig, -0.15))
    assert code(end) == "ENCODER_FAULT"
    assert nothing_moved(rig)


def test_an_arm_that_refuses_is_no_pick() -> None:
    rig = BeltRig()
    rig.arm.refuse_next("the controller is in teach mode")
    end = rig.intercept()
    assert code(end) == "REFUSED"
    assert "teach mode" in end.reason.message  # type: ignore[union-attr]
    assert nothing_moved(rig)


def test_a_motion_that_is_stopped_or_fails_ends_the_pick_at_rest() -> None:
    rig = BeltRig()
    end = drive_until(rig, "reaching", lambda: rig.arm.safe_stop("an operator"))
    assert code(end) == "STOPPED"
    assert rig.arm.settled()
    rig = BeltRig()
    end = drive_until(rig, "reaching", lambda: rig.arm.fail_at(0.0, "a joint is overloaded"))
    assert code(end) == "MOTION_FAILED"
    assert rig.arm.settled()


def test_a_pause_lets_the_fruit_pass() -> None:
    rig = BeltRig()
    end = drive_until(rig, "reaching", rig.arm.pause)
    assert code(end) == "BEHIND"
    assert rig.arm.settled()


def test_a_hand_that_is_slowed_down_is_behind_and_rises_without_closing() -> None:
    rig = BeltRig(0.3, along=-0.5)
    end = drive_until(rig, "reaching", lambda: rig.arm.go_at(0.2))
    assert code(end) == "BEHIND"
    assert rests_above_the_belt(rig, end)


@cache
def begins() -> dict[str, int]:
    """The tick in which each phase of an undisturbed pick begins."""
    skill, ticks = Intercept(), dict[str, int]()

    def tick(number: int) -> None:
        for phase in ("waiting", "reaching", "closing", "rising"):
            if phase in skill.feedback_message:
                ticks.setdefault(phase, number)

    BeltRig(along=-0.6).intercept(skill, each_tick=tick)
    return ticks


@pytest.mark.parametrize("phase", ["waiting", "reaching", "closing", "rising"])
def test_interrupted_in_any_phase_the_hand_rises_and_rests_and_a_held_fruit_stays_held(
    phase: str,
) -> None:
    rig = BeltRig(along=-0.6)
    end = rig.intercept(interrupt_after=begins()[phase] + 2)
    assert end.status is Status.INVALID
    assert rig.arm.settled()
    if phase == "waiting":
        assert nothing_moved(rig)
    else:
        assert rig.height > 0.05
    within_limits(rig)
