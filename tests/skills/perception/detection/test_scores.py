"""Scores that mean how often a detection is fruit."""

import numpy as np
import pytest

from pomona.skills.perception.detection.scores import HOPELESS, PowerScore, ScoreMap
from pomona.tools.training.photo_figures import calibration


def test_a_map_is_a_line_through_logits_and_keeps_the_order() -> None:
    rng = np.random.default_rng(0)
    scores = rng.uniform(0.01, 0.99, 20_000)
    logit = np.log(scores / (1.0 - scores))
    right = rng.random(20_000) < 1.0 / (1.0 + np.exp(-(0.6 * logit - 0.8)))  # surer than it should be
    line = ScoreMap(0.6, -0.8)
    assert calibration(scores, right)[0] > 0.1
    assert calibration(line.of(scores), right)[0] < 0.02
    assert np.array_equal(np.argsort(line.of(scores)), np.argsort(scores))
    assert line(0.3) == pytest.approx(float(line.of(np.array([0.3]))[0]))
    assert ScoreMap()(0.123) == 0.123


def test_a_score_of_powers_is_the_geometric_mean_over_both_looks() -> None:
    belief, first, second = 0.8, 0.6, 0.9
    features = np.log(np.array([[belief, 0.5, first, second]])) - np.log1p(-np.array([[belief, 0.5, first, second]]))
    expected = np.sqrt(np.sqrt(belief * first) * np.sqrt(belief * second))
    assert PowerScore().of(features) == pytest.approx([expected])
    assert PowerScore(ScoreMap(0.7, -0.2)).of(features) == pytest.approx([ScoreMap(0.7, -0.2)(expected)])
    assert PowerScore(ScoreMap(0.7, -0.2)).hopeless == ScoreMap(0.7, -0.2)(HOPELESS)
    assert PowerScore().of(np.full((1, 4), -800.0)) == pytest.approx([0.0])
