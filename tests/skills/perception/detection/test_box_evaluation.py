"""Precision over recall of boxes, against counts by hand."""

import numpy as np
import pytest

from skills.perception.detection.box_evaluation import curve, iou, match_boxes


def boxes(*rows: tuple[float, float, float, float]) -> np.ndarray:
    return np.array(rows, np.float64).reshape(-1, 4)


def test_overlap_is_the_shared_part_of_what_both_cover() -> None:
    overlaps = iou(boxes((0, 0, 10, 10), (5, 0, 10, 10)), boxes((0, 0, 10, 10), (20, 20, 1, 1)))
    assert overlaps == pytest.approx(np.array([[1.0, 0.0], [1.0 / 3.0, 0.0]]))


def test_a_label_is_found_once_and_by_the_surest() -> None:
    found = boxes((0, 0, 10, 10), (0, 0, 10, 9), (50, 50, 10, 10))
    assert match_boxes(found, np.array([0.5, 0.9, 0.7]), boxes((0, 0, 10, 10)), 0.5).tolist() == [False, True, False]
    assert match_boxes(found, np.array([0.5, 0.9, 0.7]), boxes((0, 0, 10, 10)), 0.95).tolist() == [True, False, False]
    assert match_boxes(found, np.ones(3), boxes(), 0.5).tolist() == [False] * 3


def test_recall_and_score_at_a_precision_are_those_counted_by_hand() -> None:
    here, there, nowhere = (0, 0, 10, 10), (100, 0, 10, 10), (200, 0, 10, 10)
    pictures = [
        (boxes(here, nowhere), np.array([0.9, 0.6]), boxes(here, there)),
        (boxes(here, there), np.array([0.8, 0.4]), boxes(here, there)),
    ]
    result = curve(pictures)  # right, right, wrong, right of four labels
    assert result.precision == pytest.approx([1.0, 1.0, 2 / 3, 0.75])
    assert result.recall == pytest.approx([0.25, 0.5, 0.5, 0.75])
    assert (result.recall_at(0.9), result.score_for(0.9)) == (0.5, 0.8)
    assert (result.recall_at(0.75), result.score_for(0.75)) == (0.75, 0.4)
    assert result.average_precision == pytest.approx(0.5 + 0.25 * 0.75)
    assert result.at_score(0.6) == pytest.approx((0.5, 2 / 3))
    assert result.at_score(0.95) == (0.0, 1.0)


def test_nothing_found_is_recall_zero_and_no_score() -> None:
    result = curve([(boxes(), np.empty(0), boxes((0, 0, 1, 1)))])
    assert (result.recall_at(0.5), result.score_for(0.5), result.average_precision) == (0.0, None, 0.0)
