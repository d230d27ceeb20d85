"""Figures of the detector on photographs, against labelled boxes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float64
from pomona.skills.perception.detection.compact_detector import CompactDetector
from pomona.tools.photographs.box_evaluation import (
    JudgedPicture,
    box_figures,
    box_intervals,
    judge,
)
from pomona.tools.photographs.photographs import Photograph

TITLES = {
    "recall": "recall at precision 0.90, IoU 0.5",
    "ap50": "AP50",
    "ap": "mAP50:95",
    "ap75": "AP75",
    "threshold": "score at precision 0.90",
}
"""Figures of a table, by their names in `BoxFigures`."""


def searching(
    detector: CompactDetector, photo: Photograph, least: float | None = None
) -> CompactDetector:
    """Return the detector as it searches a photograph at its scale, for places of at least this score."""
    options = replace(
        detector.options,
        working_width=max(16, round(photo.scale * photo.width)),
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

    def judged(self) -> JudgedPicture:
        """Return these against the labels."""
        return judge(self.boxes, self.scores, self.labelled, self.group)


def find_boxes(
    detector: CompactDetector,
    photographs: Sequence[Photograph],
    progress: Callable[[int, int], None] | None = None,
) -> list[Finds]:
    """Return detections in each photograph, which is shrunk by its own scale for the finder."""
    found = []
    for number, photo in enumerate(photographs):
        fruit = searching(detector, photo).find(photo.picture(), photo.K)
        boxes = np.array([f.outline(photo.width, photo.height) for f in fruit]).reshape(-1, 4)
        scores = np.array([f.score for f in fruit], np.float64)
        found.append(Finds(boxes, scores, photo.boxes, photo.group or photo.name))
        if progress is not None:
            progress(number + 1, len(photographs))
    return found


def judged(found: Sequence[Finds]) -> tuple[Float64, NDArray[np.bool_]]:
    """Return scores of all detections, and which overlap a label by half; (n,) each."""
    pictures = [finds.judged() for finds in found]
    scores = np.concatenate([np.empty(0), *(picture.scores for picture in pictures)])
    return scores, np.concatenate(
        [np.empty(0, np.bool_), *(picture.right[0] for picture in pictures)]
    )


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
    shares = (
        int(right[sure].sum()) / max(1, labelled),
        float(right[sure].mean()) if sure.any() else 1.0,
    )
    lines.append(
        f"| recall / precision at score ≥ {score:g} | {shares[0]:.3f} / {shares[1]:.3f} | |"
    )
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
