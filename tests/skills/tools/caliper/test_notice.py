"""The odds that a camera is off."""

from __future__ import annotations

import numpy as np
import pytest

from pomona.tools.caliper.estimate import estimate
from pomona.tools.caliper.findings import find_error
from pomona.tools.caliper.notice import is_off, log_odds
from tests.skills.tools.caliper.synthetic import made_pick, made_picks

SHIFTED = np.array([5e-3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])


def test_six_picks_show_five_millimetres():
    noticed = [is_off(made_picks(np.random.default_rng(seed), SHIFTED, 6)) for seed in range(40)]
    assert np.mean(noticed) > 0.9


@pytest.mark.slow
def test_a_good_cell_is_never_reported_in_thirty_looks():
    for seed in range(30):
        picks = made_picks(np.random.default_rng(seed), np.zeros(8), 30)
        assert not any(is_off(picks[:count]) for count in range(1, 31))


@pytest.mark.parametrize(
    "error", [np.array([0, 0, 0, 0, 0, 0, 0.02, 0.0]), np.array([0, 0, 0, 0, 0, 0, 0.0, 1e-3])]
)
def test_a_wrong_scale_or_zero_of_the_fingers_is_no_wrong_pose(error: np.ndarray):
    assert not is_off(made_picks(np.random.default_rng(0), error, 20))


def test_one_pushed_fruit_alone_is_never_enough():
    rng = np.random.default_rng(0)
    good = made_picks(rng, np.zeros(8), 6)
    pushed = made_pick(rng, 6.0 * SHIFTED, azimuth=0.0)
    assert not is_off([*good, pushed])
    assert not is_off([pushed])
    assert log_odds([]) == log_odds([pushed]) == (-np.inf, -np.inf)


def test_more_scatter_needs_more_picks():
    picks = made_picks(np.random.default_rng(0), SHIFTED, 5)
    assert log_odds(picks) > log_odds(picks, 2.0) > log_odds(picks, 4.0)
    assert log_odds(picks, 0.5) == log_odds(picks)


@pytest.mark.parametrize("good", [8, 24])
def test_a_camera_that_is_pushed_after_good_picks_is_noticed_within_six_picks(good: int):
    noticed = []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        before = made_picks(rng, np.zeros(8), good)
        pushed = [*before, *made_picks(rng, 1.6 * SHIFTED, 6)]
        noticed.append(find_error(estimate(pushed)).is_off)
    assert np.mean(noticed) > 0.9
