"""What scores mean, fitted on finds of which it is known whether they are fruit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from skills.perception.detection.box_evaluation import match_boxes
from skills.perception.detection.compact_detector import CompactDetector
from skills.perception.detection.evaluation import evaluate
from skills.perception.detection.scores import ScoreMap, fit_scores
from skills.perception.fruit import FruitModel
from skills.perception.training.photo_figures import Finds, find_boxes
from skills.perception.training.photographs import Photograph, fruit_scale
from skills.perception.training.samples import FrameFolder

F64 = NDArray[np.float64]

LEAST = 0.05
"""Finds with less are not told apart from nothing by anybody."""


def judged(found: Sequence[Finds]) -> tuple[F64, NDArray[np.bool_]]:
    """Scores of all finds in photographs, and whether each overlaps a box that people drew by half."""
    scores = np.concatenate([np.empty(0), *(sure for _, sure, _ in found)])
    right = [match_boxes(boxes, sure, wanted, 0.5) for boxes, sure, wanted in found]
    return scores, np.concatenate([np.empty(0, np.bool_), *right])


def calibrate(
    detector: CompactDetector,
    frames: FrameFolder,
    fruit: FruitModel,
    count: int,
    photographs: Sequence[Photograph] = (),
) -> ScoreMap:
    """Fit a detector's score map on rendered frames and on photographs; both count the same, however many.

    Args:
        detector: with a map that changes nothing.
        frames: not learnt from.
        fruit: in the frames.
        count: how many frames are searched.
        photographs: with boxes.
    """
    result = evaluate(detector, frames, fruit, count)
    sets = [(
        np.array([*(match.score for match in result.matches), *result.wrong]),
        np.array([True] * len(result.matches) + [False] * len(result.wrong), np.bool_),
    )]  # fmt: skip
    if photographs:
        sets.append(judged(find_boxes(detector, photographs, fruit_scale(photographs))))
    sets = [(scores[scores >= LEAST], right[scores >= LEAST]) for scores, right in sets]
    sets = [(scores, right) for scores, right in sets if len(scores)]
    if not sets:
        return ScoreMap()
    weights = [np.full(len(scores), 100.0 / len(scores)) for scores, _ in sets]
    scores, rights = np.concatenate([s for s, _ in sets]), np.concatenate([r for _, r in sets])
    return fit_scores(scores, rights, np.concatenate(weights))
