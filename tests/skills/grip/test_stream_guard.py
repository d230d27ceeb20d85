"""Samples are validated once."""

from __future__ import annotations

import numpy as np
import pytest

from pomona.skills.grip.stream_guard import StreamGuard


def periods(guard: StreamGuard, stamp: float, sequence: int, wrenches: np.ndarray) -> int:
    """Periods of the sample that the guard lets through, or 0."""
    sample = guard.accept(stamp, sequence, wrenches)
    return 0 if sample is None else sample.periods


def test_the_guard_counts_periods_and_names_irregular_ones() -> None:
    guard = StreamGuard(0.002)
    zero = np.zeros((2, 6))
    assert periods(guard, 0.000, 0, zero) == 1
    assert periods(guard, 0.002, 1, zero) == 1
    assert periods(guard, 0.002, 1, zero) == 0
    assert periods(guard, 0.001, 0, zero) == 0
    assert periods(guard, 0.004, 2, np.full((2, 6), np.nan)) == 0
    assert periods(guard, 0.012, 6, zero) == 5
    assert periods(guard, 1.012, 506, zero) == 10
    text = " ".join(guard.findings())
    assert "1 repeated" in text
    assert "1 samples came out of order" in text
    assert "not finite" in text
    assert "503 samples are missing, the longest gap was 998 ms" in text


def test_a_restarted_sensor_is_followed() -> None:
    guard = StreamGuard(0.002)
    periods(guard, 5.0, 1000, np.zeros((2, 6)))
    assert periods(guard, 5.5, 0, np.zeros((2, 6))) > 0
    assert periods(guard, 5.502, 1, np.zeros((2, 6))) == 1


def test_a_sample_carries_its_time_and_its_flags() -> None:
    guard = StreamGuard(0.002)
    guard.accept(1.0, 0, np.zeros((2, 6)))
    sample = guard.accept(1.006, 3, np.ones((2, 6)), (True, False))
    assert sample is not None
    assert sample.elapsed == pytest.approx(0.006)
    assert sample.saturated == (True, False)
    assert sample.stamp == guard.stamp == 1.006
