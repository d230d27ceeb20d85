"""Fingers that give way: to a push that the motor resists, and to something that they press on."""

from __future__ import annotations

import pytest

from pomona.skills.shared.yielding import MOST, RELIEVES, YieldingFingers
from pomona.tools.mock import MockClock, MockGripper


@pytest.mark.parametrize(
    ("force", "expected"), [(None, 0.06), (-5.0, 0.06), (-20.0, -RELIEVES), (20.0, 0.06)]
)
def test_fingers_that_press_outwards_on_something_close(
    force: float | None, expected: float
) -> None:
    gripper = MockGripper(MockClock(), width=0.08)
    gripper.motor_force = force
    YieldingFingers(gripper, relax=True).set_speed(0.06)
    assert gripper.speeds[-1][1] == expected


def test_fingers_press_on_the_end_of_their_stroke_unless_they_relax() -> None:
    gripper = MockGripper(MockClock(), width=0.103)
    gripper.motor_force = -20.0
    YieldingFingers(gripper).rest()
    assert gripper.speeds == []


def test_fingers_that_hold_a_fruit_follow_their_commands() -> None:
    gripper = MockGripper(MockClock(), width=0.08)
    gripper.motor_force = -20.0
    fingers = YieldingFingers(gripper, relax=True)
    fingers.holds = True
    fingers.set_speed(0.01)
    assert gripper.speeds[-1][1] == 0.01


def test_they_give_way_no_faster_than_the_gripper_moves() -> None:
    clock = MockClock()
    gripper = MockGripper(clock, width=0.09)
    gripper.motor_force = -20.0
    fingers = YieldingFingers(gripper)
    fingers.rest()
    clock.advance(0.02)
    gripper.width -= 0.02  # 1 m/s
    fingers.rest()
    assert min(speed for _, speed in gripper.speeds) == -gripper.limits.speed_max


def test_they_give_way_by_a_limited_distance() -> None:
    clock = MockClock()
    gripper = MockGripper(clock, width=0.09)
    gripper.motor_force = -20.0
    fingers = YieldingFingers(gripper, relax=True)
    for _ in range(200):
        fingers.rest()
        clock.advance(0.02)
    assert gripper.width == pytest.approx(0.09 - MOST, abs=2e-3)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_fast_push_is_followed_before_the_supervisor_takes_it_for_a_fault(side: float) -> None:
    clock = MockClock()
    gripper = MockGripper(clock, width=0.08)
    gripper.motor_force = 10.0 * side
    fingers = YieldingFingers(gripper)

    def push() -> None:
        reached = 0.08 + side * min(0.09 * max(clock.now() - 0.504, 0.0), 0.008)
        gripper.width = max(gripper.width, reached) if side > 0.0 else min(gripper.width, reached)

    clock.each_step.append(push)
    for _ in range(50):
        gripper.check()
        fingers.rest()
        clock.advance(0.02)
    assert side * (gripper.width - 0.08) > 7e-3


def test_resting_fingers_that_nothing_pushes_are_not_commanded() -> None:
    gripper = MockGripper(MockClock(), width=0.08)
    YieldingFingers(gripper).rest()
    assert gripper.speeds == []


def test_fingers_close_no_further_on_what_the_pads_press_already() -> None:
    gripper = MockGripper(MockClock(), width=0.08)
    gripper.motor_force = -20.0
    fingers = YieldingFingers(gripper, relax=True)
    fingers.set_speed(0.01, 1.9, 2.0)
    fingers.set_speed(0.01, 2.1, 2.0)
    assert [speed for _, speed in gripper.speeds] == [-RELIEVES, 0.01]


def test_a_speed_counts_as_commanded_no_longer_than_the_gripper_keeps_it() -> None:
    """After a stall of 1 s fingers that were pushed by 8 mm still give way."""
    clock = MockClock()
    gripper = MockGripper(clock, width=0.08)
    gripper.motor_force = 10.0
    fingers = YieldingFingers(gripper)
    fingers.set_speed(0.02)
    clock.advance(1.0)
    gripper.width += 8e-3
    fingers.set_speed(0.0)
    assert gripper.speeds[-1][1] > 0.0
