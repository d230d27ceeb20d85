"""Errors of a calibration from synthetic picks."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from pomona.tools.caliper.estimate import PRIOR, estimate, table_left, touch_left
from pomona.tools.caliper.pick import pick_from
from tests.skills.tools.caliper.synthetic import (
    doubted,
    looked,
    made_landing,
    made_pick,
    made_picks,
)

WITHIN_90 = 1.645  # of a normal distribution, standard deviations


@given(seed=st.integers(0, 10**6))
@settings(max_examples=20, deadline=None)
def test_a_known_error_of_the_camera_is_recovered(seed: int):
    rng = np.random.default_rng(seed)
    error = PRIOR * rng.uniform(-1.0, 1.0, 8)
    found = estimate(made_picks(rng, error, 60, tilt=np.radians(45.0)))
    shift, covariance = found.shift
    true = error[:3] + np.cross(error[3:6], found.centre) + error[6] * found.centre
    assert np.abs(shift - true).max() < 5.0 * np.sqrt(np.diag(covariance)).max()
    assert np.abs(shift - true)[:2].max() < 1e-3


@pytest.mark.parametrize(("count", "noise"), [(5, 1.0), (12, 1.0), (30, 1.0), (30, 2.0)])
def test_ninety_percent_intervals_hold_for_85_to_95_percent(count: int, noise: float):
    rng = np.random.default_rng(count)
    held = []
    for _ in range(100):
        error = PRIOR * rng.normal(size=8)
        found = estimate(made_picks(rng, error, count, noise=noise, tilt=np.radians(20.0)))
        shift, covariance = found.shift
        true = error[:3] + np.cross(error[3:6], found.centre) + error[6] * found.centre
        held.append(np.abs(shift - true) < WITHIN_90 * np.sqrt(np.diag(covariance)))
        held[-1] = np.append(held[-1], np.abs(found.error - error) < WITHIN_90 * found.std)
    assert 0.85 <= np.mean(held) <= 0.95


def test_a_fruit_that_was_pushed_away_is_left_out():
    rng = np.random.default_rng(1)
    error = np.array([6e-3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    picks = [
        *made_picks(rng, error, 15),
        made_pick(rng, error + np.array([0, 0, 0, 0, 0, 0, 0, 9e-3]), name="pushed"),
    ]
    found = estimate(picks)
    assert found.left_out == ("pushed",)
    assert len(found.used) == 15
    assert found.shift[0][0] == pytest.approx(6e-3, abs=1e-3)


def test_landings_of_a_camera_20_mm_aside_show_where_it_sits():
    rng = np.random.default_rng(4)
    error = np.array([20e-3, -8e-3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    found = estimate(looked([made_landing(rng, error, name=f"{i}") for i in range(16)], error))
    shift, covariance = found.shift
    true = error[:3]
    assert np.linalg.norm(shift - true) < 6e-3
    assert (np.abs(shift - true) < 3.0 * np.sqrt(np.diag(covariance))).all()


def test_doubted_looks_alone_show_height_and_tilts():
    error = np.array([0.0, 0.0, 15e-3, *np.radians([3.0, -2.0, 0.0]), 0.0, 0.0])
    looks = [pick_from(doubted(error), f"look {i}") for i in range(3)]
    found = estimate(looks)
    assert np.degrees(found.error[3:5]) == pytest.approx([3.0, -2.0], abs=0.1)
    assert np.degrees(found.std[5]) > 1.9  # a turn about the view does not show
    assert table_left(looks[0], np.zeros(8)) > 15e-3
    assert table_left(looks[0], found.error) < 1e-3


def test_a_plain_gripper_alone_shows_nothing_and_its_looks_show_the_table():
    error = np.array([8e-3, 0.0, 0.0, np.radians(2.0), 0.0, 0.0, 0.03, 0.0])
    picks = made_picks(np.random.default_rng(3), error, 40, plain=True)
    np.testing.assert_allclose(estimate(picks).error, 0.0, atol=1e-12)
    np.testing.assert_allclose(estimate(picks).std, PRIOR)
    found = estimate(looked(picks, error))
    assert np.degrees(found.error[3]) == pytest.approx(2.0, abs=0.1)
    assert (found.std[[0, 1, 6]] / PRIOR[[0, 1, 6]]).min() > 0.85


def test_more_scatter_than_assumed_widens_the_intervals():
    error = np.zeros(8)
    calm, rough = (
        estimate(made_picks(np.random.default_rng(4), error, 30, noise=noise)).shift[1][0, 0]
        for noise in (1.0, 3.0)
    )
    assert rough > 4.0 * calm


def test_the_true_error_leaves_nothing_of_a_pick():
    error = np.array([4e-3, -3e-3, 2e-3, 0.01, -0.02, 0.01, 0.01, 5e-4])
    pick = made_pick(np.random.default_rng(5), error, noise=0.0)
    assert touch_left(pick, error) == pytest.approx(0.0, abs=1e-12)
    assert np.isnan(touch_left(made_pick(np.random.default_rng(5), error, plain=True), error))


def test_no_pick_is_no_estimate():
    with pytest.raises(ValueError, match="at least one pick"):
        estimate([])


def test_the_table_shows_height_and_tilts_that_level_fingers_do_not():
    error = np.array([5e-3, -4e-3, 8e-3, *np.radians([0.8, -0.6, 0.0]), 0.0, 0.0])
    picks = made_picks(np.random.default_rng(0), error, 12)
    without, found = estimate(picks), estimate(looked(picks, error))
    assert without.std[2] > 5e-3
    assert found.std[2] < 3e-3
    assert abs(found.error[2] - 8e-3) < 3.0 * found.std[2]
    np.testing.assert_allclose(np.degrees(found.error[3:5]), [0.8, -0.6], atol=0.2)
    assert max(np.degrees(found.std[3:5])) < 0.2


def test_a_table_that_is_wrong_in_the_cell_file_counts_once():
    picks = made_picks(np.random.default_rng(0), np.zeros(8), 40)
    found = estimate(looked(picks, np.zeros(8), (1e-3, 0.0, 0.0)))
    assert np.sqrt(found.covariance[2, 2]) > 0.9e-3
