"""Outputs of detectors of boxes in the three forms that are read; boxes in pixels of the input, scores in 0..1.

| outputs | of |
|---|---|
| one (1, 4 + classes, n): middle x, middle y, width, height, scores | Ultralytics' export of YOLO |
| one (1, n, 6): left, top, right, bottom, score, class | the same with `nms=True`, or end to end |
| `boxes` (n, 4): left, top, right, bottom; `scores` (n,); perhaps `labels` (n,) | torchvision; any other, wrapped |
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float64
from pomona.tools.box_detectors.box_settings import BoxSettings

Outputs = Mapping[str, NDArray[Any]]  # of one picture, by name, in order; fractions as float64

IN_SHARES = 2.0  # corners that all lie below this are shares of the input, not pixels
LEAST_SCORE = 0.05  # boxes with less score are dropped
SLACK = 1.0  # a box's right end may lie this far left of its left one, as rounding leaves it [px]
CHOSEN_VALUES = 6  # of a box whose class is chosen: corners, score and class

KNOWN = (
    "one output (1, 4 + classes, n) or (1, n, 6), as Ultralytics exports YOLO; or boxes (n, 4), scores (n,) and labels "
    "(n,), as torchvision does"
)


class BadForm(ValueError):
    """Outputs that are not read: the reason, as the rest of a sentence about the file."""


def read_boxes(outputs: Outputs, settings: BoxSettings, fruit: str) -> tuple[Float64, Float64]:
    """Return corners (n, 4), left, top, right, bottom [px of the input], and scores (n,) of the fruit's boxes.

    Raises BadForm: the outputs have another form, or disagree with the class names.
    """
    corners, scores = _of_fruit(outputs, settings, fruit)
    if ((scores < -1e-3) | (scores > 1.001)).any():  # values that are not finite are judged below
        extent = f"{scores.min():.3g} to {scores.max():.3g}"
        raise BadForm(f"gives scores from {extent}, expected 0 to 1: export it with its sigmoid")
    likely = ~(scores < LEAST_SCORE)
    corners = corners[likely]
    scores = scores[likely]
    lost = ~(np.isfinite(scores) & np.isfinite(corners).all(axis=1))
    if lost.any():
        raise BadForm(f"gives values that are not finite, in {lost.sum()} of its boxes")
    if (corners[:, 2:] < corners[:, :2] - SLACK).any():
        raise BadForm(
            "gives a box whose right end lies left of its left one, or its bottom above its top"
        )
    if 0.0 < np.abs(corners).max(initial=0.0) <= IN_SHARES:
        raise BadForm("gives boxes in shares of the input, expected pixels")
    return corners, np.minimum(scores, 1.0)


def _of_fruit(outputs: Outputs, settings: BoxSettings, fruit: str) -> tuple[Float64, Float64]:
    """Return corners and scores of all boxes of the fruit's class."""
    if {"boxes", "scores"} <= outputs.keys():
        boxes = outputs["boxes"]
        scores = outputs["scores"]
        labels = outputs.get("labels", np.zeros(0))
        count = len(scores)
        if boxes.shape != (count, 4) or scores.ndim != 1 or labels.shape not in ((count,), (0,)):
            raise _unknown(outputs)
        chosen = labels == _class(settings, fruit) if labels.size else slice(None)
        return boxes[chosen], scores[chosen]
    values = next(iter(outputs.values()))
    if len(outputs) != 1 or values.ndim != 3 or len(values) != 1:
        raise _unknown(outputs)
    classes = max(1, len(settings.names))
    if values.shape[1] == 4 + classes:
        if settings.names and settings.names.keys() != set(range(classes)):
            raise BadForm(f"names {classes} classes, expected the numbers 0 to {classes - 1}")
        number = _class(settings, fruit) if settings.names else 0
        rows = values[0]
        with np.errstate(invalid="ignore"):  # sizes that are not finite are judged by the caller
            low = rows[:2] - 0.5 * rows[2:4]
            high = rows[:2] + 0.5 * rows[2:4]
        return np.vstack([low, high]).T, rows[4 + number]
    if values.shape[2] == CHOSEN_VALUES:
        own = values[0][values[0, :, 5] == _class(settings, fruit)]
        return own[:, :4], own[:, 4]
    raise _unknown(outputs, f", for {classes} classes")


def _class(settings: BoxSettings, fruit: str) -> int:
    try:
        return settings.class_of(fruit)
    except ValueError as error:
        raise BadForm(str(error)) from None


def _unknown(outputs: Outputs, more: str = "") -> BadForm:
    """Return the error for outputs of no known form: those found, and those that are read."""
    given = ", ".join(
        f"{name} ({', '.join(map(str, value.shape))})" for name, value in outputs.items()
    )
    return BadForm(f"has the outputs {given}{more}, expected {KNOWN}")
