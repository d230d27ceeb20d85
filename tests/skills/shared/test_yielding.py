"""Fingers that give way to a push that the motor resists."""

from __future__ import annotations

import pytest

from pomona.skills.shared.yielding import MOST, YieldingFingers
from pomona.tools.mock import MockClock, MockGripper


def test_fingers_that_press_on_the_end_of_their_stroke_are_not_commanded() -> None:
    gripper = MockGripper(MockClock(), width=0.103)
    gripper.motor_force = -20.0
    YieldingFingers(gripper).rest()
    assert gripper.speeds == []


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
    gripper = MockGripper(clock, width=0.02)
    gripper.motor_force = 10.0
    fingers = YieldingFingers(gripper)
    given = 0.0
    for _ in range(100):
        fingers.rest()
        given += 0.02 * gripper.speeds[-1][1] if gripper.speeds else 0.0
        clock.advance(0.02)
        gripper.width = min(gripper.width + 1e-3, 0.1)  # 50 mm/s
    assert MOST <= given <= MOST + 2e-3 + 1e-9
    assert gripper.speeds[-1][1] == 0.0


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


def test_a_push_after_a_stall_is_no_motion_that_a_command_explains() -> None:
    """A gripper keeps a speed for 100 ms: what it moves in the second after that is a push."""
    clock = MockClock()
    gripper = MockGripper(clock, width=0.05)
    gripper.motor_force = 10.0
    fingers = YieldingFingers(gripper)
    clock.advance(0.02)
    gripper.width += 4e-3
    fingers.rest()
    assert gripper.speeds[-1][1] > 0.0
    clock.advance(1.0)
    gripper.width += 15e-3
    fingers.rest()
    assert gripper.speeds[-1][1] > 0.0
