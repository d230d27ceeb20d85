"""A detector of boxes as an ONNX file of any origin.

Input: one picture, float32 or float16, (1, 3, h, w) or (3, h, w), RGB in 0..1, in its middle with grey at the sides.
`box_forms` lists the forms of the outputs that are read, `box_settings` the settings of a file.
"""

from __future__ import annotations

from dataclasses import dataclass
from mmap import ACCESS_READ, mmap
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float64, UInt8
from pomona.executive.values.pictures import LFS_POINTER
from pomona.executive.values.trial import MEMORY, trial
from pomona.skills.perception.detection.close_look import check_picture
from pomona.skills.perception.detection.detection import WORKING_WIDTH
from pomona.skills.perception.detection.errors import BadWeights
from pomona.skills.perception.detection.onnx_runtime import BadGraph, judge_model, open_session
from pomona.skills.perception.detection.places import distinct
from pomona.tools.box_detectors.box_forms import BadForm, read_boxes
from pomona.tools.box_detectors.box_settings import read_settings

GREY = (114, 114, 114)  # colour beside the picture, as in the training of YOLO networks
MOST_BOXES = 300  # boxes that are read, surest first
DTYPES = {
    "tensor(float)": np.float32,
    "tensor(float16)": np.float16,
}  # types of the input that are served

MOST_WORDS = 200  # letters of ONNX Runtime's reason that are quoted

# limit of a trial: a large network takes seconds for one picture in one thread [s]
PROCESSOR_S = 20
MEMORY_RATIO = 4  # memory of a loaded model over its file's size: its parameters, and copies of them in other layouts


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
    problem = trial(
        f"{__name__}:{try_boxes.__name__}",
        str(path),
        fruit,
        str(working_width),
        memory=memory,
        processor_s=PROCESSOR_S,
    )
    if problem:
        raise BadWeights(path, problem)
    return BoxModel(path, fruit, working_width)


def try_boxes(path: str, fruit: str, working_width: str) -> None:
    """Load a model of boxes and search an empty picture; runs in a process of its own. Raises BadWeights."""
    BoxModel(Path(path), fruit, int(working_width))


@dataclass(frozen=True, slots=True, eq=False)
class FittedPicture:
    """A picture as a network's input."""

    planes: NDArray[np.floating[Any]]  # (3, h, w)
    factor: float  # pixels of the input per pixel of the picture
    offset: Float64  # place of the picture's upper left corner in the input, (2,) [px]


