"""What is said to be between the fingers, when they press, hardly press, open and close."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from pomona.drivers.errors import DeviceLost
from pomona.drivers.hold_watch import GIVE, HoldWatch
from pomona.drivers.interfaces import GripperState
from pomona.drivers.mock import MockClock, MockForceSensor, MockGripper

HELD_AT = 0.087
SURE, HARDLY, NOTHING = "something is between the fingers", "something was held, and is hardly felt now", ""
Feel = Callable[[float, float], str | None]


@pytest.fixture
def clock() -> MockClock:
    return MockClock()


@pytest.fixture
def gripper(clock: MockClock) -> MockGripper:
    return MockGripper(clock, HELD_AT)


@pytest.fixture
def fingers(clock: MockClock) -> MockForceSensor:
    return MockForceSensor(clock)


@pytest.fixture
def felt(clock: MockClock, gripper: MockGripper, fingers: MockForceSensor) -> Feel:
    watch = HoldWatch(None, fingers, gripper)

    def feel(force: float, width: float) -> str | None:
        wrenches = np.zeros((2, 6))
        wrenches[:, 2] = -force
        fingers.feel = lambda _now: wrenches
        gripper.width = width
        clock.advance(0.01)
        return watch.in_hand()

    return feel


def test_fingers_that_never_pressed_hold_nothing_however_wide_they_are_open(felt: Feel) -> None:
    assert [felt(0.0, HELD_AT), felt(0.4, HELD_AT), felt(0.0, 0.1)] == [NOTHING] * 3


def test_a_fruit_whose_friction_is_felt_with_hardly_any_force_is_still_said_to_be_there(felt: Feel) -> None:
    said = [felt(3.0, HELD_AT), felt(0.3, HELD_AT + 2e-3), felt(0.1, HELD_AT + 3e-3), felt(0.3, HELD_AT)]
    assert said == [SURE, SURE, HARDLY, HARDLY]
    assert felt(2.0, HELD_AT) == SURE


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_fingers_that_opened_or_closed_from_where_they_held_it_hold_it_no_more(felt: Feel, way: float) -> None:
    assert [felt(3.0, HELD_AT), felt(0.0, HELD_AT + 1.1 * way * GIVE)] == [SURE, NOTHING]
    assert felt(0.0, HELD_AT) == NOTHING


def test_fingers_that_close_and_press_again_hold_something_where_they_are_now(felt: Feel) -> None:
    said = [felt(3.0, HELD_AT), felt(0.0, 0.103), felt(2.0, 0.06), felt(0.0, 0.06), felt(0.0, HELD_AT)]
    assert said == [SURE, NOTHING, SURE, HARDLY, NOTHING]


def test_without_a_gripper_that_answers_only_the_force_tells(
    clock: MockClock, gripper: MockGripper, felt: Feel, monkeypatch: pytest.MonkeyPatch
) -> None:
    def lost() -> GripperState:
        raise DeviceLost("gripper", "does not answer")

    monkeypatch.setattr(gripper, "state", lost)
    assert [felt(3.0, HELD_AT), felt(0.1, HELD_AT)] == [SURE, NOTHING]


def test_fingers_that_have_said_nothing_feel_nothing(clock: MockClock, gripper: MockGripper) -> None:
    assert HoldWatch(None, MockForceSensor(clock), gripper).in_hand() is None
    assert HoldWatch(None, None, gripper).in_hand() is None
