"""Figures of the detector on photographs, against labelled boxes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float64
from pomona.skills.perception.detection.box_evaluation import (
    JudgedPicture,
    box_figures,
    box_intervals,
    judge,
    labels_of,
)
from pomona.skills.perception.detection.compact_detector import CompactDetector
from pomona.skills.perception.training.photographs import Photograph

TITLES = {
    "recall": "recall at precision 0.90, IoU 0.5",
    "ap50": "AP50",
    "ap": "mAP50:95",
    "ap75": "AP75",
    "threshold": "score at precision 0.90",
}
"""Figures of a table, by their names in `BoxFigures`."""

AT_BORDER = 1.0  # a box that ends this near to the picture's border counts as cut by it [px]
LEAST_SCORE = 0.05  # detections with less score are left out of calibration


def searching(
    detector: CompactDetector, photo: Photograph, scale: float, least: float | None = None
) -> CompactDetector:
    """Return the detector as it searches a photograph that is shrunk by `scale`, for places of at least this score."""
    options = replace(
        detector.options,
        working_width=max(16, round(scale * photo.width)),
        most_fruit=60,  # places that are looked at in one photograph
        finder_threshold=detector.options.finder_threshold if least is None else least,
    )
    return detector.looking(options)


@dataclass(frozen=True, slots=True, eq=False)
class Finds:
    """Detections in one photograph."""

    boxes: Float64  # x, y, w, h (n, 4) [px]
    scores: Float64  # (n,)
    labelled: Float64  # labelled boxes, (m, 4) [px]
    group: str  # as of `Photograph`
    cut: NDArray[np.bool_]  # which labelled boxes the picture's border cuts, (m,)

    def judged(self) -> JudgedPicture:
        """Return these against the labels."""
        return judge(self.boxes, self.scores, self.labelled, self.group)


def find_boxes(
    detector: CompactDetector,
    photographs: Sequence[Photograph],
    scale: float,
    progress: Callable[[int, int], None] | None = None,
) -> list[Finds]:
    """Return detections in each photograph, which is shrunk by `scale` for the finder."""
    found = []
    for number, photo in enumerate(photographs):
        fruit = searching(detector, photo, scale).find(photo.picture(), photo.K)
        boxes = np.array([f.outline(photo.width, photo.height) for f in fruit]).reshape(-1, 4)
        scores = np.array([f.score for f in fruit], np.float64)
        found.append(Finds(boxes, scores, photo.boxes, photo.group, cut_by_border(photo)))
        if progress is not None:
            progress(number + 1, len(photographs))
    return found


def cut_by_border(photo: Photograph) -> NDArray[np.bool_]:
    """Return which boxes of a photograph end at its border, (n,)."""
    low, high = photo.boxes[:, :2], photo.boxes[:, :2] + photo.boxes[:, 2:]
    limits = np.array([photo.width, photo.height]) - AT_BORDER
    return np.asarray((low <= AT_BORDER).any(axis=1) | (high >= limits).any(axis=1), np.bool_)


def recall_at_border(found: Sequence[Finds], score: float) -> tuple[int, int]:
    """Return how many of the boxes that the border cuts are found with at least this score, and how many there are."""
    right = asked = 0
    for finds in found:
        sure = finds.scores >= score
        label = labels_of(finds.boxes[sure], finds.scores[sure], finds.labelled, 0.5)
        right += int(finds.cut[label[label >= 0]].sum())
        asked += int(finds.cut.sum())
    return right, asked


def judged(found: Sequence[Finds]) -> tuple[Float64, NDArray[np.bool_]]:
    """Return scores of all detections, and which overlap a label by half; (n,) each."""
    pictures = [finds.judged() for finds in found]
    scores = np.concatenate([np.empty(0), *(picture.scores for picture in pictures)])
    return scores, np.concatenate([np.empty(0, np.bool_), *(picture.right[0] for picture in pictures)])


def photo_table(found: Sequence[Finds], score: float) -> str:
    """Return figures with 95 % intervals, from groups drawn again, as Markdown."""
    pictures = [finds.judged() for finds in found]
    result, bounds = box_figures(pictures), box_intervals(pictures)
    scores, right = judged(found)
    sure, labelled = scores >= score, sum(picture.labelled for picture in pictures)
    lines = ["| figure | value | 95 % |", "|---|---|---|"]
    for name, title in TITLES.items():
        low, high = bounds[name]
        lines.append(f"| {title} | {getattr(result, name):.3f} | {low:.3f}–{high:.3f} |")
    shares = int(right[sure].sum()) / max(1, labelled), float(right[sure].mean()) if sure.any() else 1.0
    lines.append(f"| recall / precision at score ≥ {score:g} | {shares[0]:.3f} / {shares[1]:.3f} | |")
    return "\n".join(lines)


def calibration(
    scores: Float64, right: NDArray[np.bool_], bins: int = 10
) -> tuple[float, list[tuple[float, float, int]]]:
    """Return the expected calibration error of scores, (n,) in 0..1, and the points of its plot.

    The error is the mean over all detections of |mean score - ratio right| of their bin of equal width; a point is
    (mean score, ratio right, count) of a bin that is not empty.
    """
    which = np.minimum((scores * bins).astype(int), bins - 1)
    points = [
        (float(scores[inside].mean()), float(right[inside].mean()), int(inside.sum()))
        for k in range(bins)
        if (inside := which == k).any()
    ]
    error = sum(count * abs(score - share) for score, share, count in points) / max(1, len(scores))
    return error, points


def calibration_error(scores: Float64, right: NDArray[np.bool_], least: float = LEAST_SCORE) -> float:
    """Return the expected calibration error of the detections with at least this score."""
    return calibration(scores[scores >= least], right[scores >= least])[0]


def calibration_table(scores: Float64, right: NDArray[np.bool_], least: float = LEAST_SCORE) -> str:
    """Return scores against the ratio of such detections that are right, as Markdown."""
    error, points = calibration(scores[scores >= least], right[scores >= least])
    lines = [f"Expected calibration error of detections with score ≥ {least}: {error:.3f}.", ""]
    lines += ["| mean score | ratio right | detections |", "|---|---|---|"]
    return "\n".join([*lines, *(f"| {score:.2f} | {share:.2f} | {count} |" for score, share, count in points)])
