"""The skill SlipAvoidGrasp on mock devices: success, every failure code, interruption, later nodes."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from py_trees.common import Status

from pomona.drivers.errors import DeviceLost
from pomona.drivers.fruit_body import bruising_force
from pomona.drivers.interfaces import Arm, ForceSensor, Gripper, Pads, WrenchSample
from pomona.executive.encode import plain
from pomona.executive.errors import NotOwnerError
from pomona.executive.skill import Skill, Work
from pomona.executive.skill_testing import SkillEnd, drive
from pomona.executive.views import SeriesView
from pomona.skills.grip.closing import PickTouches, skin_along
from pomona.skills.grip.grip import GripPhase, UnusableRate
from pomona.skills.grip.hold import Hold, current_hold, take_over
from pomona.skills.motion.collision import fruit_points
from pomona.skills.slip_avoid_grasp import SlipAvoidGrasp
from pomona.tools.mock.arm import MockArm
from pomona.tools.mock.hand import MockClock, MockForceSensor, MockGripper, spring_fruit
from tests.skills.finger_pads import finger_pads
from tests.skills.picking_scene import ROBOT_MODEL, apple_at, q_at_grasp

WIDTH = 0.08


class Rig:
    """Mock devices with a soft fruit between the fingers."""

    def __init__(
        self, opening: float = 0.092, width: float = WIDTH, stiffness: float = 2000.0
    ) -> None:
        self.clock = MockClock()
        self.gripper = MockGripper(self.clock, width=opening)
        self.fingers = MockForceSensor(self.clock)
        self.fingers.feel = spring_fruit(self.gripper, width, stiffness)
        self.devices: dict[type, object] = {
            Gripper: self.gripper,
            ForceSensor: self.fingers,
            Pads: finger_pads(),
        }

    def drive(self, skill: SlipAvoidGrasp | None = None, **kwargs: Any) -> SkillEnd:
        inputs = kwargs.pop("inputs", {})
        return drive(skill or SlipAvoidGrasp(), inputs, self.devices, clock=self.clock, **kwargs)  # type: ignore[arg-type]

    def grasp(self) -> Hold:
        hold = self.drive().outputs["hold"]
        assert isinstance(hold, Hold)
        return hold

    def carry(self, weight: float, moment: float = 0.0) -> None:
        """Load both fingers with half of a weight [N] and of a moment [N·m]."""
        press = self.fingers.feel

        def feel(now: float) -> np.ndarray:
            wrenches = press(now)
            wrenches[:, 0] += 0.5 * weight
            wrenches[:, 5] += 0.5 * moment * np.array([1.0, -1.0])
            return wrenches

        self.fingers.feel = feel


def code(outcome: SkillEnd) -> str:
    assert outcome.status is Status.FAILURE
    assert outcome.reason is not None
    assert len(outcome.reason.message) > 20
    return outcome.reason.code


def test_it_closes_and_hands_on_a_grip_that_goes_on() -> None:
    rig = Rig()
    outcome = rig.drive()
    assert outcome.status is Status.SUCCESS
    assert outcome.duration < 1.2
    hold = outcome.outputs["hold"]
    assert hold.holds
    assert hold.problem is None
    assert hold.reading.f_n == pytest.approx(2.2, abs=0.25)
    rig.clock.advance(1.0)
    assert hold.reading.f_n == pytest.approx(2.2, abs=0.1)
    assert hold.reading.stamp == rig.clock.now()


def test_a_sensor_that_no_grip_can_use_is_refused_before_the_run() -> None:
    rig = Rig()
    rig.fingers.rate = 50.0
    skill = SlipAvoidGrasp()
    skill.bind(SimpleNamespace(device=rig.devices.get), "grasp", dict, lambda _name, _value: None)  # type: ignore[arg-type]
    with pytest.raises(UnusableRate, match="50 samples a second"):
        skill.prepare()
    assert rig.gripper.speeds == []


def test_it_starts_no_motion_before_the_bias_is_taken() -> None:
    rig = Rig()
    rig.drive()
    assert all(speed == 0.0 for t, speed in rig.gripper.speeds if t < 0.22)


def test_speeds_come_at_most_fifty_times_a_second_and_often_enough_for_the_watchdog() -> None:
    rig = Rig()
    hold = rig.grasp()
    rig.carry(3.0)
    rig.clock.advance(2.0)
    times, speeds = np.array(rig.gripper.speeds).T
    assert np.diff(times).min() > 0.0199
    assert np.diff(times)[speeds[:-1] != 0.0].max() < 0.0601
    assert np.diff(times).max() < 0.5001
    assert hold.holds


def test_fingers_that_rest_leave_the_next_command_free_for_when_it_is_needed() -> None:
    rig = Rig()
    hold = rig.grasp()
    rig.clock.advance(1.0)
    rested = rig.clock.now()
    rig.clock.advance(2.0)
    assert sum(t > rested for t, _ in rig.gripper.speeds) <= 5
    rig.carry(3.0)
    loaded = rig.clock.now()
    rig.clock.advance(0.1)
    answers = [t for t, speed in rig.gripper.speeds if t > loaded and speed < -2e-3]
    assert answers[0] - loaded < 0.015
    assert hold.holds


def test_a_measured_fruit_lets_the_fingers_move_fast_where_nothing_can_touch() -> None:
    measured = SimpleNamespace(
        dimensions=np.array([WIDTH, 0.06, WIDTH]),
        fruit=SimpleNamespace(mass=None, name="apple", pressure=1e5),
        mass=None,
        covariance=np.eye(6),
    )
    known, unknown = Rig(opening=0.103), Rig(opening=0.103)
    fast = drive(_Ungated(), {"fruit": measured}, known.devices, clock=known.clock)
    slow = unknown.drive()
    assert fast.status is Status.SUCCESS
    assert fast.duration < slow.duration - 0.1


def test_a_small_fruit_is_not_pressed_until_it_bruises() -> None:
    """An apple of 62 mm bruises from 5 N of a finger on; a moment that needs more is a problem of the grip instead."""
    measured = SimpleNamespace(
        dimensions=np.array([0.062, 0.054, 0.062]),
        fruit=SimpleNamespace(mass=None, name="apple", pressure=1e5),
        mass=None,
        covariance=np.eye(6),
    )
    rig = Rig(opening=0.074, width=0.062)
    hold = drive(_Ungated(), {"fruit": measured}, rig.devices, clock=rig.clock).outputs["hold"]
    rig.carry(1.2, moment=0.025)
    largest, limits = 0.0, set()
    for _ in range(100):
        rig.clock.advance(0.01)
        largest = max(largest, hold.reading.f_n)
        if hold.problem is not None and hold.problem.code == "FORCE_LIMIT":
            limits.add(round(hold.problem.data["limit_n"], 2))
    assert 8.0 < largest < 2.0 * bruising_force(100e3, 0.031) < 10.0
    assert limits == {8.94}


class _Ungated(SlipAvoidGrasp):
    """Takes a stand-in for the measured fruit: only its dimensions, and its kind's mass and name are read."""


