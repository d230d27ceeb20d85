"""Figures of merit from scores alone."""

from __future__ import annotations

import numpy as np
from hypothesis import given, strategies as st

from pomona.tools.training.evaluation import Evaluation, Match

SCORES = st.lists(st.floats(0.01, 1.0), max_size=20)


def outcome(found: list[float], missed: int, wrong: list[float]) -> Evaluation:
    """So many fruit in full view, found with these scores or missed."""
    numbers = dict.fromkeys(Match.__dataclass_fields__, 0.0)
    matches = tuple(
        Match(**{**numbers, "visibility": 1.0, "scene": "table", "score": s}) for s in found
    )  # type: ignore[arg-type]
    return Evaluation(
        1, matches, ((1.0, 0.5, 60.0, "table"),) * (len(found) + missed), tuple(wrong), (0.0,)
    )


@given(SCORES, st.integers(0, 5), SCORES, st.floats(0.05, 1.0))
def test_the_score_for_a_recall_is_the_highest_that_reaches_it(
    found: list[float], missed: int, wrong: list[float], recall: float
) -> None:
    result = outcome(found, missed, wrong)
    score = result.score_for(recall)
    if score is None:
        assert result.recall(0.0) < recall or not found
        return
    assert result.recall(score) >= recall - 1e-9
    higher = float(np.nextafter(score, 2.0))
    assert result.recall(higher) < recall


def test_recall_and_precision_follow_their_definitions() -> None:
    result = outcome([0.9, 0.6, 0.4], 1, [0.7, 0.2])
    assert result.recall(0.5) == 0.5
    assert result.precision(0.5) == 2 / 3
    assert result.score_for(0.75) == 0.4
    assert result.score_for(0.8) is None


@given(SCORES, st.integers(0, 5), SCORES)
def test_the_curve_agrees_with_recall_and_precision_at_each_score(
    found: list[float], missed: int, wrong: list[float]
) -> None:
    result = outcome(found, missed, wrong)
    line, (scores, right) = result.curve(), result.judged()
    assert sorted(scores.tolist()) == sorted([*found, *wrong])
    assert int(right.sum()) == len(found)
    assert line.labelled == len(found) + missed
    for score in {*found, *wrong}:
        recall, precision = line.at_score(score)
        assert abs(recall - result.recall(score)) < 1e-9
        assert abs(precision - result.precision(score)) < 1e-9
