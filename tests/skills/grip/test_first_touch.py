"""The first touch of each pad."""

from __future__ import annotations

import numpy as np
import pytest

from pomona.drivers.interfaces import GripperState
from pomona.skills.geometry import rot_z, transform
from pomona.skills.grip.first_touch import LASTING, PadTouch, TouchRecorder, skin_along

SPEED = -0.03  # of the closing [m/s]


def feel(recorder: TouchRecorder, left: list[float], right: list[float]) -> None:
    """Step a closing at 500 Hz from 100 mm; the gripper reports its state every tenth sample."""
    for i, pressing in enumerate(zip(left, right, strict=True)):
        wrenches = np.zeros((2, 6))
        wrenches[:, 2] = -np.array(pressing)
        reported = 0.002 * (i - i % 10)
        state = GripperState(reported, 0.1 + SPEED * reported, SPEED, True)
        recorder.take(0.002 * i, wrenches, state)


def test_each_pad_keeps_the_width_at_which_it_first_felt_the_fruit():
    recorder = TouchRecorder()
    feel(recorder, [0.0] * 33 + [0.5, 0.8, 1.1, 1.4] * 10, [0.1] * 47 + [0.6] * 26)
    assert recorder.complete
    left, right = recorder.touches
    assert left == PadTouch(pytest.approx(0.066), pytest.approx(0.1 + SPEED * 0.066), 0.5)
    assert right == PadTouch(pytest.approx(0.094), pytest.approx(0.1 + SPEED * 0.094), 0.6)


def test_a_spike_is_no_touch_and_does_not_hide_the_touch_that_follows():
    recorder = TouchRecorder()
    feel(recorder, [0.0, 5.0, 0.0] * 5 + [1.0] * 9, [0.0] * 24)
    assert recorder.touches[0] is not None
    assert recorder.touches[0].stamp == pytest.approx(0.03)
    assert recorder.touches[1] is None
    assert not recorder.complete


def test_a_touch_that_has_not_lasted_yet_is_not_given():
    recorder = TouchRecorder()
    feel(recorder, [1.0] * (LASTING - 1), [0.0] * (LASTING - 1))
    assert recorder.touches == [None, None]


def test_samples_that_are_no_numbers_are_no_touch():
    recorder = TouchRecorder()
    feel(recorder, [float("nan")] * 9, [0.0] * 9)
    assert recorder.touches == [None, None]


def test_a_width_is_not_carried_on_over_a_silent_gripper():
    recorder = TouchRecorder()
    for i in range(LASTING):
        wrenches = np.full((2, 6), 1.0)
        recorder.take(9.0 + 0.002 * i, wrenches, GripperState(0.0, 0.1, SPEED, True))
    assert recorder.touches[0] is not None
    assert recorder.touches[0].width == pytest.approx(0.1 + 0.05 * SPEED)


def test_the_skin_is_measured_from_the_tool_along_its_fingers():
    points = np.array([[0.03, 0.0, 0.0], [-0.05, 0.0, 0.0], [0.0, 0.2, 0.2]])
    T_base_tcp = transform(rot_z(-np.pi / 2.0), [0.01, 0.0, 0.0])  # its y axis is the base's x axis
    np.testing.assert_allclose(skin_along(points, T_base_tcp), [0.02, 0.06], atol=1e-12)
