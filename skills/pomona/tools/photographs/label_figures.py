"""Figures of the fruit found in photographs against the user's own labels."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from pomona.executive import Float64
from pomona.skills.perception import shared_part
from pomona.tools.photographs.box_evaluation import (
    PRECISION,
    JudgedPicture,
    box_figures,
    intervals,
    judge,
    judge_size,
    recall_and_precision,
)
from pomona.tools.photographs.photographs import Photograph

SIZES = ((0.0, 32.0), (32.0, 96.0), (96.0, float("inf")))
"""Ranges of a label's longer side [px]: COCO's small, medium and large."""

IN_CROWD = 0.5  # a find of which this part lies in a label of several fruit counts neither as right nor as wrong


class LabelFigures:
    """Judges finds picture by picture.

    Args:
        labels: of the user's pictures; those with equal names are told apart by their folders.
        score: least score of a detection, for recall and precision.
    """

    def __init__(self, labels: Sequence[Photograph], score: float) -> None:
        self._by_path = {photo.path.resolve(): photo for photo in labels}
        named: dict[str, list[Photograph]] = {}
        for photo in labels:
            named.setdefault(photo.name, []).append(photo)
        self._by_name = {name: photos[0] for name, photos in named.items() if len(photos) == 1}
        self._score = score
        self._judged: list[JudgedPicture] = []
        self._by_size: list[list[JudgedPicture]] = [[] for _ in SIZES]

    def add(self, file: Path, width: int, height: int, boxes: Float64, scores: Float64) -> str:
        """Judge the finds of a picture of this size [px]; return why it cannot be judged, or an empty text.

        Args:
            boxes: x, y, w, h (n, 4) [px].
            scores: (n,), of all finds, also of those below the least score.
        """
        photo = self._by_path.get(file.resolve()) or self._by_name.get(file.name)
        if photo is None:
            return "has no labels, and is left out of the figures"
        if (photo.width, photo.height) != (width, height):
            return f"is {width} × {height}, but {photo.path} with the labels is {photo.width} × {photo.height}"
        labelled, group = photo.boxes[~photo.crowd], photo.group or str(photo.path)
        right = judge(boxes, scores, labelled).right[0]
        counts = right | (shared_part(boxes, photo.boxes[photo.crowd]) < IN_CROWD).all(axis=1)
        boxes, scores = boxes[counts], scores[counts]
        self._judged.append(judge(boxes, scores, labelled, group))
        for sized, (low, high) in zip(self._by_size, SIZES, strict=True):
            sized.append(judge_size(boxes, scores, labelled, low, high, group))
        return ""

    def table(self) -> str:
        """Return the figures with 95 % intervals as Markdown."""
        if not self._judged:
            return "no picture has labels: nothing was judged"
        labelled = sum(picture.labelled for picture in self._judged)
        lines = [f"{len(self._judged)} pictures with labels, {labelled} boxes, IoU 0.5", ""]
        lines += ["| figure | value | 95 % |", "|---|---|---|"]
        both = recall_and_precision(self._judged, self._score)
        bounds = _intervals(self._judged, lambda drawn: recall_and_precision(drawn, self._score))
        for name, value, bound in zip(("recall", "precision"), both, bounds, strict=True):
            lines.append(f"| {name} at score ≥ {self._score:g} | {_cells(value, bound)} |")
        lines.append(f"| AP50 | {_average_precision(self._judged)} |")
        for sized, (low, high) in zip(self._by_size, SIZES, strict=True):
            count = sum(picture.labelled for picture in sized)
            extent = f"{low:g} to {high:g} px" if np.isfinite(high) else f"from {low:g} px"
            lines.append(
                f"| AP50, longer side {extent} ({count} boxes) | {_average_precision(sized)} |"
            )
        notes = [_advice(self._judged), "A fruit without a label counts as a wrong find."]
        if not _is_drawn(self._judged):
            notes.append("All pictures are of one group: an interval needs several.")
        return "\n".join([*lines, "", *notes])


def _advice(pictures: Sequence[JudgedPicture]) -> str:
    """Return the score to use on pictures like these, as a sentence."""
    score = np.ceil(100.0 * box_figures(pictures).threshold - 1e-6) / 100.0
    recall, precision = recall_and_precision(pictures, score - 1e-9)
    if (
        not precision >= PRECISION - 0.005
    ):  # none, or several finds of one score; figures are printed to 0.01
        return f"No score gives precision {PRECISION:g} on these labels."
    return f"On these labels, --score {score:.2f} gives precision {precision:.2f} and recall {recall:.2f}."


def _is_drawn(pictures: Sequence[JudgedPicture]) -> bool:
    """Return True if there are several groups to draw from: one group always gives the same figures."""
    return len({picture.group for picture in pictures}) > 1


def _intervals(
    pictures: Sequence[JudgedPicture], figures: Callable[[Sequence[JudgedPicture]], Sequence[float]]
) -> list[tuple[float, float]]:
    if _is_drawn(pictures):
        return intervals(pictures, figures)
    return [(float("nan"), float("nan"))] * len(figures(pictures))


def _average_precision(pictures: Sequence[JudgedPicture]) -> str:
    if not any(picture.labelled for picture in pictures):
        return "no boxes | "
    (bound,) = _intervals(pictures, lambda drawn: [box_figures(drawn).ap50])
    return _cells(box_figures(pictures).ap50, bound)


def _cells(value: float, bound: tuple[float, float]) -> str:
    if not np.isfinite(value):
        return "none | "
    return (
        f"{value:.3f} | {bound[0]:.3f}–{bound[1]:.3f}"
        if np.isfinite(bound).all()
        else f"{value:.3f} | none"
    )
