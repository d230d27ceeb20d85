"""Whether something else carries a held fruit, by the load along the pads; and whether the hand accelerates."""

from __future__ import annotations

from typing import cast

import numpy as np
import pytest

from pomona.drivers.errors import DeviceLost
from pomona.drivers.interfaces import Arm, ArmState
from pomona.skills.grip.controller import GripController
from pomona.skills.grip.hold import FloorWatch, Hold
from pomona.skills.grip.pads import MIRROR
from pomona.skills.grip.settings import GripSettings
from pomona.tools.mock import MockClock, MockForceSensor, MockGripper


def wrenches(*load: float) -> np.ndarray:
    """Both fingers bear half of a load along x and y of the left pad's frame [N]."""
    left = np.array([0.5 * load[0], 0.5 * load[1], -2.0, 0.0, 0.0, 0.0])
    return np.array([left, MIRROR * left])


def look(watch: FloorWatch, *load: float, samples: int = 3) -> bool:
    return [watch.look(wrenches(*load)) for _ in range(samples)][-1]


def test_a_load_that_goes_away_or_turns_round_is_carried() -> None:
    for floor in ((1.1, 0.0), (0.0, 0.0), (-3.0, 0.0), (1.5, 0.5)):
        watch = FloorWatch(0.35)
        assert not look(watch, 1.5, 0.0)
        assert look(watch, *floor), floor


def test_two_samples_are_no_contact() -> None:
    watch = FloorWatch(0.35)
    look(watch, 1.5, 0.0)
    assert not look(watch, 0.0, 0.0, samples=2)
    assert not look(watch, 1.5, 0.0)


def test_a_load_that_grows_is_borne_by_the_grip() -> None:
    watch = FloorWatch(0.35)
    look(watch, 1.5, 0.0)
    assert not look(watch, 2.5, 0.0)
    assert look(watch, 0.0, 0.0)
    assert look(watch, 1.5, 0.0)
    assert not look(watch, 2.5, 0.0)


def test_a_fruit_without_weight_is_carried_by_any_contact() -> None:
    watch = FloorWatch(0.35)
    look(watch, 0.0, 0.0)
    assert look(watch, 0.0, -0.5)


class Swung:
    """An arm whose joints speed up, then move on."""

    def __init__(self, clock: MockClock) -> None:
        self.clock, self.is_lost = clock, False

    def state(self) -> ArmState:
        if self.is_lost:
            raise DeviceLost("arm", "does not answer")
        now = self.clock.now()
        speed = 4.0 * min(now, 0.5)
        return ArmState(now, np.zeros(2), np.array([speed, -0.5 * speed]), True)


def test_the_acceleration_of_the_hand_is_bounded_by_that_of_the_joints() -> None:
    clock = MockClock()
    arm = Swung(clock)
    controller = GripController(GripSettings())
    sensor = MockForceSensor(clock, lambda _now: np.zeros((2, 6)))
    hold = Hold(MockGripper(clock), sensor, controller, clock.now, cast(Arm, arm))
    clock.advance(0.3)
    assert controller.acceleration == pytest.approx(0.1 * (4.0 + 2.0))
    clock.advance(0.3)
    assert controller.acceleration == pytest.approx(0.0)
    arm.is_lost = True
    clock.advance(0.1)
    assert controller.acceleration == 0.0
    hold.take_over()