def test_a_load_raises_the_force_and_the_force_follows_it_down() -> None:
    rig = Rig()
    hold = rig.grasp()
    rig.carry(3.0)
    rig.clock.advance(0.3)
    raised = hold.reading
    assert raised.f_n > 1.0 * raised.f_least
    rig.clock.advance(3.0)
    settled = hold.reading
    assert settled.f_least == pytest.approx(3.0 / 0.75, rel=0.01)
    assert settled.f_n == pytest.approx(1.065 * 1.1 * settled.f_least, rel=0.03)


def test_finger_forces_are_shown_in_one_unbroken_series() -> None:
    outcome = Rig().drive()
    views = [view for topic, view in outcome.published if topic == "grip"]
    assert all(isinstance(view, SeriesView) for view in views)
    t = np.concatenate([view.t for view in views])
    assert np.diff(t) == pytest.approx(np.full(len(t) - 1, 0.01))
    assert {"grasp force [N]", "minimum grip force [N]", "width [m]"} <= set(views[0].values)


# -------------------------------------------------------------------------------------------------- failures


def test_nothing_between_the_fingers_is_no_contact() -> None:
    rig = Rig(width=0.02)
    assert code(rig.drive()) == "NO_CONTACT"
    assert rig.gripper.speeds[-1][1] == 0.0