class BoxModel:
    """An ONNX file of boxes, loaded and tried on an empty picture.

    Args:
        fruit: name of the class to find.
        working_width: width of the picture in an input without a fixed size, also none in its settings [px].

    Raises:
        BadWeights: unreadable, or with inputs, outputs, classes or settings of another form.
    """

    def __init__(self, path: Path, fruit: str, working_width: int = WORKING_WIDTH) -> None:
        self._path = path
        self._fruit = fruit
        if not path.is_file():
            raise BadWeights(path, "no such file")
        try:
            _judge(path)
            self._session = open_session(str(path))
        except BadGraph as error:
            raise BadWeights(path, str(error)) from error
        except Exception as error:  # ONNX Runtime's errors have no common root
            raise BadWeights(path, f"cannot be read as ONNX: {_cause(error)}") from error
        self._settings = read_settings(path, self._session.get_modelmeta().custom_metadata_map)
        self._read_input(working_width)
        self._outputs = [output.name for output in self._session.get_outputs()]
        self._read(self._fit(np.zeros((480, 640, 3), np.uint8)))

    def find(self, colour: UInt8) -> list[ScoredBox]:
        """Return boxes around the fruit in a picture, by falling score.

        Args:
            colour: (h, w, 3) uint8 RGB.

        Raises:
            BadFrame: another shape or type.
            BadWeights: the outputs have another form than for the empty picture, or scores outside of 0..1.
        """
        check_picture(colour)
        fitted = self._fit(colour)
        corners, scores = self._read(fitted)
        height, width = colour.shape[:2]
        corners = (corners - np.tile(fitted.offset, 2)) / fitted.factor
        corners = np.clip(corners, 0.0, [width, height, width, height])
        boxes = np.hstack([corners[:, :2], corners[:, 2:] - corners[:, :2]])
        usable = (boxes[:, 2:] >= 1.0).all(axis=1)
        boxes = boxes[usable]
        scores = scores[usable]
        order = np.argsort(-scores, kind="stable")[:MOST_BOXES]
        boxes = boxes[order]
        scores = scores[order]
        return [ScoredBox(boxes[k], float(scores[k])) for k in distinct(boxes)]

    def _read_input(self, working_width: int) -> None:
        expected = "one input (1, 3, h, w) or (3, h, w) of float32"
        inputs = self._session.get_inputs()
        if len(inputs) != 1:
            raise BadWeights(self._path, f"has {len(inputs)} inputs, expected {expected}")
        (picture,) = inputs
        shape = list(picture.shape)
        leading = shape[:-3] if len(shape) in (3, 4) else [0]
        several = any(isinstance(n, int) and n != 1 for n in leading)
        if picture.type not in DTYPES or several or shape[-3] != 3:
            given = f"({', '.join(str(side) for side in shape)}) of {picture.type}"
            raise BadWeights(self._path, f"has the input {given}, expected {expected}")
        self._name = picture.name
        self._dtype = DTYPES[picture.type]
        self._batched = len(shape) == 4
        own = self._settings.imgsz or (0, 0)
        height, width = (
            int(n) if isinstance(n, int) else side for n, side in zip(shape[-2:], own, strict=True)
        )
        self._fixed = (width, height) if width > 0 and height > 0 else None
        self._working_width = width or working_width

    def _fit(self, colour: UInt8) -> FittedPicture:
        """Return a picture in the form of the input: in its middle with grey at the sides."""
        height, width = colour.shape[:2]
        factor = self._working_width / width
        if self._fixed is not None:
            factor = min(factor, self._fixed[1] / height)
        across, down = (max(1, round(side * factor)) for side in (width, height))
        flag = cv2.INTER_AREA if factor < 1.0 else cv2.INTER_LINEAR
        picture = cv2.resize(np.ascontiguousarray(colour), (across, down), interpolation=flag)
        stride = self._settings.stride
        full = self._fixed or tuple(-(-side // stride) * stride for side in (across, down))
        right = full[0] - across
        below = full[1] - down
        left = right // 2
        top = below // 2
        border = top, below - top, left, right - left
        picture = cv2.copyMakeBorder(picture, *border, cv2.BORDER_CONSTANT, value=GREY)
        planes = np.ascontiguousarray(picture.transpose(2, 0, 1)) * np.float32(1.0 / 255.0)
        return FittedPicture(planes.astype(self._dtype), factor, np.array([left, top], float))

    def _read(self, fitted: FittedPicture) -> tuple[Float64, Float64]:
        """Return corners (n, 4) [px of the input] and scores (n,) of the fruit's class."""
        planes = fitted.planes[None] if self._batched else fitted.planes
        try:
            outputs = self._session.run(None, {self._name: planes})
        except Exception as error:  # ONNX Runtime's errors have no common root
            words = f"fails on a picture {planes.shape}: {type(error).__name__}"
            raise BadWeights(self._path, words) from error
        arrays = (np.asarray(output) for output in outputs)
        plain = [
            array if array.dtype.kind in "iu" else array.astype(np.float64) for array in arrays
        ]
        try:
            named = dict(zip(self._outputs, plain, strict=True))
            return read_boxes(named, self._settings, self._fruit)
        except BadForm as error:
            raise BadWeights(self._path, str(error)) from error


def _cause(error: Exception) -> str:
    """Return the reason that ONNX Runtime gives, in one line, without the name of its function."""
    words = " ".join(str(error).split())
    return f"{type(error).__name__}: {words.rpartition(') ')[2][:MOST_WORDS]}"


def _judge(path: Path) -> None:
    """Raise BadGraph: it is empty, or only points to a model; or see `judge_model`."""
    with path.open("rb") as stream:
        if not (start := stream.read(len(LFS_POINTER))):
            raise BadGraph("cannot be read as ONNX: the file is empty")
        if start == LFS_POINTER:
            raise BadGraph("is a pointer of Git LFS, not the model: run `git lfs pull`")
        judge_model(memoryview(mmap(stream.fileno(), 0, access=ACCESS_READ)))
