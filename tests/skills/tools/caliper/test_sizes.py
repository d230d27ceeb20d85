"""Width of picked fruit, by camera and pads."""

from __future__ import annotations

import numpy as np
import pytest

from pomona.tools.caliper.estimate import SIZE, estimate
from pomona.tools.caliper.sizes import fused_width
from tests.skills.tools.caliper.synthetic import drawn_error, made_fruit


def cell(seed: int, count: int, **how: bool):
    rng = np.random.default_rng(seed)
    error, bias = drawn_error(rng)
    made = [made_fruit(rng, error, name=f"pick {i}", bias=bias, **how) for i in range(count)]
    return [pick for pick, _ in made], np.array([width for _, width in made])


def test_the_median_error_of_the_width_is_below_half_a_millimetre_and_below_the_camera_s():
    alone, fused = [], []
    for seed in range(20):
        picks, widths = cell(seed, 20)
        found = estimate(picks)
        alone += list(np.abs([pick.across for pick in picks] - widths))
        fused += list(np.abs([fused_width(pick, found)[0] for pick in picks] - widths))
    assert np.median(fused) < 0.5e-3
    assert np.median(fused) < 0.7 * np.median(alone)


def test_ninety_percent_intervals_of_the_width_hold():
    held = []
    for seed in range(60):
        picks, widths = cell(seed, 12)
        found = estimate(picks)
        fused = np.array([fused_width(pick, found) for pick in picks])
        held.append(np.abs(fused[:, 0] - widths) < 1.645 * fused[:, 1])
    assert 0.85 <= np.mean(held) <= 0.97


def test_a_camera_that_measures_all_fruit_too_narrow_does_not_narrow_them():
    rng, bias = np.random.default_rng(0), -0.8e-3
    narrow = np.array([0.0] * 7 + [-bias])
    made = [made_fruit(rng, narrow, name=f"pick {i}", bias=bias) for i in range(40)]
    found = estimate([pick for pick, _ in made])
    off = [fused_width(pick, found)[0] - width for pick, width in made]
    assert abs(np.mean(off)) < 0.25e-3
    assert np.mean([pick.across - width for pick, width in made]) == pytest.approx(bias, abs=2e-4)


def test_a_plain_gripper_s_width_is_the_camera_s():
    picks, _ = cell(0, 5, plain=True)
    found = estimate(picks)
    width, std = fused_width(picks[0], found)
    assert width == pytest.approx(picks[0].across, abs=1e-6)
    assert std >= SIZE
