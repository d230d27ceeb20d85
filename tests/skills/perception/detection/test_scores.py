"""Scores that mean how often a find is fruit."""

import numpy as np
import pytest

from pomona.skills.perception.detection.scores import LEAST_SLOPE, ScoreMap, fit_scores
from pomona.skills.perception.training.photo_figures import calibration


def test_a_fitted_map_gives_the_share_that_is_right_and_keeps_the_order() -> None:
    rng = np.random.default_rng(0)
    scores = rng.uniform(0.01, 0.99, 20_000)
    logit = np.log(scores / (1.0 - scores))
    right = rng.random(20_000) < 1.0 / (1.0 + np.exp(-(0.6 * logit - 0.8)))  # surer than it should be
    fitted = fit_scores(scores, right)
    assert fitted.slope == pytest.approx(0.6, abs=0.03)
    assert fitted.offset == pytest.approx(-0.8, abs=0.05)
    assert calibration(scores, right)[0] > 0.1
    assert calibration(fitted.of(scores), right)[0] < 0.02
    assert np.array_equal(np.argsort(fitted.of(scores)), np.argsort(scores))
    assert fitted(0.3) == pytest.approx(float(fitted.of(np.array([0.3]))[0]))


def test_what_counts_more_is_fitted_better() -> None:
    scores = np.repeat([0.3, 0.7], 500)
    right = np.arange(1000) % 10 < np.where(scores < 0.5, 1, 6)
    twice = np.concatenate([scores, scores]), np.concatenate([right, np.zeros(1000, np.bool_)])
    heavy = fit_scores(*twice, np.repeat([1.0, 1e-6], 1000))
    assert heavy(0.7) == pytest.approx(fit_scores(scores, right)(0.7), abs=0.01)
    assert fit_scores(*twice)(0.7) < heavy(0.7) - 0.2


def test_finds_that_teach_nothing_leave_scores_alone_and_contrary_ones_keep_the_order() -> None:
    scores = np.linspace(0.1, 0.9, 40)
    assert fit_scores(scores, np.ones(40, np.bool_)) == fit_scores(scores[:5], scores[:5] > 0.15) == ScoreMap()
    assert fit_scores(scores, scores < 0.5).slope == LEAST_SLOPE
    assert np.isfinite(fit_scores(scores, scores > 0.5).of(np.array([0.0, 0.5, 1.0]))).all()
    assert ScoreMap()(0.123) == 0.123
