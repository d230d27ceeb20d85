"""The benchmark of a fruit that swings: the fitted sine, the judgement of the limits, and following."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from benchmarks.bench_swing import SWING, Swing, fit_swing, follow, share_of_limits
from pomona.tools.mock.arm import SIA5F_LIMITS
from tests.skills.applications.conveyor.belt_rig import MODEL, workspace


@given(st.floats(0.4, 1.6), st.floats(0.0, 6.28), st.floats(0.0, 100.0))
@settings(max_examples=20, deadline=None)
def test_a_sine_without_noise_is_found_and_predicted(
    frequency: float, phase: float, since: float
) -> None:
    omega, amplitude = 2.0 * np.pi * frequency, np.array([SWING, 0.01, 0.0])
    truth = Swing(
        np.array([0.1, -0.5, 0.2]), np.cos(phase) * amplitude, np.sin(phase) * amplitude, omega
    )
    times = since + np.arange(75) / 30.0
    found = fit_swing(times, np.array([truth.at(t) for t in times]))
    ahead = times[-1] + 0.3
    assert found.at(ahead) == pytest.approx(truth.at(ahead), abs=2e-4)
    assert found.omega == pytest.approx(omega, rel=1e-3)


def test_too_few_looks_are_no_swing() -> None:
    with pytest.raises(ValueError, match="eight places"):
        fit_swing(np.arange(7) / 30.0, np.zeros((7, 3)))


def test_a_swing_takes_a_share_of_the_limits_that_grows_with_its_frequency_and_none_beyond_the_reach() -> (
    None
):
    q = workspace().poses["watch"]
    T = MODEL.tcp(q)
    shares = [
        share_of_limits(
            MODEL,
            SIA5F_LIMITS,
            Swing(T[:3, 3], np.array([SWING, 0.0, 0.0]), np.zeros(3), 2.0 * np.pi * frequency),
            T[:3, :3],
            q,
        )
        for frequency in (0.5, 1.0, 2.0)
    ]
    assert shares[1] > 1.8 * shares[0]
    assert shares[2] == pytest.approx(4.0 * shares[1], rel=0.05)  # by the acceleration
    away = Swing(
        T[:3, 3] - np.array([0.0, 2.0, 0.0]), np.array([SWING, 0.0, 0.0]), np.zeros(3), 6.0
    )
    assert share_of_limits(MODEL, SIA5F_LIMITS, away, T[:3, :3], q) == float("inf")


@pytest.mark.slow
def test_a_slow_swing_is_followed_and_one_beyond_the_limits_is_refused_before_motion() -> None:
    slow = follow(0.5, "across", 7)
    assert slow.outcome == "followed"
    assert slow.beside < 4e-3
    fast = follow(2.4, "to and fro", 7)
    assert fast.outcome == "OUT_OF_REACH"
    assert np.isnan(fast.beside)  # nothing has moved
