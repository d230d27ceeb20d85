"""Precision over recall of boxes, against counts by hand and pycocotools."""

import numpy as np
import pytest

from pomona.tools.photographs.box_evaluation import (
    JudgedPicture,
    average_precision,
    intervals,
    judge,
    recall_and_precision,
    score_for_precision,
)


def boxes(*rows: tuple[float, float, float, float]) -> np.ndarray:
    return np.array(rows, np.float64).reshape(-1, 4)


def test_a_label_is_found_once_and_by_the_surest() -> None:
    found = boxes((0, 0, 10, 10), (0, 0, 10, 9), (50, 50, 10, 10))
    scores = np.array([0.5, 0.9, 0.7])
    assert judge(found, scores, boxes((0, 0, 10, 10))).right.tolist() == [False, True, False]
    assert judge(found, scores, boxes()).right.tolist() == [False] * 3
    assert judge(boxes(), np.empty(0), boxes((0, 0, 10, 10))).right.tolist() == []


def drawn_pictures(seed: int) -> list[JudgedPicture]:
    rng, pictures = np.random.default_rng(seed), []
    for _ in range(60):
        count = int(rng.integers(0, 12))
        labelled = np.column_stack(
            [rng.uniform(0, 500, (count, 2)), rng.uniform(20, 120, (count, 2))]
        )
        kept = labelled[rng.random(count) < 0.8]
        near, extra = kept + rng.normal(0, 6, kept.shape), int(rng.integers(0, 6))
        wrong = np.column_stack([rng.uniform(0, 500, (extra, 2)), rng.uniform(20, 120, (extra, 2))])
        found = np.vstack([near, wrong, kept[:2] + rng.normal(0, 10, kept[:2].shape)])
        found[:, 2:] = np.maximum(found[:, 2:], 2)
        pictures.append(judge(found, rng.random(len(found)), labelled))
    return pictures


@pytest.mark.parametrize(("seed", "ap50"), [(0, 0.33848277), (3, 0.42289406)])
def test_the_average_precision_is_that_of_pycocotools(seed: int, ap50: float) -> None:
    # Expected: COCOeval.stats[1] of pycocotools 2.0 for the same boxes.
    assert average_precision(drawn_pictures(seed)) == pytest.approx(ap50, abs=1e-7)


def test_the_score_is_read_where_precision_last_reaches_ninety_percent() -> None:
    # Ten right, one wrong (10/11 = 0.909), one right (11/12), then wrong ones only.
    labelled = np.array([[40.0 * k, 0.0, 30.0, 30.0] for k in range(12)])
    wrong = np.array([[0.0, 300.0, 30.0, 30.0]])
    found = np.vstack([labelled[:10], wrong, labelled[10:11], wrong + 50.0, wrong + 90.0])
    scores = np.linspace(0.9, 0.1, 14)
    assert score_for_precision([judge(found, scores, labelled)]) == pytest.approx(scores[11])


def test_figures_of_no_detection_are_zero_and_of_no_label_none() -> None:
    nothing = judge(boxes(), np.empty(0), boxes((0, 0, 9, 9)))
    assert average_precision([nothing]) == 0.0
    assert np.isnan(score_for_precision([nothing]))
    assert np.isnan(average_precision([judge(boxes((0, 0, 9, 9)), np.ones(1), boxes())]))


def test_recall_and_precision_count_finds_from_the_score_on() -> None:
    found = boxes((0, 0, 10, 10), (50, 50, 10, 10), (20, 0, 10, 10))
    labelled = boxes((0, 0, 10, 10), (20, 0, 10, 10), (80, 0, 10, 10))
    picture = judge(found, np.array([0.9, 0.8, 0.3]), labelled)
    assert recall_and_precision([picture], 0.5) == (pytest.approx(1 / 3), 0.5)
    both = recall_and_precision([picture, picture], 0.2)
    assert both == (pytest.approx(2 / 3), pytest.approx(2 / 3))
    nothing = judge(boxes(), np.empty(0), boxes())
    assert np.isnan(recall_and_precision([nothing], 0.5)).all()


def test_intervals_are_wide_where_pictures_differ() -> None:
    right = judge(boxes((0, 0, 10, 10)), np.array([0.9]), boxes((0, 0, 10, 10)))
    missed = judge(boxes(), np.empty(0), boxes((0, 0, 10, 10)))
    ((low, high),) = intervals([right, missed], lambda drawn: [recall_and_precision(drawn, 0.5)[0]])
    assert (low, high) == (0.0, 1.0)
    ((low, high),) = intervals([right, right], lambda drawn: [recall_and_precision(drawn, 0.5)[0]])
    assert (low, high) == (1.0, 1.0)
    ((low, high),) = intervals(drawn_pictures(0), lambda drawn: [average_precision(drawn)])
    assert low < average_precision(drawn_pictures(0)) < high