def test_a_jammed_gripper_is_no_contact() -> None:
    rig = Rig()
    rig.gripper.blocked_at = 0.09
    assert code(rig.drive()) == "NO_CONTACT"


def test_one_finger_that_touches_alone_is_reported_and_bounded() -> None:
    rig = Rig()
    both = rig.fingers.feel

    def only_left(now: float) -> np.ndarray:
        wrenches = both(now)
        wrenches[1] = 0.0
        return wrenches

    rig.fingers.feel = only_left
    assert code(rig.drive()) == "ONE_FINGER"
    assert -both(0.0)[0, 2] < 4.0


def test_a_stroke_that_ends_under_way_is_out_of_stroke() -> None:
    rig = Rig(opening=0.045, width=0.0360)
    assert code(rig.drive()) == "OUT_OF_STROKE"


def test_fingers_that_cannot_press_on_are_a_force_limit() -> None:
    rig = Rig()
    rig.gripper.blocked_at = 0.0792
    assert code(rig.drive()) == "FORCE_LIMIT"


def test_a_finger_that_is_pressed_before_the_start_is_a_force_limit() -> None:
    rig = Rig(opening=0.0765)
    assert code(rig.drive()) == "FORCE_LIMIT"


def test_a_motor_force_that_no_finger_measures_is_a_sensor_fault_that_ends_the_run() -> None:
    rig = Rig()
    state = rig.gripper.state
    rig.gripper.state = lambda: replace(
        state(), motor_force=2000.0 * max(WIDTH - rig.gripper.width, 0.0)
    )  # type: ignore[method-assign]
    rig.fingers.feel = lambda _now: np.zeros((2, 6))
    assert code(rig.drive()) == "SENSOR_FAULT"
    assert "motor presses" in rig.fingers.distrusted
    assert 2000.0 * (WIDTH - rig.gripper.width) < 6.0


def test_a_stream_that_goes_bad_while_the_fruit_is_held_ends_the_run_and_keeps_the_grip() -> None:
    rig = Rig()
    hold = rig.grasp()
    rig.carry(2.0)
    rig.clock.advance(1.0)
    width = rig.gripper.width
    stamp, sequence = rig.clock.now(), 10**6
    rig.fingers.lose(10.0)
    for n in range(30):  # old stamps, whatever the driver thinks of them
        rig.clock.advance(0.002)
        rig.fingers.give(WrenchSample(stamp - 0.5 + 0.002 * n, sequence + n, np.zeros((2, 6))))
    assert "no valid sample" in rig.fingers.distrusted
    rig.clock.advance(0.5)
    assert hold.holds
    assert rig.gripper.width == pytest.approx(width, abs=1e-3)


def test_samples_from_the_future_do_not_make_the_real_ones_old() -> None:
    rig = Rig()
    hold = rig.grasp()
    rig.fingers.give(WrenchSample(rig.clock.now() + 10.0, 10**6, np.zeros((2, 6))))
    rig.clock.advance(0.2)
    assert hold.problem is None
    assert hold.reading.stamp == rig.clock.now()


def test_a_silent_sensor_is_stale() -> None:
    rig = Rig()
    rig.fingers.lose(10.0)
    outcome = rig.drive()
    assert code(outcome) == "SENSOR_STALE"
    assert outcome.duration < 0.15


def test_a_stream_that_stops_while_closing_is_stale() -> None:
    rig = Rig()

    def each_tick(tick: int) -> None:
        if tick == 20:
            rig.fingers.lose(10.0)

    assert code(rig.drive(each_tick=each_tick)) == "SENSOR_STALE"


def test_a_channel_at_its_end_is_saturated() -> None:
    rig = Rig()

    def each_tick(tick: int) -> None:
        if tick == 20:
            rig.fingers.saturated = (False, True)

    assert code(rig.drive(each_tick=each_tick)) == "SENSOR_SATURATED"


