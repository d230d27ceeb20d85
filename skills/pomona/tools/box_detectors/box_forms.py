"""Outputs of detectors of boxes in the forms that exporters write: which form it is, and its boxes and scores.

| form | outputs | of |
|---|---|---|
| LISTS | boxes (n, 4): left, top, right, bottom; scores (n,); perhaps labels (n,) | torchvision; RT-DETR with sizes |
| ROWS | one (1, 4 + classes, n): middle x, middle y, width, height, scores | YOLOv8, YOLO11 without NMS |
| CHOSEN | one (1, n, 6): left, top, right, bottom, score, class | YOLOv8, YOLO11 with NMS; YOLO26, end to end |
| QUERIES | one (1, n, 4 + classes): middle x, middle y, width, height, scores; as shares | RT-DETR of Ultralytics |
| LOGITS | `dets` (1, n, 4), `labels` (1, n, classes + 1); or `pred_boxes`, `logits`; shares | RF-DETR; transformers |

With the task `segment` or `pose`, each box of ROWS and CHOSEN has further values, which are not read.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float64
from pomona.tools.box_detectors.box_settings import (
    DETECT,
    POSE,
    SEGMENT,
    BoxSettings,
    ClassUnknown,
    class_of,
)

Outputs = Mapping[str, NDArray[Any]]  # of one picture, by name, in order; fractions as float64

IN_SHARES = 2.0  # corners that all lie below this are shares of the input, not pixels
LEAST_SCORE = 0.05  # boxes with less score are dropped
EXTENTS = np.array(
    [[-1.0, 0.0], [0.0, -1.0], [1.0, 0.0], [0.0, 1.0]]
)  # width and height from corners
CHOSEN_VALUES = 6  # of a box whose class is chosen: corners, score and class
COCO_NUMBERS = (
    91  # columns of a network with COCO's own class numbers, 1 to 90: 80 of them have a name
)

PAIRS = (
    ("dets", "labels"),
    ("pred_boxes", "logits"),
)  # names of boxes and scores in LOGITS: RF-DETR's, transformers'

KNOWN = (
    "boxes (n, 4) and scores (n,), as of torchvision; one output (1, 4 + classes, n) or (1, n, 6), as of YOLO, without "
    "a row of objectness; (1, n, 4 + classes), as of RT-DETR; or dets (1, n, 4) and labels (1, n, classes), as of "
    "RF-DETR"
)


class BadForm(ValueError):
    """Outputs that are not read: the reason, as the rest of a sentence about the file."""


class BoxForm(Enum):
    """Form of the outputs: see the table above."""

    LISTS = "lists"
    ROWS = "rows"
    CHOSEN = "chosen"
    QUERIES = "queries"
    LOGITS = "logits"


def form_of(outputs: Outputs, settings: BoxSettings) -> BoxForm:
    """Return the form of a model's outputs for an empty picture. Raises BadForm: it is none of the known ones."""
    if any(_is_pair(outputs, pair) for pair in PAIRS):
        return BoxForm.LOGITS
    if lists_in(outputs):
        return BoxForm.LISTS
    extra = settings.task != DETECT
    first = next(iter(outputs.values()))
    if (len(outputs) > 1 and not extra) or first.ndim != 3 or len(first) != 1:
        raise unknown_form(outputs)
    rows, columns = first.shape[1:]
    if rows - 4 == len(settings.names):
        return BoxForm.ROWS
    has_class = columns > CHOSEN_VALUES if extra else columns == CHOSEN_VALUES
    if has_class and rows > columns and (first[0, :, 5] == np.round(first[0, :, 5])).all():
        return BoxForm.CHOSEN
    if 4 < rows <= columns + 4:
        return BoxForm.ROWS
    if columns > 4 and not extra:
        return BoxForm.QUERIES
    raise unknown_form(outputs)


