"""What scores mean, fitted on finds of which it is known whether they are fruit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pomona.skills.perception.detection.compact_detector import CompactDetector
from pomona.skills.perception.detection.evaluation import evaluate
from pomona.skills.perception.detection.scores import ScoreMap, fit_scores
from pomona.skills.perception.fruit import FruitModel
from pomona.skills.perception.training.photo_figures import find_boxes, judged
from pomona.skills.perception.training.photographs import Photograph, fruit_scale
from pomona.skills.perception.training.samples import FrameFolder

LEAST = 0.05
"""Finds with less are not told apart from nothing by anybody."""


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
    sets = [result.judged()]
    if photographs:
        sets.append(judged(find_boxes(detector, photographs, fruit_scale(photographs))))
    sets = [(scores[scores >= LEAST], right[scores >= LEAST]) for scores, right in sets]
    sets = [(scores, right) for scores, right in sets if len(scores)]
    if not sets:
        return ScoreMap()
    weights = [np.full(len(scores), 100.0 / len(scores)) for scores, _ in sets]
    scores, rights = np.concatenate([s for s, _ in sets]), np.concatenate([r for _, r in sets])
    return fit_scores(scores, rights, np.concatenate(weights))
