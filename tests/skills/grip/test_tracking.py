"""Effect of the fingers' own motion on the grip force."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from benchmarks.grasp_patch import Fruit, PatchGrasp
from pomona.skills.grip.settings import ForceLoopSettings, TrackingSettings
from pomona.skills.grip.tracking import CommandTiming, ForceTracker, finger_speed

PERIOD = 0.002


def test_fingers_that_close_are_expected_to_press_more_once_they_have_got_going() -> None:
    tracker = ForceTracker(ForceLoopSettings(stiffness=1500.0))
    expected = [tracker.expected(-0.01, PERIOD) for _ in range(100)]
    assert expected[0] < 0.2 * expected[-1]
    assert expected == sorted(expected)
    assert expected[-1] == pytest.approx(0.01 * 1500.0 * PERIOD, rel=1e-3)


def test_fast_motion_is_not_relied_upon() -> None:
    tracker = ForceTracker(ForceLoopSettings())
    for _ in range(100):
        expected = tracker.expected(-0.2, PERIOD)
    assert expected == pytest.approx(TrackingSettings().foreseen * 2000.0 * PERIOD)


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
    assert finger_speed(9.0, 0.0, 5.0, SETTINGS, hardest=9.99) == pytest.approx(
        -0.01 / 2000.0 / 0.02
    )
    assert finger_speed(3.0, 0.0, 5.0, SETTINGS, hardest=12.0) > 0.0
    assert finger_speed(9.0, 0.0, 5.0, SETTINGS, hardest=math.nan) == 0.0


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


def times_of(rates: list[float], holding: bool = True) -> list[float]:
    """When rates [m/s], wanted sample by sample at 500 Hz, go out [s]."""
    timing, sent, before = CommandTiming(500.0), [], 0.0
    for n, rate in enumerate(rates):
        if timing.pass_time(1) and timing.goes_out(rate, before, holding):
            sent.append(0.002 * n)
            before = rate
    return sent


def gaps(times: list[float]) -> list[float]:
    return [round(b - a, 4) for a, b in pairwise(times)]


def test_never_two_within_twenty_milliseconds() -> None:
    rates = [0.01 * (-1) ** n for n in range(500)]
    assert min(gaps(times_of(rates))) == 0.02


def test_a_continued_command_is_sent_again_within_the_watchdogs_time() -> None:
    assert max(gaps(times_of([-0.001] * 1000))) == 0.06


def test_rest_is_reported_twice_a_second() -> None:
    assert gaps(times_of([0.0] * 1500))[-2:] == [0.5, 0.5]


def test_trims_wait_only_when_it_has_been_calm() -> None:
    trims = [0.0005 * (-1) ** (n // 10) for n in range(600)]
    spread = gaps(times_of([0.05] * 10 + trims))
    assert spread[:7] == [0.02] * 7
    assert spread[-5:] == [0.06] * 5
    stirred = gaps(times_of(trims + [0.05] * 10 + trims[:100]))
    assert stirred[-8:] == [0.02] * 8


def test_urgent_messages_go_out_at_once_when_the_channel_is_free() -> None:
    rates = [0.0] * 700 + [-0.05] * 10
    assert 1.4 in [round(t, 4) for t in times_of(rates)]


def test_before_the_hold_every_rate_goes_out() -> None:
    assert max(gaps(times_of([0.0] * 1000, holding=False))) == 0.02


@pytest.mark.parametrize(("step", "corrects"), [(0.0, True), (0.37e-3, False)])
def test_an_excess_that_a_step_would_turn_into_a_lack_stays(step: float, corrects: bool) -> None:
    tracker = ForceTracker(ForceLoopSettings(step=step))
    tracker.commanded(3.0)
    assert (tracker.while_holding(3.0, 3.6, 0.0, 0.1, 0.0) > 0.0) is corrects  # a step is 0.74 N


def test_a_lack_is_corrected_with_any_step() -> None:
    tracker = ForceTracker(ForceLoopSettings(step=0.37e-3))
    tracker.commanded(3.0)
    assert tracker.while_holding(3.0, 2.6, 0.0, 0.1, 0.0) < 0.0
    assert tracker.while_holding(3.0, 4.2, 0.0, 0.1, 0.0) > 0.0
