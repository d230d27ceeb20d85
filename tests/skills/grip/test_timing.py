"""Timers and averages."""

from __future__ import annotations

import math

import pytest

from pomona.skills.grip.timing import LowPass, Timer


def test_a_timer_counts_without_a_break() -> None:
    timer = Timer()
    assert [timer.update(is_true, 0.5) for is_true in (True, True, False, True)] == [0.5, 1.0, 0.0, 0.5]
    assert timer.lasted == 0.5


def test_an_average_starts_with_its_first_sample_and_follows_a_step_with_its_lag() -> None:
    average = LowPass(0.1)
    assert average.update(2.0, 0.01) == 2.0
    for _ in range(10):
        average.update(3.0, 0.01)
    assert average.value == pytest.approx(3.0 - math.exp(-1.0))


def test_an_average_does_not_depend_on_the_rate_of_its_samples() -> None:
    fine, coarse = LowPass(0.1, 0.0), LowPass(0.1, 0.0)
    for _ in range(10):
        fine.update(1.0, 0.002)
    assert coarse.update(1.0, 0.02) == pytest.approx(fine.value)
