"""Intervals against their nominal coverage."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

from pomona.tools.library.campaign.statistics import mean, median, paired_p, wilson


@given(of=st.integers(1, 5000), data=st.data())
def test_wilsons_interval_holds_the_rate_and_stays_within_0_and_1(
    of: int, data: st.DataObject
) -> None:
    successes = data.draw(st.integers(0, of))
    low, high = wilson(successes, of)
    assert 0.0 <= low <= successes / of + 1e-12
    assert successes / of - 1e-12 <= high <= 1.0


def test_intervals_of_mean_and_median_hold_the_truth_as_often_as_they_say() -> None:
    rng = np.random.default_rng(5)
    samples = rng.normal(3.0, 2.0, (300, 15))
    for estimate, wanted in ((mean, 0.95), (median, 0.93)):
        held = np.mean([(e := estimate(sample)).low <= 3.0 <= e.high for sample in samples])
        assert held == pytest.approx(wanted, abs=0.04)


def test_of_one_value_or_none_there_is_no_interval() -> None:
    assert (mean([2.0]).low, mean([2.0]).high) == (2.0, 2.0)
    assert math.isnan(mean([]).value)
    assert math.isnan(median([]).value)


def test_the_paired_comparison_is_a_fair_coins() -> None:
    assert paired_p(0, 0) == 1.0
    assert paired_p(5, 5) == 1.0
    assert paired_p(10, 0) == pytest.approx(2 * 0.5**10)