def read_boxes(
    outputs: Outputs, form: BoxForm, settings: BoxSettings, fruit: str, width: int, height: int
) -> tuple[Float64, Float64]:
    """Return corners (n, 4), left, top, right, bottom [px of the input], and scores (n,) of the fruit's boxes.

    Args:
        fruit: name of the class.
        width, height: of the input [px].

    Raises BadForm: the outputs have another form, or disagree with the class names.
    """
    corners, scores = _READERS[form](outputs, settings, fruit)
    finite = np.isfinite(corners).all(axis=1)
    lost = ~(np.isfinite(scores) & (finite | (scores < LEAST_SCORE)))
    if lost.any():
        raise BadForm(f"gives values that are not finite, in {lost.sum()} of {len(lost)} boxes")
    corners, scores = corners[finite], scores[finite]
    if (
        form in (BoxForm.LISTS, BoxForm.CHOSEN)
        and (corners[scores >= LEAST_SCORE] @ EXTENTS < -1.0).any()
    ):
        raise BadForm(
            "gives a box whose right end lies left of its left one, or its bottom above its top"
        )
    if len(scores) and not (scores.min() >= -1e-3 and scores.max() <= 1.001):
        extent = f"{scores.min():.3g} to {scores.max():.3g}"
        raise BadForm(f"gives scores from {extent}, expected 0 to 1: export it with its sigmoid")
    if _are_shares(corners, form, settings):
        corners = corners * [width, height, width, height]
    return corners, np.clip(scores, 0.0, 1.0)


def unknown_form(outputs: Outputs) -> BadForm:
    """Return the error for outputs of no known form: those found, and those that are read."""
    given = ", ".join(
        f"{name} ({', '.join(map(str, value.shape))})" for name, value in outputs.items()
    )
    return BadForm(f"has the outputs {given}, expected {KNOWN}")


def lists_in(outputs: Outputs) -> tuple[Float64, Float64, NDArray[Any] | None] | None:
    """Return boxes (n, 4), scores (n,) and labels (n,) of LISTS; None for outputs of another form.

    An exporter that was given no names numbers the outputs: they are then told apart by shape and type.
    """
    if {"boxes", "scores"} <= outputs.keys():
        boxes, scores, labels = outputs["boxes"], outputs["scores"], outputs.get("labels")
    else:
        tables = [value for value in outputs.values() if value.ndim == 2 and value.shape[1] == 4]
        lists = [value for value in outputs.values() if value.ndim == 1]
        whole = [value for value in lists if value.dtype.kind in "iu"]
        if (len(tables), len(lists), len(whole)) != (1, 2, 1):
            return None
        boxes, labels = tables[0], whole[0]
        scores = next(value for value in lists if value is not labels)
    boxes = boxes[0] if boxes.ndim == 3 and len(boxes) == 1 else boxes
    if boxes.shape != (scores.size, 4) or (labels is not None and labels.size != scores.size):
        return None
    return boxes, scores.ravel(), None if labels is None else labels.ravel()


def _is_pair(outputs: Outputs, pair: tuple[str, str]) -> bool:
    boxes, logits = (outputs.get(name, np.empty(0)) for name in pair)
    return boxes.ndim == logits.ndim == 3 and boxes.shape == (1, logits.shape[1], 4)


def _lists(outputs: Outputs, settings: BoxSettings, fruit: str) -> tuple[Float64, Float64]:
    lists = lists_in(outputs)
    if lists is None:
        raise unknown_form(outputs)
    boxes, scores, labels = lists
    return (boxes, scores) if labels is None else _of_class(boxes, scores, labels, settings, fruit)


def _rows(outputs: Outputs, settings: BoxSettings, fruit: str) -> tuple[Float64, Float64]:
    rows = next(iter(outputs.values()))[0]
    classes = len(rows) - 4 - _further_values(outputs, settings)
    if settings.names and settings.names.keys() != set(range(classes)):
        raise _disagreement("rows", classes, settings)
    return _corners(rows[:4].T), rows[4 + _column(settings, fruit, classes)]


def _further_values(outputs: Outputs, settings: BoxSettings) -> int:
    """Return how many values of a place follow its scores: one for each channel of the masks, or those of points."""
    if settings.task == POSE:
        points, values = settings.kpt_shape
        return points * values
    masks = [value.shape[1] for value in outputs.values() if value.ndim == 4]
    return int(masks[0]) if masks and settings.task == SEGMENT else 0


def _chosen(outputs: Outputs, settings: BoxSettings, fruit: str) -> tuple[Float64, Float64]:
    values = next(iter(outputs.values()))[0]
    return _of_class(values[:, :4], values[:, 4], values[:, 5], settings, fruit)


