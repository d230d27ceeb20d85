"""A detector of boxes as an ONNX file of any origin: one input, and outputs in one of two layouts.

Input: one picture, float32 (1, 3, h, w) or (3, h, w), RGB in 0..1. A file with a fixed size gets the picture shrunk
into it, with grey at the right and below.

- `torchvision`: outputs `boxes` (n, 4), left, top, right, bottom [px of the input], `scores` (n,), and perhaps `labels`
  (n,).
- `yolo`: one output (1, 4 + classes, n): middle x, middle y, width, height [px of the input], then a score per class.

With more than one class the file names its classes in the metadata entry `names`, as Ultralytics writes it.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from mmap import ACCESS_READ, mmap
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float64, UInt8
from pomona.executive.values.trial import MEMORY, trial
from pomona.skills.perception.detection.close_look import check_picture
from pomona.skills.perception.detection.detection import WORKING_WIDTH
from pomona.skills.perception.detection.errors import BadWeights
from pomona.skills.perception.detection.onnx_runtime import BadGraph, judge_model, open_session
from pomona.skills.perception.detection.places import distinct


class ClassUnknown(ValueError):
    """No class, or several, could be the fruit; the text lists the classes."""


def class_of(names: Mapping[int, str], fruit: str) -> int:
    """Return the number of the fruit's class: the one of its name, else the only one whose name has it as a word.

    "red_apples" has the word apple; "pineapple" has not. Raises ClassUnknown: there is none, or several.
    """
    wanted = _words_of(fruit)
    by_falling_likeness: tuple[Callable[[str], bool], ...] = (
        lambda name: name.strip() == fruit,
        lambda name: name.strip().casefold() == fruit.casefold(),
        lambda name: _words_of(name) == wanted,
        lambda name: _has(_words_of(name), wanted),
    )
    right: list[int] = []
    for like in by_falling_likeness:
        right = right or [number for number, name in names.items() if like(name)]
    if len(right) != 1:
        none = "none of them is" if not right else f"{len(right)} of them could be"
        listed = ", ".join(list(names.values())[:8]) + (", …" if len(names) > 8 else "")
        raise ClassUnknown(f"has the classes {listed}: {none} {fruit}")
    return right[0]


def _words_of(name: str) -> list[str]:
    """Return the words of a name in small letters and in the singular: "RedApples_2" is red, apple, 2."""
    parts = re.findall(r"[^\W\d_]+|\d+", re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name))
    return [_singular(part.casefold()) for part in parts]


def _singular(word: str) -> str:
    for plural, singular in (("ies", "y"), ("oes", "o"), ("ches", "ch"), ("s", "")):
        if word.endswith(plural) and len(word) > len(plural) + 2 and not word.endswith("ss"):
            return word.removesuffix(plural) + singular
    return word


def _has(words: list[str], wanted: list[str]) -> bool:
    """Return True if the wanted words stand in a name one after the other."""
    return any(words[at : at + len(wanted)] == wanted for at in range(len(words) - len(wanted) + 1)) and bool(wanted)


IN_PARTS = 2.0  # corners that all lie below this are in parts of the picture, not in pixels
MULTIPLE = 32  # sides of an input without a fixed size are multiples of this stride [px]
GREY = (114, 114, 114)  # colour beside the picture, as in the training of YOLO networks
LEAST_SCORE = 0.05  # boxes with less score are dropped
MOST_BOXES = 300  # boxes that are read, surest first
DTYPES = {"tensor(float)": np.float32, "tensor(float16)": np.float16}  # types of the input that are served

MEMORY_RATIO = 4  # memory of a loaded model over its file's size: its parameters, and copies of them in other layouts

CHOSEN = 6  # values of a box in an end-to-end export: corners, score and class

LAYOUTS = "boxes (n, 4) and scores (n,), or one output (1, 4 + classes, n)"


@dataclass(frozen=True, slots=True, eq=False)
class ScoredBox:
    """One box."""

    box: Float64  # x, y, w, h (4,) [px of the picture]
    score: float  # 0..1
    visibility: float = float("nan")  # NaN, since boxes have no estimate of it

    def outline(self, width: int, height: int) -> Float64:
        """Return the box, (4,) [px]: it lies in the picture."""
        return self.box


def load_boxes(path: Path, fruit: str, working_width: int = WORKING_WIDTH) -> BoxModel:
    """Return a model of boxes that has been tried in a process of its own; arguments are those of `BoxModel`.

    Raises BadWeights: the file is no such model, or its trial takes too much time or memory.
    """
    memory = MEMORY + MEMORY_RATIO * (path.stat().st_size if path.is_file() else 0)
    problem = trial(f"{__name__}:{try_boxes.__name__}", str(path), fruit, str(working_width), memory=memory)
    if problem:
        raise BadWeights(path, problem)
    return BoxModel(path, fruit, working_width)


def try_boxes(path: str, fruit: str, working_width: str) -> None:
    """Load a model of boxes and search an empty picture; runs in a process of its own. Raises BadWeights."""
    BoxModel(Path(path), fruit, int(working_width))


class BoxModel:
    """An ONNX file of boxes, loaded and tried on an empty picture.

    Args:
        fruit: name of the class to find.
        working_width: width of the picture in an input without a fixed size [px].

    Raises:
        BadWeights: unreadable, or with inputs, outputs or classes of another form.
    """

    def __init__(self, path: Path, fruit: str, working_width: int = WORKING_WIDTH) -> None:
        self._path, self._fruit = path, fruit
        if not path.is_file():
            raise BadWeights(path, "no such file")
        try:
            _judge(path)
            self._session = open_session(str(path))
        except BadGraph as error:
            raise BadWeights(path, str(error)) from error
        except Exception as error:  # ONNX Runtime's errors have no common root
            raise BadWeights(path, f"cannot be read as ONNX: {type(error).__name__}") from error
        self._read_input(working_width)
        self._outputs = [output.name for output in self._session.get_outputs()]
        self._names = self._class_names()
        self.find(np.zeros((480, 640, 3), np.uint8))

    def find(self, colour: UInt8) -> list[ScoredBox]:
        """Return boxes around the fruit in a picture, by falling score.

        Args:
            colour: (h, w, 3) uint8 RGB.

        Raises:
            BadFrame: another shape or type.
            BadWeights: the outputs have another form than `LAYOUTS`, or scores outside of 0..1.
        """
        check_picture(colour)
        picture, factor = self._input(colour)
        try:
            outputs = self._session.run(None, {self._name: picture})
        except Exception as error:  # ONNX Runtime's errors have no common root
            raise BadWeights(self._path, f"fails on a picture {picture.shape}: {type(error).__name__}") from error
        corners, scores = self._layout([np.asarray(output, np.float64) for output in outputs])
        height, width = colour.shape[:2]
        corners = np.clip(corners / factor, 0.0, [width, height, width, height])
        boxes = np.hstack([corners[:, :2], corners[:, 2:] - corners[:, :2]])
        usable = np.isfinite(boxes).all(axis=1) & (boxes[:, 2:] >= 1.0).all(axis=1) & (scores >= LEAST_SCORE)
        boxes, scores = boxes[usable], scores[usable]
        order = np.argsort(-scores, kind="stable")[:MOST_BOXES]
        boxes, scores = boxes[order], scores[order]
        return [ScoredBox(boxes[k], float(scores[k])) for k in distinct(boxes)]

    def _read_input(self, working_width: int) -> None:
        inputs = self._session.get_inputs()
        expected = "one input (1, 3, h, w) or (3, h, w) of float32, RGB in 0..1"
        if len(inputs) != 1:
            raise BadWeights(self._path, f"has {len(inputs)} inputs, expected {expected}")
        shape, kind = list(inputs[0].shape), inputs[0].type
        leading = shape[:-3] if len(shape) in (3, 4) else [0]
        if kind not in DTYPES or any(isinstance(n, int) and n != 1 for n in leading) or not _is_size(shape[-3], 3):
            raise BadWeights(self._path, f"has the input {_words(shape)} of {kind}, expected {expected}")
        self._name, self._dtype, self._batched = inputs[0].name, DTYPES[kind], len(shape) == 4
        height, width = (int(n) if isinstance(n, int) else 0 for n in shape[-2:])
        self._fixed = (width, height) if width > 0 and height > 0 else None
        self._working_width = width or working_width

    def _class_names(self) -> dict[int, str]:
        """Classes that the file names; empty without names."""
        text = self._session.get_modelmeta().custom_metadata_map.get("names")
        if text is None:
            return {}
        try:
            value = ast.literal_eval(text)
            pairs = value.items() if isinstance(value, dict) else enumerate(value)
            return {int(number): str(name) for number, name in pairs}
        except (ValueError, SyntaxError, TypeError, RecursionError, MemoryError):
            expected = "expected a list or {0: 'apple'}"
            raise BadWeights(self._path, f"has metadata names {text[:40]!r}, {expected}") from None

    def _input(self, colour: UInt8) -> tuple[NDArray[np.floating[Any]], float]:
        """Return the picture as input, and pixels of the input per pixel of the picture."""
        height, width = colour.shape[:2]
        factor = self._working_width / width
        if self._fixed is not None:
            factor = min(factor, self._fixed[1] / height)
        small = max(1, round(width * factor)), max(1, round(height * factor))
        flag = cv2.INTER_AREA if factor < 1.0 else cv2.INTER_LINEAR
        shrunk = cv2.resize(np.ascontiguousarray(colour), small, interpolation=flag)
        full = self._fixed or tuple(-(-side // MULTIPLE) * MULTIPLE for side in small)
        right, below = full[0] - small[0], full[1] - small[1]
        padded = cv2.copyMakeBorder(shrunk, 0, below, 0, right, cv2.BORDER_CONSTANT, value=GREY)
        planes = np.ascontiguousarray(padded.transpose(2, 0, 1)).astype(self._dtype) / self._dtype(255.0)
        return (planes[None] if self._batched else planes), factor

    def _layout(self, outputs: list[Float64]) -> tuple[Float64, Float64]:
        """Return corners (n, 4) [px of the input] and scores (n,) of the fruit's class."""
        by_name = dict(zip(self._outputs, outputs, strict=True))
        if {"boxes", "scores"} <= by_name.keys():
            corners, scores = by_name["boxes"], by_name["scores"].ravel()
            corners = corners[0] if corners.ndim == 3 and len(corners) == 1 else corners
            if corners.shape != (len(scores), 4):
                raise self._unknown_layout(outputs)
            if "labels" in by_name:
                mine = by_name["labels"].ravel() == self._class()
                corners, scores = corners[mine], scores[mine]
        elif len(outputs) == 1 and outputs[0].ndim == 3 and len(outputs[0]) == 1 and outputs[0].shape[1] > 4:
            rows = outputs[0][0]
            classes = len(rows) - 4
            # More classes than places: the axes are those of another export.
            if classes > rows.shape[1]:
                raise self._unknown_layout(outputs)
            if self._names and classes != len(self._names):
                words = f"gives {classes} rows of scores for {len(self._names)} named classes"
                raise BadWeights(self._path, f"{words}: expected {LAYOUTS}, without a row of objectness")
            number = self._class() if self._names or classes > 1 else 0
            if number >= classes:
                raise BadWeights(self._path, f"names {self._fruit} as class {number}, and gives scores of {classes}")
            middle, half, scores = rows[:2], 0.5 * rows[2:4], rows[4 + number]
            corners = np.concatenate([middle - half, middle + half]).T
        else:
            raise self._unknown_layout(outputs)
        finite = np.isfinite(scores)
        if finite.any() and not (scores[finite].min() >= -1e-3 and scores[finite].max() <= 1.001):
            extent = f"{scores[finite].min():.3g} to {scores[finite].max():.3g}"
            raise BadWeights(self._path, f"gives scores from {extent}, expected 0 to 1: export it with its sigmoid")
        if 0.0 < np.abs(corners[np.isfinite(corners)]).max(initial=0.0) <= IN_PARTS:
            raise BadWeights(self._path, "gives boxes in parts of the picture, expected pixels of the input")
        return corners[finite], np.clip(scores[finite], 0.0, 1.0)

    def _class(self) -> int:
        if not self._names:
            raise BadWeights(self._path, "has several classes without names: add the metadata names {0: 'apple'}")
        try:
            return class_of(self._names, self._fruit)
        except ClassUnknown as error:
            raise BadWeights(self._path, str(error)) from None

    def _unknown_layout(self, outputs: list[Float64]) -> BadWeights:
        given = ", ".join(f"{name} {_words(o.shape)}" for name, o in zip(self._outputs, outputs, strict=True))
        chosen = any(o.ndim == 3 and o.shape[2] == CHOSEN and o.shape[1] > CHOSEN for o in outputs)
        remedy = ". If its boxes are already chosen, export it without nms and with end2end=False" if chosen else ""
        return BadWeights(self._path, f"has the outputs {given}, expected {LAYOUTS}{remedy}")


def _judge(path: Path) -> None:
    """Raise BadGraph: see `judge_model`; OSError, ValueError: the file is empty or cannot be read."""
    with path.open("rb") as stream:
        judge_model(memoryview(mmap(stream.fileno(), 0, access=ACCESS_READ)))


def _is_size(given: object, wanted: int) -> bool:
    return not isinstance(given, int) or given == wanted


def _words(shape: Any) -> str:
    return f"({', '.join(str(side) for side in shape)})"
