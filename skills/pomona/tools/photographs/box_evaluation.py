"""Figures of boxes against labelled boxes, at an intersection over union of one half."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pomona.executive import Float64
from pomona.skills.perception.detection.places import iou

SAME = 0.5  # intersection over union from which on a find is of a label
PRECISION = 0.9  # a score is proposed that gives this precision
RECALLS = np.linspace(0.0, 1.0, 101)  # recalls at which COCO reads precision
ROUNDS = 300  # draws of an interval


@dataclass(frozen=True, slots=True, eq=False)
class JudgedPicture:
    """Detections of one picture against its labels."""

    scores: Float64  # of the detections, (n,)
    right: NDArray[np.bool_]  # which of them have a label, (n,)
    labelled: int  # number of labels


def judge(found: Float64, scores: Float64, labelled: Float64) -> JudgedPicture:
    """Match boxes x, y, w, h (n, 4) to labels (m, 4): surest first, each takes the free one of most overlap."""
    right = np.zeros(len(found), np.bool_)
    overlaps = iou(found, labelled)
    for k in np.argsort(-scores, kind="stable") if overlaps.size else ():
        best = int(np.argmax(overlaps[k]))
        if overlaps[k, best] >= SAME:
            right[k] = True
            overlaps[:, best] = -1.0
    return JudgedPicture(scores, right, len(labelled))


def recall_and_precision(pictures: Sequence[JudgedPicture], score: float) -> tuple[float, float]:
    """Return both for detections with at least this score; NaN without labels, or without detections."""
    right = sum(int(picture.right[picture.scores >= score].sum()) for picture in pictures)
    labelled = sum(picture.labelled for picture in pictures)
    found = sum(int((picture.scores >= score).sum()) for picture in pictures)
    return right / labelled if labelled else np.nan, right / found if found else np.nan


def average_precision(pictures: Sequence[JudgedPicture]) -> float:
    """Return COCO's AP50: the mean of the best precision at 101 recalls or higher ones; NaN without labels."""
    _, precision, recall = _curve(pictures)
    if not sum(picture.labelled for picture in pictures):
        return np.nan
    best = np.append(np.maximum.accumulate(precision[::-1])[::-1], 0.0)
    return float(best[np.searchsorted(recall, RECALLS)].mean())


def score_for_precision(pictures: Sequence[JudgedPicture]) -> float:
    """Return the lowest score from which on precision is at least `PRECISION`; NaN where it never is."""
    scores, precision, _ = _curve(pictures)
    good = np.nonzero(precision >= PRECISION)[0]
    return float(scores[good[-1]]) if len(good) else np.nan


def _curve(pictures: Sequence[JudgedPicture]) -> tuple[Float64, Float64, Float64]:
    """Return falling scores, and precision and recall of the detections with at least each of them."""
    scores = np.concatenate([np.empty(0), *(picture.scores for picture in pictures)])
    right = np.concatenate([np.empty(0), *(picture.right for picture in pictures)])
    order = np.argsort(-scores, kind="stable")
    hits = np.cumsum(right[order])
    labelled = max(1, sum(picture.labelled for picture in pictures))
    return scores[order], hits / np.arange(1, len(hits) + 1), hits / labelled


def intervals(
    pictures: Sequence[JudgedPicture],
    figures: Callable[[Sequence[JudgedPicture]], Sequence[float]],
) -> list[tuple[float, float]]:
    """Return bounds of 95 % of each of `figures`, from pictures drawn again; NaN where none is finite."""
    rng = np.random.default_rng(0)
    count = len(pictures)
    draws = [
        figures([pictures[int(k)] for k in rng.integers(0, count, count)]) for _ in range(ROUNDS)
    ]
    bounds = []
    for values in np.array(draws, np.float64).T:
        finite = values[np.isfinite(values)]
        low, high = np.quantile(finite, (0.025, 0.975)) if len(finite) else (np.nan, np.nan)
        bounds.append((float(low), float(high)))
    return bounds