def _queries(outputs: Outputs, settings: BoxSettings, fruit: str) -> tuple[Float64, Float64]:
    values = next(iter(outputs.values()))[0]
    classes = values.shape[1] - 4
    if settings.names and settings.names.keys() != set(range(classes)):
        raise _disagreement("columns", classes, settings)
    return _corners(values[:, :4]), values[:, 4 + _column(settings, fruit, classes)]


def _logits(outputs: Outputs, settings: BoxSettings, fruit: str) -> tuple[Float64, Float64]:
    boxes, logits = (
        outputs[name][0] for name in next(pair for pair in PAIRS if _is_pair(outputs, pair))
    )
    columns, named = logits.shape[1], max(settings.names, default=-1) + 1
    # RF-DETR has a last column for no object, and COCO's own numbers, which have gaps.
    right = (named, named + 1, COCO_NUMBERS) if "dets" in outputs else (named,)
    if settings.names and (columns not in right or named > columns):
        raise _disagreement("columns", columns, settings)
    own = np.clip(logits[:, _column(settings, fruit, columns)], -60.0, 60.0)
    return _corners(boxes), 1.0 / (1.0 + np.exp(-own))


_READERS: dict[BoxForm, Callable[[Outputs, BoxSettings, str], tuple[Float64, Float64]]] = {
    BoxForm.LISTS: _lists,
    BoxForm.ROWS: _rows,
    BoxForm.CHOSEN: _chosen,
    BoxForm.QUERIES: _queries,
    BoxForm.LOGITS: _logits,
}


def _corners(boxes: Float64) -> Float64:
    """Return corners (n, 4) of boxes given by middle, width and height (n, 4)."""
    middle, half = boxes[:, :2], 0.5 * boxes[:, 2:]
    with np.errstate(invalid="ignore"):  # of a size that is not finite, which `read_boxes` judges
        return np.hstack([middle - half, middle + half])


def _of_class(
    corners: Float64, scores: Float64, labels: NDArray[Any], settings: BoxSettings, fruit: str
) -> tuple[Float64, Float64]:
    """Return the boxes whose label is the fruit's class. Raises BadForm: a label has no name in a complete list."""
    number, names = _number(settings, fruit), settings.names
    if set(names) == set(range(len(names))):
        stray = (scores >= LEAST_SCORE) & ~np.isin(labels, list(names))
        if stray.any():
            raise BadForm(
                f"gives a box of class {labels[stray][0]:g}, and names the classes 0 to {len(names) - 1}"
            )
    return corners[labels == number], scores[labels == number]


def _column(settings: BoxSettings, fruit: str, classes: int) -> int:
    number = _number(settings, fruit) if settings.names or classes > 1 else 0
    if number >= classes:
        raise BadForm(f"names {fruit} as class {number}, and gives scores of {classes}")
    return number


def _number(settings: BoxSettings, fruit: str) -> int:
    if not settings.names:
        raise BadForm(
            f"has several classes without names: write names: {{0: apple}} into {settings.file} beside it"
        )
    try:
        return class_of(settings.names, fruit)
    except ClassUnknown as error:
        raise BadForm(str(error)) from None


def _disagreement(kind: str, given: int, settings: BoxSettings) -> BadForm:
    numbers = ", ".join(map(str, sorted(settings.names)[:8])) + (
        ", …" if len(settings.names) > 8 else ""
    )
    named = f"{len(settings.names)} named classes ({numbers})"
    return BadForm(f"gives {given} {kind} of scores for {named}: expected {KNOWN}")


def _are_shares(corners: Float64, form: BoxForm, settings: BoxSettings) -> bool:
    """Return True for boxes as shares of the input. Raises BadForm: the values are those of another unit."""
    largest = float(np.abs(corners).max(initial=0.0))
    if settings.units == "pixels":
        return False
    if settings.units == "share" or form in (BoxForm.QUERIES, BoxForm.LOGITS):
        if largest > IN_SHARES:
            raise BadForm(
                "gives boxes in pixels, expected shares of the input: write units: pixels into the settings' file"
            )
        return True
    if 0.0 < largest <= IN_SHARES:
        if (
            form is BoxForm.ROWS
        ):  # its places fill the input, so that the largest of them tells the unit
            return True
        raise BadForm(
            f"gives boxes in shares of the input, expected pixels: write units: share into {settings.file}"
        )
    return False
