"""Figures of the detector on photographs that only the benchmark prints: boxes at the border, calibration of scores."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float64
from pomona.tools.photographs.box_evaluation import labels_of
from pomona.tools.photographs.photographs import Photograph
from pomona.tools.training.photo_figures import Finds, calibration

AT_BORDER = 1.0  # a box that ends this near to the picture's border counts as cut by it [px]
LEAST_SCORE = 0.05  # detections with less score are left out of calibration


def cut_by_border(photo: Photograph) -> NDArray[np.bool_]:
    """Return which boxes of a photograph end at its border, (n,)."""
    low, high = photo.boxes[:, :2], photo.boxes[:, :2] + photo.boxes[:, 2:]
    limits = np.array([photo.width, photo.height]) - AT_BORDER
    return np.asarray((low <= AT_BORDER).any(axis=1) | (high >= limits).any(axis=1), np.bool_)


def recall_at_border(
    found: Sequence[Finds], photographs: Sequence[Photograph], score: float
) -> tuple[int, int]:
    """Return how many of the boxes that the border cuts are found with at least this score, and how many there are."""
    right = asked = 0
    for finds, photo in zip(found, photographs, strict=True):
        cut = cut_by_border(photo)
        sure = finds.scores >= score
        label = labels_of(finds.boxes[sure], finds.scores[sure], finds.labelled, 0.5)
        right += int(cut[label[label >= 0]].sum())
        asked += int(cut.sum())
    return right, asked


def calibration_error(
    scores: Float64, right: NDArray[np.bool_], least: float = LEAST_SCORE
) -> float:
    """Return the expected calibration error of the detections with at least this score."""
    return calibration(scores[scores >= least], right[scores >= least])[0]


def calibration_table(scores: Float64, right: NDArray[np.bool_], least: float = LEAST_SCORE) -> str:
    """Return scores against the ratio of such detections that are right, as Markdown."""
    error, points = calibration(scores[scores >= least], right[scores >= least])
    lines = [f"Expected calibration error of detections with score ≥ {least}: {error:.3f}.", ""]
    lines += ["| mean score | ratio right | detections |", "|---|---|---|"]
    return "\n".join(
        [*lines, *(f"| {score:.2f} | {share:.2f} | {count} |" for score, share, count in points)]
    )