def test_fingers_taken_away_while_closing_are_lost() -> None:
    rig = Rig()

    def each_tick(tick: int) -> None:
        if tick == 20:
            take_over(rig.gripper)

    assert code(rig.drive(each_tick=each_tick)) == "LOST"


# ---------------------------------------------------------------------------------------- interruption and after


def test_interrupted_before_contact_the_fingers_stop() -> None:
    rig = Rig()
    outcome = rig.drive(interrupt_after=18)
    assert outcome.status is Status.INVALID
    assert current_hold(rig.gripper) is None
    width = rig.gripper.width
    rig.clock.advance(0.5)
    assert rig.gripper.width == width


def test_interrupted_while_the_fruit_is_held_the_grip_holds() -> None:
    rig = Rig()
    ticks = round(rig.drive().duration / 0.02)
    rig = Rig()
    rig.drive(interrupt_after=ticks - 2)
    hold = current_hold(rig.gripper)
    assert hold is not None
    rig.clock.advance(1.0)
    assert hold.holds
    assert hold.reading.f_n == pytest.approx(2.2, abs=0.1)
    rig.carry(4.0)
    rig.clock.advance(0.5)
    assert hold.reading.f_n > 4.0


def test_the_grip_outlives_all_its_references() -> None:
    rig = Rig()
    rig.drive()
    rig.clock.advance(0.5)
    hold = current_hold(rig.gripper)
    assert hold is not None
    assert hold.holds


def test_a_node_that_takes_over_finds_fingers_at_rest() -> None:
    rig = Rig()
    hold = rig.grasp()
    take_over(rig.gripper)
    assert hold.ended
    assert not hold.holds
    assert hold.phase is GripPhase.ENDED
    assert rig.gripper.speeds[-1][1] == 0.0
    count, width = len(rig.gripper.speeds), rig.gripper.width
    rig.clock.advance(0.2)
    assert len(rig.gripper.speeds) == count
    assert rig.gripper.width == width


def test_a_new_grasp_takes_over_from_the_one_before() -> None:
    rig = Rig()
    first = rig.grasp()
    take_over(rig.gripper)
    rig.gripper.width = 0.092
    second = rig.grasp()
    assert first.ended
    assert current_hold(rig.gripper) is second.under(rig.gripper)


def test_a_fruit_that_is_gone_is_lost_and_nothing_closes_on() -> None:
    rig = Rig()
    hold = rig.grasp()
    rig.fingers.feel = lambda _now: np.zeros((2, 6))
    rig.clock.advance(0.3)
    assert hold.problem is not None
    assert hold.problem.code == "LOST"
    assert not hold.holds
    assert rig.gripper.speeds[-1][1] == 0.0
    assert rig.gripper.width > WIDTH - 0.012


def test_a_load_beyond_friction_is_slipping() -> None:
    rig = Rig()
    hold = rig.grasp()
    rig.gripper.blocked_at = rig.gripper.width - 1e-4
    rig.carry(4.0)
    rig.clock.advance(1.0)
    assert hold.problem is not None
    assert hold.problem.code == "SLIPPED"
    assert hold.holds


def test_a_load_beyond_the_gripper_is_a_force_limit_and_is_held_at_it() -> None:
    rig = Rig()
    hold = rig.grasp()
    rig.carry(15.0)
    rig.clock.advance(0.35)
    assert hold.reading.f_n == pytest.approx(14.0, abs=0.5)
    assert hold.problem is not None
    assert hold.problem.code in ("FORCE_LIMIT", "SLIPPED")


def test_a_lost_gripper_is_reported_and_asked_again() -> None:
    rig = Rig()
    hold = rig.grasp()
    working = rig.gripper.set_speed

    def lost(_speed: float) -> None:
        raise DeviceLost("gripper", "does not answer")

    rig.gripper.set_speed = lost  # type: ignore[method-assign]
    rig.clock.advance(0.1)
    assert hold.problem is not None
    assert "does not answer" in hold.problem.message
    rig.gripper.set_speed = working  # type: ignore[method-assign]
    rig.clock.advance(0.1)
    assert hold.problem is None


