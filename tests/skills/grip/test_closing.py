"""Closing on the fruit, alone: its speeds, its phases, and each problem that ends it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pomona.skills.grip.closing import Closing
from pomona.skills.grip.estimate_kernel import GripEstimate
from pomona.skills.grip.grip import GripPhase
from pomona.skills.grip.monitors import GripState
from pomona.skills.grip.reference import ForceReference
from pomona.skills.grip.settings import GripSettings
from pomona.skills.grip.stream_guard import GripSample
from pomona.skills.grip.tracking import ForceTracker

INTERVAL = 0.02


def closing(**settings: Any) -> Closing:
    made = GripSettings(**settings)
    return Closing(made, ForceReference(made), ForceTracker(made.loop), INTERVAL)


def state(width: float, left: float = 0.0, right: float = 0.0) -> GripState:
    reference = ForceReference(GripSettings())
    estimate = GripEstimate(left=left, right=right, f_n=2.0 * min(left, right))
    return GripState(GripSample(1.0, 1, 0.002, np.zeros((2, 6))), estimate, reference.mode, width, 0.0, 0.0)


def code(made: Closing) -> str:
    return "" if made.problem is None else made.problem.code


def test_the_fingers_are_fast_until_contact_may_come() -> None:
    settings = GripSettings()
    made = closing(contact_width=0.08)
    assert made.command(state(0.10), 0.0) == -settings.approach_speed
    assert made.command(state(0.081), -settings.approach_speed) == -settings.contact_speed
    assert closing().command(state(0.10), 0.0) == -settings.contact_speed


def test_contact_of_both_fingers_begins_the_ramp_and_the_force_ends_it() -> None:
    made = closing()
    assert made.command(state(0.08, 0.5, 0.5), -0.024) == 0.0
    assert made.phase is GripPhase.RAMP
    pressed = 0.5
    for _ in range(100):
        speed = made.command(state(0.08 - 1e-4 * pressed, pressed, pressed), -0.001)
        assert speed <= 0.0
        pressed = min(pressed + 0.02, 1.1)
        if made.phase is not GripPhase.RAMP:
            break
    assert made.phase is GripPhase.HOLDING
    assert pressed > 0.9 * 0.5 * GripSettings().initial_force


@pytest.mark.parametrize(
    ("states", "expected"),
    [
        ([state(0.08, 0.5), state(0.05, 0.5)], "ONE_FINGER"),  # pushed by 15 mm
        ([state(0.08, 0.0, 3.5)], "ONE_FINGER"),
        ([state(0.0002)], "NO_CONTACT"),
        ([state(0.09)] * 30, "NO_CONTACT"),  # commanded to close, and standing
        ([state(0.0002, 0.5, 0.5)] * 2, "OUT_OF_STROKE"),
        ([state(0.08, 0.5, 0.5)] + [state(0.08)] * 8, "NO_CONTACT"),  # slipped away
    ],
    ids=["pushed far", "pushed hard", "nothing there", "stuck", "end of stroke", "slipped away"],
)
def test_a_problem_ends_it_with_the_fingers_at_rest(states: list[GripState], expected: str) -> None:
    made = closing()
    for now in states:
        speed = made.command(now, -0.024)
        if made.phase is GripPhase.FAILED:
            break
    assert (made.phase, code(made), speed) == (GripPhase.FAILED, expected, 0.0)


def test_a_fruit_that_hops_from_one_finger_to_the_other_is_closed_on() -> None:
    made = closing()
    made.command(state(0.08, 0.5, 0.5), -0.024)
    for _ in range(10):
        made.command(state(0.079, 0.0, 0.6), -0.001)
        if made.phase is GripPhase.CLOSING:
            break
    assert made.phase is GripPhase.CLOSING
    assert made.problem is None
