"""Closing on the fruit, alone: its speeds, its phases, and each problem that ends it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pomona.drivers.interfaces import GripperState
from pomona.skills.geometry import rot_z, transform
from pomona.skills.grip.closing import LASTING, Closing, PadTouch, TouchRecorder, skin_along
from pomona.skills.grip.estimate import GripEstimate
from pomona.skills.grip.grip import GripMode
from pomona.skills.grip.monitors import GripState
from pomona.skills.grip.reference import ForceReference
from pomona.skills.grip.sensor import GripSample
from pomona.skills.grip.settings import GripSettings
from pomona.skills.grip.tracking import ForceTracker

INTERVAL = 0.02


class Closed(Closing):
    """A closing with its reference, whose mode a test reads."""

    def __init__(self, settings: GripSettings) -> None:
        self.reference = ForceReference(settings)
        self.reference.close()
        super().__init__(settings, self.reference, ForceTracker(settings.loop), INTERVAL)

    @property
    def mode(self) -> GripMode:
        return self.reference.mode


def closing(**settings: Any) -> Closed:
    return Closed(GripSettings(**settings))


def state(width: float, left: float = 0.0, right: float = 0.0) -> GripState:
    reference = ForceReference(GripSettings())
    estimate = GripEstimate(left=left, right=right, f_n=2.0 * min(left, right))
    return GripState(
        GripSample(1.0, 1, 0.002, np.zeros((2, 6))), estimate, reference.mode, width, 0.0, 0.0
    )


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
    assert made.mode is GripMode.RAMP
    pressed = 0.5
    for _ in range(100):
        speed = made.command(state(0.08 - 1e-4 * pressed, pressed, pressed), -0.001)
        assert speed <= 0.0
        pressed = min(pressed + 0.02, 1.1)
        if made.mode is not GripMode.RAMP:
            break
    assert made.mode is GripMode.STANDING
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
        if made.mode is GripMode.FAILED:
            break
    assert (made.mode, code(made), speed) == (GripMode.FAILED, expected, 0.0)


def test_a_fruit_that_hops_from_one_finger_to_the_other_is_closed_on() -> None:
    made = closing()
    made.command(state(0.08, 0.5, 0.5), -0.024)
    for _ in range(10):
        made.command(state(0.079, 0.0, 0.6), -0.001)
        if made.mode is GripMode.CLOSING:
            break
    assert made.mode is GripMode.CLOSING
    assert made.problem is None


SPEED = -0.03  # of the closing [m/s]
PADS = 2000.0  # stiffness [N/m]


def feel(recorder: TouchRecorder, left: list[float], right: list[float]) -> None:
    """Step a closing at 500 Hz from 100 mm; the gripper reports its state every tenth sample."""
    for i, pressing in enumerate(zip(left, right, strict=True)):
        wrenches = np.zeros((2, 6))
        wrenches[:, 2] = -np.array(pressing)
        reported = 0.002 * (i - i % 10)
        state = GripperState(reported, 0.1 + SPEED * reported, SPEED, True)
        recorder.take(0.002 * i, wrenches, state)


def test_each_pad_keeps_the_width_at_which_it_first_felt_the_fruit():
    recorder = TouchRecorder(PADS)
    feel(recorder, [0.0] * 33 + [0.5, 0.8, 1.1, 1.4] * 10, [0.1] * 47 + [0.6] * 26)
    assert recorder.complete
    left, right = recorder.touches
    at_left, at_right = 0.1 + SPEED * 0.066 + 0.6 / 2000.0, 0.1 + SPEED * 0.094 + 1.7 / 2000.0
    assert left == PadTouch(pytest.approx(0.066), pytest.approx(at_left), 0.5)
    assert right == PadTouch(pytest.approx(0.094), pytest.approx(at_right), 0.6)


def test_the_width_has_how_far_the_first_pad_was_pressed_in_by_the_fruit_that_it_pushed():
    recorder = TouchRecorder(PADS)
    feel(recorder, [1.6] * 60, [0.0] * 30 + [0.4001] * 30)
    right = recorder.touches[1]
    assert right is not None
    assert right.width == pytest.approx(0.1 + SPEED * 0.06 + 1e-3, abs=1e-6)


def test_a_spike_is_no_touch_and_does_not_hide_the_touch_that_follows():
    recorder = TouchRecorder(PADS)
    feel(recorder, [0.0, 5.0, 0.0] * 5 + [1.0] * 9, [0.0] * 24)
    assert recorder.touches[0] is not None
    assert recorder.touches[0].stamp == pytest.approx(0.03)
    assert recorder.touches[1] is None
    assert not recorder.complete


def test_a_touch_that_has_not_lasted_yet_is_not_given():
    recorder = TouchRecorder(PADS)
    feel(recorder, [1.0] * (LASTING - 1), [0.0] * (LASTING - 1))
    assert recorder.touches == [None, None]


def test_samples_that_are_no_numbers_are_no_touch():
    recorder = TouchRecorder(PADS)
    feel(recorder, [float("nan")] * 9, [0.0] * 9)
    assert recorder.touches == [None, None]


def test_a_width_is_not_carried_on_over_a_silent_gripper():
    recorder = TouchRecorder(PADS)
    for i in range(LASTING):
        wrenches = np.full((2, 6), 1.0)
        recorder.take(9.0 + 0.002 * i, wrenches, GripperState(0.0, 0.1, SPEED, True))
    assert recorder.touches[0] is not None
    assert recorder.touches[0].width == pytest.approx(0.1 + 0.05 * SPEED)


def test_the_skin_is_measured_from_the_tool_along_its_fingers():
    points = np.array([[0.03, 0.0, 0.0], [-0.05, 0.0, 0.0], [0.0, 0.2, 0.2]])
    T_base_tcp = transform(rot_z(-np.pi / 2.0), [0.01, 0.0, 0.0])  # its y axis is the base's x axis
    np.testing.assert_allclose(skin_along(points, T_base_tcp), [0.02, 0.06], atol=1e-12)
