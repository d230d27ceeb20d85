"""Figures of the fruit found in photographs against the user's own labels."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pomona.executive import Float64
from pomona.skills.perception import shared_part
from pomona.tools.photographs.box_evaluation import (
    PRECISION,
    JudgedPicture,
    average_precision,
    intervals,
    judge,
    recall_and_precision,
    score_for_precision,
)
from pomona.tools.photographs.labels import LabelledPicture

IN_CROWD = 0.5  # a find of which this part lies in a label of several fruit counts neither as right nor as wrong


class LabelFigures:
    """Judges finds picture by picture.

    Args:
        labels: of the user's pictures; those with equal names are told apart by their folders.
        score: least score of a detection, for recall and precision.
    """

    def __init__(self, labels: Sequence[LabelledPicture], score: float) -> None:
        self._labels = labels
        self._score = score
        self._judged: list[JudgedPicture] = []

    def add(self, file: Path, width: int, height: int, boxes: Float64, scores: Float64) -> str:
        """Judge the finds of a picture of this size [px]; return why it cannot be judged, or an empty text.

        Args:
            boxes: x, y, w, h (n, 4) [px].
            scores: (n,), of all finds, also of those below the least score.
        """
        parts = file.absolute().parts
        same = [one for one in self._labels if parts[-len(one.name.parts) :] == one.name.parts]
        if len(same) != 1:
            return f"has {len(same)} entries in the labels, and is left out of the figures"
        (labels,) = same
        if (labels.width, labels.height) != (width, height):
            return (
                f"is {width} × {height}, but its labels are of {labels.width} × {labels.height} px"
            )
        labelled = np.array(labels.boxes).reshape(-1, 4)
        crowds = np.array(labels.crowds).reshape(-1, 4)
        right = judge(boxes, scores, labelled).right
        counts = right | (shared_part(boxes, crowds) < IN_CROWD).all(axis=1)
        self._judged.append(judge(boxes[counts], scores[counts], labelled))
        return ""

    def table(self) -> str:
        """Return the figures with 95 % intervals as Markdown."""
        judged = self._judged
        if not judged:
            return "no picture has labels: nothing was judged"

        def figures(drawn: Sequence[JudgedPicture]) -> list[float]:
            return [*recall_and_precision(drawn, self._score), average_precision(drawn)]

        labelled = sum(picture.labelled for picture in judged)
        at = f"at score ≥ {self._score:g}"
        names = (f"recall {at}", f"precision {at}", "AP50")
        alone = len(judged) == 1  # drawn again, one picture always gives the same figures
        bounds = [(np.nan, np.nan)] * len(names) if alone else intervals(judged, figures)
        rows = zip(names, figures(judged), bounds, strict=True)
        return "\n".join(
            [
                f"{len(judged)} pictures with labels, {labelled} boxes, IoU 0.5",
                "",
                "| figure | value | 95 % |",
                "|---|---|---|",
                *(
                    f"| {name} | {value:.3f} | {low:.3f}–{high:.3f} |"
                    for name, value, (low, high) in rows
                ),
                "",
                _advice(judged),
                "A fruit without a label counts as a wrong find.",
            ]
        )


def _advice(pictures: Sequence[JudgedPicture]) -> str:
    """Return the score to use on pictures like these, as a sentence."""
    score = np.ceil(100.0 * score_for_precision(pictures) - 1e-6) / 100.0
    recall, precision = recall_and_precision(pictures, score - 1e-9)
    if not precision >= PRECISION - 0.005:  # figures are printed to 0.01
        return f"No score gives precision {PRECISION:g} on these labels."
    return f"On these labels, --score {score:.2f} gives precision {precision:.2f} and recall {recall:.2f}."
