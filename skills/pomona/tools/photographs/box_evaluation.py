"""Figures of boxes against labelled boxes: precision and recall over all scores, and COCO's mean precisions."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float64
from pomona.skills.perception.detection.places import iou


def match_boxes(
    found: Float64, scores: Float64, labelled: Float64, least: float
) -> NDArray[np.bool_]:
    """Return which found boxes have a label, (n,); arguments as of `labels_of`."""
    return labels_of(found, scores, labelled, least) >= 0


def labels_of(
    found: Float64, scores: Float64, labelled: Float64, least: float
) -> NDArray[np.int64]:
    """Return the label of each found box, (n,), -1 for none: surest first, each takes the free one of most overlap.

    Args:
        found: x, y, w, h (n, 4).
        scores: (n,).
        labelled: x, y, w, h (m, 4).
        least: intersection over union that counts.
    """
    label = np.full(len(found), -1, np.int64)
    if not len(found) or not len(labelled):
        return label
    overlaps = iou(found, labelled)
    for k in np.argsort(-scores, kind="stable"):
        best = int(np.argmax(overlaps[k]))
        if overlaps[k, best] >= least:
            label[k] = best
            overlaps[:, best] = -1.0
    return label


@dataclass(frozen=True, slots=True, eq=False)
class BoxCurve:
    """Precision over recall."""

    scores: Float64  # of all finds, falling, (n,)
    precision: Float64  # precision, recall: with the first k + 1 of them, (n,)
    recall: Float64
    labelled: int  # boxes that were to be found

    @property
    def average_precision(self) -> float:
        """Area under the curve, precision taken as the best at this recall or a higher one."""
        best = np.maximum.accumulate(self.precision[::-1])[::-1]
        return float((np.diff(self.recall, prepend=0.0) * best).sum())

    def recall_at(self, precision: float) -> float:
        """Return the largest recall with at least this precision; 0 where there is none."""
        return float(self.recall[self.precision >= precision].max(initial=0.0))

    def score_for(self, precision: float) -> float | None:
        """Return the score from which on `recall_at` is reached."""
        good = np.nonzero(self.precision >= precision)[0]
        return float(self.scores[good[-1]]) if len(good) else None

    def at_score(self, score: float) -> tuple[float, float]:
        """Return recall and precision of the finds with at least this score."""
        count = int((self.scores >= score).sum())
        return (
            (float(self.recall[count - 1]), float(self.precision[count - 1]))
            if count
            else (0.0, 1.0)
        )


def curve(pictures: Iterable[tuple[Float64, Float64, Float64]], least: float = 0.5) -> BoxCurve:
    """Precision over recall of the finds in many pictures.

    Args:
        pictures: found boxes (n, 4), their scores (n,) and labelled boxes (m, 4) of each.
        least: intersection over union that counts.
    """
    scores, right, labelled = [np.empty(0)], [np.empty(0, np.bool_)], 0
    for found, sure, wanted in pictures:
        scores.append(sure)
        right.append(match_boxes(found, sure, wanted, least))
        labelled += len(wanted)
    all_scores, all_right = np.concatenate(scores), np.concatenate(right)
    order = np.argsort(-all_scores, kind="stable")
    hits = np.cumsum(all_right[order])
    return BoxCurve(
        all_scores[order],
        hits / np.maximum(1, np.arange(1, len(hits) + 1)),
        hits / max(1, labelled),
        labelled,
    )


IOUS = np.linspace(
    0.5, 0.95, 10
)  # intersections over union over which COCO's mean average precision is the mean
PRECISION = 0.9  # recall is reported where precision is at least this
RECALLS = np.linspace(0.0, 1.0, 101)  # recalls at which COCO reads precision
ROUNDS = 300  # draws of an interval


@dataclass(frozen=True, slots=True, eq=False)
class JudgedPicture:
    """Detections of one picture against its labels."""

    scores: Float64  # of the detections, (n,)
    right: NDArray[np.bool_]  # whether each is right, by `IOUS`, (10, n)
    labelled: int  # number of labels
    group: str = ""  # pictures of one group show the same place


def judge(found: Float64, scores: Float64, labelled: Float64, group: str = "") -> JudgedPicture:
    """Match the boxes of one picture, x, y, w, h (n, 4), to labels (m, 4) at each of `IOUS`."""
    right = np.array([match_boxes(found, scores, labelled, float(least)) for least in IOUS])
    return JudgedPicture(scores, right, len(labelled), group)


@dataclass(frozen=True, slots=True)
class BoxFigures:
    """Figures of many pictures."""

    recall: float  # at precision `PRECISION` and IoU 0.5
    ap50: float  # ap50, ap75: average precision at IoU 0.5 and 0.75, over 101 recalls as COCO's
    ap75: float
    ap: float  # mean of it over `IOUS`, COCO's mAP50:95
    threshold: float  # score from which on `recall` is reached; NaN where it never is


def box_figures(pictures: Sequence[JudgedPicture]) -> BoxFigures:
    """Return figures of these pictures together."""
    scores = np.concatenate([np.empty(0), *(picture.scores for picture in pictures)])
    right = np.concatenate(
        [np.empty((len(IOUS), 0), np.bool_), *(picture.right for picture in pictures)], axis=1
    )
    order = np.argsort(-scores, kind="stable")
    labelled = max(1, sum(picture.labelled for picture in pictures))
    hits = np.cumsum(right[:, order], axis=1)
    precision, recall = hits / np.arange(1, len(order) + 1), hits / labelled
    best = np.maximum.accumulate(precision[:, ::-1], axis=1)[:, ::-1]
    areas = []
    for k in range(len(IOUS)):
        first = np.searchsorted(recall[k], RECALLS)
        areas.append(float(np.append(best[k], 0.0)[np.minimum(first, len(order))].mean()))
    good = np.nonzero(precision[0] >= PRECISION)[0]
    last = good[-1] if len(good) else None
    return BoxFigures(
        0.0 if last is None else float(recall[0, last]),
        areas[0],
        areas[5],
        float(np.mean(areas)),
        float("nan") if last is None else float(scores[order[last]]),
    )


def box_intervals(
    pictures: Sequence[JudgedPicture], seed: int = 0
) -> dict[str, tuple[float, float]]:
    """Return bounds of 95 % of each figure, from groups drawn again: pictures of one group are alike."""
    names = [field.name for field in fields(BoxFigures)]

    def values(drawn: Sequence[JudgedPicture]) -> list[float]:
        figures = box_figures(drawn)
        return [getattr(figures, name) for name in names]

    return dict(zip(names, intervals(pictures, values, seed), strict=True))


def intervals(
    pictures: Sequence[JudgedPicture],
    figures: Callable[[Sequence[JudgedPicture]], Sequence[float]],
    seed: int = 0,
) -> list[tuple[float, float]]:
    """Return bounds of 95 % of each of `figures`, from groups of pictures drawn again; NaN where none is finite."""
    groups: dict[str, list[JudgedPicture]] = {}
    for picture in pictures:
        groups.setdefault(picture.group, []).append(picture)
    places, rng = list(groups.values()), np.random.default_rng(seed)
    drawn = [
        figures(
            [
                picture
                for k in rng.integers(0, len(places), len(places))
                for picture in places[int(k)]
            ]
        )
        for _ in range(ROUNDS)
    ]
    bounds = []
    for values in np.array(drawn, np.float64).T:
        low, high = (
            np.nanquantile(values, (0.025, 0.975))
            if np.isfinite(values).any()
            else (np.nan, np.nan)
        )
        bounds.append((float(low), float(high)))
    return bounds


def recall_and_precision(pictures: Sequence[JudgedPicture], score: float) -> tuple[float, float]:
    """Return both at IoU 0.5 for detections with at least this score; NaN without labels, or without detections."""
    right = sum(int(picture.right[0, picture.scores >= score].sum()) for picture in pictures)
    labelled, found = (
        sum(picture.labelled for picture in pictures),
        sum((p.scores >= score).sum() for p in pictures),
    )
    return right / labelled if labelled else np.nan, right / int(found) if found else np.nan


def judge_size(
    found: Float64, scores: Float64, labelled: Float64, low: float, high: float, group: str = ""
) -> JudgedPicture:
    """Match the boxes of one picture to labels whose longer side lies in low … high [px], low included.

    As in COCO, detections of other labels count neither as right nor as wrong, nor do detections without a label whose
    own longer side lies outside.
    """
    label = labels_of(found, scores, labelled, float(IOUS[0]))
    wanted = _is_sized(labelled, low, high)
    counts = np.where(label >= 0, np.append(wanted, False)[label], _is_sized(found, low, high))
    return judge(found[counts], scores[counts], labelled[wanted], group)


def _is_sized(boxes: Float64, low: float, high: float) -> NDArray[np.bool_]:
    longer = boxes[:, 2:].max(axis=1, initial=0.0)
    return np.asarray((longer >= low) & (longer < high), np.bool_)
