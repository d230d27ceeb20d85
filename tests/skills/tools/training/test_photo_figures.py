"""Figures on photographs, against values worked out by hand."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.photo_border import calibration_error, cut_by_border, recall_at_border
from pomona.tools.photographs.photographs import Photograph
from pomona.tools.training.photo_figures import (
    Finds,
    calibration,
    judged,
    photo_table,
)

LABELS = np.array(
    [
        [0.0, 10.0, 20.0, 20.0],
        [40.0, 40.0, 20.0, 20.0],
        [80.5, 10.0, 19.5, 20.0],
        [10.0, 79.5, 9.0, 20.0],
    ]
)


def photo() -> Photograph:
    return Photograph(Path("a.jpg"), 100, 100, LABELS, np.zeros(4, np.bool_), "a")


def finds(boxes: list[list[float]], scores: list[float]) -> Finds:
    return Finds(np.array(boxes), np.array(scores), LABELS, "a")


def test_boxes_that_end_at_the_border_are_cut() -> None:
    assert cut_by_border(photo()).tolist() == [True, False, True, True]


def test_recall_at_the_border_counts_cut_boxes_alone() -> None:
    found = finds(
        [[1, 10, 19, 20], [40, 40, 20, 20], [82, 10, 18, 20], [10, 80, 9, 20]], [0.9, 0.9, 0.4, 0.9]
    )
    assert recall_at_border([found], [photo()], 0.5) == (2, 3)
    assert recall_at_border([found, found], [photo(), photo()], 0.3) == (6, 6)
    assert recall_at_border([finds([[60, 60, 9, 9]], [0.9])], [photo()], 0.5) == (0, 3)


def test_calibration_is_the_mean_distance_of_score_and_ratio() -> None:
    scores = np.array([0.95, 0.95, 0.15, 0.15, 0.01])
    right = np.array([True, False, False, False, True])
    error, points = calibration(scores[:4], right[:4])
    assert points == [(0.15, 0.0, 2), (0.95, 0.5, 2)]
    assert error == pytest.approx(0.5 * 0.15 + 0.5 * 0.45)
    assert calibration_error(scores, right) == pytest.approx(
        error
    )  # scores below 0.05 are left out
    assert calibration_error(np.empty(0), np.empty(0, np.bool_)) == 0.0


def test_the_table_has_recall_and_precision_at_the_score() -> None:
    found = [finds([[0, 10, 20, 20], [40, 40, 20, 20], [60, 60, 9, 9]], [0.9, 0.8, 0.7])]
    scores, right = judged(found)
    assert (scores.tolist(), right.tolist()) == ([0.9, 0.8, 0.7], [True, True, False])
    assert "| recall / precision at score ≥ 0.7 | 0.500 / 0.667 | |" in photo_table(found, 0.7)
