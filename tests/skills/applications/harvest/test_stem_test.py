"""The test of a stem: a spring that pulls back, and errors of the sensors that look like one."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, strategies as st

from pomona.applications.harvest.stem_test import FURTHEST, StemTest

DT = 0.02


def pulled(force: Callable[[float, float], float]) -> StemTest:
    """Test a fruit whose pads measure a force, by time [s] and way [m]."""
    test, moved, time = StemTest(), 0.0, 0.0
    while test.holds is None:
        moved += DT * test.step(DT, force(time, moved), moved)
        time += DT
    return test


@pytest.mark.parametrize("stiffness", [25.0, 60.0, 150.0, 500.0])
@pytest.mark.parametrize("gain", [0.5, 1.0, 2.0])
def test_a_stem_that_pulls_back_is_found_by_a_small_pull(stiffness: float, gain: float) -> None:
    test = pulled(lambda _t, x: gain * stiffness * x)
    assert test.holds is (gain * stiffness * FURTHEST > 0.8)
    assert gain * test.rise < 2.0 * gain * 2.0


@given(bias=st.floats(-3.0, 3.0), drift=st.floats(-1.0, 1.0))
def test_a_constant_error_and_a_steady_drift_show_no_stem(bias: float, drift: float) -> None:
    assert pulled(lambda t, _x: bias + drift * t).holds is False


@given(at=st.floats(0.0, 3.0), jump=st.floats(-1.0, 1.0))
def test_a_bias_that_jumps_once_shows_no_stem(at: float, jump: float) -> None:
    assert pulled(lambda t, _x: jump * (t > at)).holds is False


@given(seed=st.integers(0, 1000))
def test_noise_of_one_newton_shows_no_stem(seed: int) -> None:
    noise = np.random.default_rng(seed)
    assert pulled(lambda _t, _x: noise.normal(0.0, 1.0 / np.sqrt(10.0))).holds is False


def test_the_pull_ends_at_a_small_force_and_the_hand_goes_home() -> None:
    ways: list[float] = []
    test = pulled(lambda _t, x: ways.append(x) or 200.0 * x)  # type: ignore[func-returns-value]
    assert test.holds
    assert 200.0 * max(ways) < 3.0
    assert ways[-1] < 2e-3


@pytest.mark.parametrize("stiffness", [0.0, 60.0])
def test_a_jolt_that_ends_the_pull_is_no_result(stiffness: float) -> None:
    test = pulled(lambda t, x: stiffness * x + 6.0 * (0.21 < t < 0.23))
    assert test.holds is (stiffness > 0.0)
    assert test.furthest > 0.02


def test_a_hand_that_never_gets_there_ends_without_a_result() -> None:
    test = StemTest()
    for _ in range(2000):
        test.step(DT, 0.0, 0.0)
    assert test.holds is False
