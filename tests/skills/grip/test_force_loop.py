"""The force loop alone, and on two soft pads with a real drive."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.grasp_patch import Fruit, PatchGrasp
from pomona.skills.grip.force_loop import ForceLoopSettings, PadStiffness, finger_speed

SETTINGS = ForceLoopSettings(max_force=10.0)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_value_that_is_not_finite_stops_the_fingers(bad: float) -> None:
    assert finger_speed(bad, 0.0, 2.0, SETTINGS) == 0.0
    assert finger_speed(2.0, bad, 2.0, SETTINGS) == 0.0
    assert finger_speed(2.0, 0.0, bad, SETTINGS) == 0.0


def test_too_little_force_closes_and_too_much_opens_within_bounds() -> None:
    assert finger_speed(3.0, 0.0, 2.9, SETTINGS) == pytest.approx(-SETTINGS.gain * 0.1 / 2000.0)
    assert finger_speed(2.9, 0.0, 3.0, SETTINGS) == pytest.approx(SETTINGS.gain * 0.1 / 2000.0)
    assert finger_speed(10.0, 1e4, 0.0, SETTINGS) == -SETTINGS.closing_speed
    assert finger_speed(0.0, 0.0, 9.0, SETTINGS) == SETTINGS.opening_speed


def test_beyond_the_force_limit_nothing_closes() -> None:
    assert finger_speed(50.0, 0.0, 12.0, SETTINGS) > 0.0
    assert finger_speed(50.0, 0.0, 25.0, SETTINGS) == 0.0
    assert finger_speed(50.0, 0.0, 9.99, SETTINGS) == pytest.approx(-SETTINGS.gain * 0.01 / 2000.0)


def test_the_finger_that_presses_harder_is_not_pressed_beyond_its_half_of_the_limit() -> None:
    assert finger_speed(9.0, 0.0, 5.0, SETTINGS, hardest=10.0) == 0.0
    assert finger_speed(9.0, 0.0, 5.0, SETTINGS, hardest=9.99) == pytest.approx(-0.01 / 2000.0 / 0.02)
    assert finger_speed(3.0, 0.0, 5.0, SETTINGS, hardest=12.0) > 0.0
    assert finger_speed(9.0, 0.0, 5.0, SETTINGS, hardest=math.nan) == 0.0


def test_a_stiffening_pad_is_undone() -> None:
    pads = PadStiffness(quadratic=2.0e6)
    assert pads.pressed(2.0e6 * 0.001**2) == pytest.approx(0.001)
    step = 1e-7
    rise = (2.0e6 * (0.001 + step) ** 2 - 2.0e6 * 0.001**2) / step
    assert pads.slope(2.0) == pytest.approx(rise, rel=1e-3)


def track(f_ref: np.ndarray) -> np.ndarray:
    """True grasp force while the loop tracks a reference given every 2 ms, from 2 N."""
    grasp = PatchGrasp(Fruit(mass=0.2))
    settings = ForceLoopSettings(max_force=16.0)
    before, speed, forces = f_ref[0], 0.0, []
    reference = np.concatenate([np.full(500, f_ref[0]), f_ref])
    for i, wanted in enumerate(reference):
        grasp.step()
        if i % 10 == 0:
            speed = finger_speed(wanted, (wanted - before) / 0.02, grasp.f_n, settings, speed)
            speed = max(speed, -0.024) if i < 400 else speed
            grasp.command, before = speed, wanted
        forces.append(grasp.f_n)
    return np.array(forces[500:])


def test_a_step_is_reached_without_droop_and_with_little_overshoot() -> None:
    forces = track(np.concatenate([np.full(50, 3.0), np.full(450, 5.0)]))[50:]
    assert np.argmax(forces > 4.8) * 0.002 < 0.05
    assert forces.max() < 5.35
    assert forces[-50:] == pytest.approx(np.full(50, 5.0), abs=0.02)


def test_a_ramp_is_tracked_closely() -> None:
    reference = np.concatenate([np.full(100, 2.0), 2.0 + 2.0 * 0.002 * np.arange(1000)])
    error = (track(reference) - reference)[200:]
    assert np.sqrt(np.mean(error**2)) < 0.06