def test_a_skill_that_has_ended_commands_its_grip_no_more() -> None:
    rig = Rig()
    hold = rig.grasp()
    f_ref = hold.reading.f_ref
    for name, arguments in (
        ("slide", (0.5,)),
        ("rest_on_contact", (0.35,)),
        ("set_friction", (hold.settings.contact, 0.0, 0.6)),
        ("take_over", ()),
    ):
        with pytest.raises(NotOwnerError, match=f"'{name}'.*the skill has ended"):
            getattr(hold, name)(*arguments)
    rig.clock.advance(0.5)
    assert hold.holds
    assert hold.reading.f_ref == pytest.approx(f_ref, rel=0.02)


def test_a_skill_that_only_looks_at_the_gripper_takes_no_fingers_over() -> None:
    class Look(Skill):
        """Look at the gripper, and try to end its grip."""

        devices = (Gripper,)
        moves = ()

        def run(self) -> Work[None]:
            yield None
            take_over(self.device(Gripper))
            return None

    rig = Rig()
    hold = rig.grasp()
    with pytest.raises(NotOwnerError, match="may only look at the Gripper"):
        drive(Look(), {}, rig.devices, clock=rig.clock)  # type: ignore[arg-type]
    assert hold.holds


def touching_rig(shift: float, slides: bool = True) -> tuple[Rig, Any]:
    """A rig with an arm, and a measured fruit that really lies `shift` [m] towards the left finger."""
    rig = Rig(opening=0.103)
    T_base_tcp = ROBOT_MODEL.tcp(q_at_grasp())
    measured = apple_at(1, 3)
    across = float(skin_along(fruit_points(measured), T_base_tcp).sum())
    rig.devices[Arm] = MockArm(rig.clock, q=q_at_grasp())

    def feel(now: float) -> np.ndarray:
        nonlocal shift
        half = 0.5 * (across - rig.gripper.width)
        if slides and half + abs(shift) > 1e-3:  # a finger alone pushes it with 1 N
            shift = np.sign(shift) * max(1e-3 - half, 0.0)
        wrenches = np.zeros((2, 6))
        wrenches[:, 2] = -1000.0 * np.maximum(half + shift * np.array([1.0, -1.0]), 0.0)
        return wrenches

    rig.fingers.feel = feel
    return rig, measured


@pytest.mark.parametrize("shift", [2e-3, -2e-3])
def test_the_first_touches_are_recorded_with_the_fruit_as_the_camera_measured_it(
    shift: float,
) -> None:
    rig, measured = touching_rig(shift)
    outcome = rig.drive(inputs={"fruit": measured})
    assert outcome.status is Status.SUCCESS
    (touches,) = [value for topic, value in outcome.published if topic == "touches"]
    assert isinstance(touches, PickTouches)
    assert touches.left is not None
    assert touches.right is not None
    apart = touches.left.width - touches.right.width
    assert apart == pytest.approx(2.0 * shift, abs=1e-3)
    first = max(touches.left.width, touches.right.width)
    assert first == pytest.approx(touches.skin.sum() + 2.0 * abs(shift), abs=2e-3)
    np.testing.assert_allclose(touches.T_base_tcp, ROBOT_MODEL.tcp(q_at_grasp()))
    assert touches.on_arm
    assert plain(touches)["left"]["width"] == touches.left.width


def test_a_grip_with_one_finger_records_the_touch_that_there_was() -> None:
    rig, measured = touching_rig(2e-3, slides=False)
    outcome = rig.drive(inputs={"fruit": measured})
    assert code(outcome) == "ONE_FINGER"
    (touches,) = [value for topic, value in outcome.published if topic == "touches"]
    assert isinstance(touches, PickTouches)
    assert touches.left is not None
    assert touches.right is None


def test_without_an_arm_or_a_measured_fruit_no_touches_are_recorded() -> None:
    rig, measured = touching_rig(0.0)
    assert "touches" not in dict(rig.drive().published)
    rig, measured = touching_rig(0.0)
    del rig.devices[Arm]
    assert "touches" not in dict(rig.drive(inputs={"fruit": measured}).published)
