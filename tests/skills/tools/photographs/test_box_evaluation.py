"""Precision over recall of boxes, against counts by hand."""

import numpy as np
import pytest

from pomona.tools.photographs.box_evaluation import (
    JudgedPicture,
    box_figures,
    box_intervals,
    curve,
    intervals,
    iou,
    judge,
    judge_size,
    match_boxes,
    recall_and_precision,
)


def boxes(*rows: tuple[float, float, float, float]) -> np.ndarray:
    return np.array(rows, np.float64).reshape(-1, 4)


def test_overlap_is_the_common_area_over_the_whole() -> None:
    overlaps = iou(boxes((0, 0, 10, 10), (5, 0, 10, 10)), boxes((0, 0, 10, 10), (20, 20, 1, 1)))
    assert overlaps == pytest.approx(np.array([[1.0, 0.0], [1.0 / 3.0, 0.0]]))


def test_a_label_is_found_once_and_by_the_surest() -> None:
    found = boxes((0, 0, 10, 10), (0, 0, 10, 9), (50, 50, 10, 10))
    assert match_boxes(found, np.array([0.5, 0.9, 0.7]), boxes((0, 0, 10, 10)), 0.5).tolist() == [
        False,
        True,
        False,
    ]
    assert match_boxes(found, np.array([0.5, 0.9, 0.7]), boxes((0, 0, 10, 10)), 0.95).tolist() == [
        True,
        False,
        False,
    ]
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
    assert (result.recall_at(0.5), result.score_for(0.5), result.average_precision) == (
        0.0,
        None,
        0.0,
    )


def drawn_pictures(seed: int) -> list[JudgedPicture]:
    rng, pictures = np.random.default_rng(seed), []
    for number in range(60):
        count = int(rng.integers(0, 12))
        labelled = np.column_stack(
            [rng.uniform(0, 500, (count, 2)), rng.uniform(20, 120, (count, 2))]
        )
        kept = labelled[rng.random(count) < 0.8]
        near, extra = kept + rng.normal(0, 6, kept.shape), int(rng.integers(0, 6))
        wrong = np.column_stack([rng.uniform(0, 500, (extra, 2)), rng.uniform(20, 120, (extra, 2))])
        found = np.vstack([near, wrong, kept[:2] + rng.normal(0, 10, kept[:2].shape)])
        found[:, 2:] = np.maximum(found[:, 2:], 2)
        pictures.append(judge(found, rng.random(len(found)), labelled, f"tree {number % 7}"))
    return pictures


@pytest.mark.parametrize(
    ("seed", "ap", "ap50", "ap75"),
    [(0, 0.12917275, 0.33848277, 0.0536711), (3, 0.15871059, 0.42289406, 0.08260612)],
)
def test_average_precisions_are_those_of_pycocotools(
    seed: int, ap: float, ap50: float, ap75: float
) -> None:
    # Expected: COCOeval.stats[:3] of pycocotools 2.0 for the same boxes.
    figures = box_figures(drawn_pictures(seed))
    assert (figures.ap, figures.ap50, figures.ap75) == pytest.approx((ap, ap50, ap75), abs=1e-7)


def test_recall_is_read_where_precision_last_reaches_ninety_percent() -> None:
    # Ten right, one wrong (10/11 = 0.909), one right (11/12), then wrong ones only.
    labelled = np.array([[40.0 * k, 0.0, 30.0, 30.0] for k in range(12)])
    wrong = np.array([[0.0, 300.0, 30.0, 30.0]])
    found = np.vstack([labelled[:10], wrong, labelled[10:11], wrong + 50.0, wrong + 90.0])
    figures = box_figures([judge(found, np.linspace(0.9, 0.1, 14), labelled)])
    assert figures.recall == pytest.approx(11 / 12)
    assert figures.threshold == pytest.approx(np.linspace(0.9, 0.1, 14)[11])


def test_intervals_draw_groups_and_not_pictures() -> None:
    pictures = drawn_pictures(0)
    low, high = box_intervals(pictures)["ap50"]
    assert low < box_figures(pictures).ap50 < high
    one_group = [JudgedPicture(p.scores, p.right, p.labelled, "all") for p in pictures]
    low, high = box_intervals(one_group)["ap50"]
    assert low == high == pytest.approx(box_figures(pictures).ap50)


def test_figures_of_no_detection_are_zero() -> None:
    figures = box_figures([judge(np.empty((0, 4)), np.empty(0), np.array([[0.0, 0.0, 9.0, 9.0]]))])
    assert (figures.recall, figures.ap50, figures.ap) == (0.0, 0.0, 0.0)
    assert np.isnan(figures.threshold)


def test_recall_and_precision_count_finds_from_the_score_on() -> None:
    found = boxes((0, 0, 10, 10), (50, 50, 10, 10), (20, 0, 10, 10))
    picture = judge(
        found, np.array([0.9, 0.8, 0.3]), boxes((0, 0, 10, 10), (20, 0, 10, 10), (80, 0, 10, 10))
    )
    assert recall_and_precision([picture], 0.5) == (pytest.approx(1 / 3), 0.5)
    assert recall_and_precision([picture, picture], 0.2) == (
        pytest.approx(2 / 3),
        pytest.approx(2 / 3),
    )
    nothing = judge(boxes(), np.empty(0), boxes())
    assert np.isnan(recall_and_precision([nothing], 0.5)).all()


def test_a_range_of_sizes_ignores_other_labels_and_finds_of_other_sizes() -> None:
    small, large = (0, 0, 10, 12), (100, 100, 50, 40)
    found = boxes(small, large, (200, 0, 9, 9), (300, 0, 60, 60))
    scores = np.array([0.9, 0.8, 0.7, 0.6])
    picture = judge_size(found, scores, boxes(small, large), 0, 32, "a")
    assert (picture.labelled, picture.group) == (1, "a")
    assert picture.scores.tolist() == [0.9, 0.7]
    assert picture.right[0].tolist() == [True, False]
    assert judge_size(found, scores, boxes(small, large), 32, np.inf).scores.tolist() == [0.8, 0.6]
    assert judge_size(boxes(), np.empty(0), boxes(large), 12, 50).labelled == 0, (
        "the upper limit is left out"
    )


def test_intervals_are_of_groups_and_wide_where_these_differ() -> None:
    right = judge(boxes((0, 0, 10, 10)), np.array([0.9]), boxes((0, 0, 10, 10)), "a")
    missed = judge(boxes(), np.empty(0), boxes((0, 0, 10, 10)), "b")
    ((low, high),) = intervals([right, missed], lambda drawn: [recall_and_precision(drawn, 0.5)[0]])
    assert (low, high) == (0.0, 1.0)
    ((low, high),) = intervals([right, right], lambda drawn: [recall_and_precision(drawn, 0.5)[0]])
    assert (low, high) == (1.0, 1.0)
