"""Fitting one score for two domains of which each trusts another feature."""

import numpy as np

from pomona.tools.training.fit_score import JudgedPlaces, fit_score


def domain(rng: np.random.Generator, count: int, column: int) -> JudgedPlaces:
    """Return places whose fruit only one of the logits shows; the quality shows the domain."""
    right = rng.random(count) < 0.5
    features = rng.normal(0.0, 0.3, (count, 4))
    features[:, column] = np.where(right, 2.0, -2.0) + rng.normal(0.0, 1.0, count)
    features[:, 1] = 3.0 if column == 0 else -3.0
    return JudgedPlaces(features, right)


def test_one_threshold_serves_both_domains() -> None:
    rng = np.random.default_rng(0)
    photographs, frames = domain(rng, 2000, 0), domain(rng, 300, 2)
    score = fit_score([photographs, frames])
    assert score is not None
    for fresh in (domain(rng, 1000, 0), domain(rng, 1000, 2)):
        sure = score.of(fresh.features) >= 0.5
        # Two normal distributions four standard deviations apart are told apart to 97.7 %.
        assert (sure == fresh.right).mean() > 0.95


def test_scores_are_ratios_of_fruit() -> None:
    rng = np.random.default_rng(1)
    score = fit_score([domain(rng, 4000, 0)])
    assert score is not None
    fresh = domain(rng, 4000, 0)
    values = score.of(fresh.features)
    middle = (values > 0.3) & (values < 0.7)
    assert abs(values[middle].mean() - fresh.right[middle].mean()) < 0.1


def test_places_that_are_all_fruit_or_too_few_fit_nothing() -> None:
    rng = np.random.default_rng(2)
    good = domain(rng, 100, 0)
    assert fit_score([]) is None
    assert (
        fit_score(
            [good, JudgedPlaces(np.zeros((5, 4)), np.array([True, False, True, False, True]))]
        )
        is None
    )
    assert fit_score([JudgedPlaces(np.zeros((20, 4)), np.ones(20, np.bool_))]) is None
