"""A detector of boxes as an ONNX file of any origin.

Input: one picture, float32 or float16, (1, 3, h, w) or (3, h, w), and perhaps its size, (1, 2) int64.
`box_forms` lists the forms of the outputs that are read, `box_settings` the settings of a file.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from mmap import ACCESS_READ, mmap
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float32, Float64, UInt8
from pomona.executive.values.pictures import LFS_POINTER
from pomona.executive.values.trial import MEMORY, trial
from pomona.skills.perception.detection.close_look import check_picture
from pomona.skills.perception.detection.detection import WORKING_WIDTH
from pomona.skills.perception.detection.errors import BadWeights
from pomona.skills.perception.detection.onnx_runtime import BadGraph, judge_model, open_session
from pomona.skills.perception.detection.places import distinct
from pomona.tools.box_detectors.box_forms import (
    LEAST_SCORE,
    PAIRS,
    BadForm,
    BoxForm,
    form_of,
    read_boxes,
)
from pomona.tools.box_detectors.box_settings import read_settings

GREY = (114, 114, 114)  # colour beside the picture, as in the training of YOLO networks
MOST_BOXES = 300  # boxes that are read, surest first
DTYPES = {
    "tensor(float)": np.float32,
    "tensor(float16)": np.float16,
}  # types of the input that are served

IMAGENET = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
"""Mean and standard deviation of ImageNet's red, green and blue in 0..1, by which RF-DETR's input is normalised."""

MOST_WORDS = 200  # letters of ONNX Runtime's reason that are quoted

PROCESSOR_S = (
    20  # limit of a trial: a large network takes seconds for one picture in one thread [s]
)
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
    factors: Float64  # pixels of the input per pixel of the picture, across and down, (2,)
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
        self._path, self._fruit = path, fruit
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
        self._scale, self._shift = self._normalisation()
        self._stretched = self._settings.fit == "stretch"
        fitted = self._fit(np.zeros((480, 640, 3), np.uint8))
        outputs = self._run(fitted)
        try:
            self._form = form_of(outputs, self._settings)
        except BadForm as error:
            raise BadWeights(path, str(error)) from error
        if not self._settings.fit:  # networks with queries learnt from stretched pictures
            self._stretched = self._sizes is not None or self._form in (
                BoxForm.QUERIES,
                BoxForm.LOGITS,
            )
        self._read(outputs, fitted)

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
        corners, scores = self._read(self._run(fitted), fitted)
        height, width = colour.shape[:2]
        corners = (corners - np.tile(fitted.offset, 2)) / np.tile(fitted.factors, 2)
        corners = np.clip(corners, 0.0, [width, height, width, height])
        boxes = np.hstack([corners[:, :2], corners[:, 2:] - corners[:, :2]])
        usable = (boxes[:, 2:] >= 1.0).all(axis=1) & (scores >= LEAST_SCORE)
        boxes, scores = boxes[usable], scores[usable]
        order = np.argsort(-scores, kind="stable")[:MOST_BOXES]
        boxes, scores = boxes[order], scores[order]
        return [ScoredBox(boxes[k], float(scores[k])) for k in distinct(boxes)]

    def _read_input(self, working_width: int) -> None:
        inputs = self._session.get_inputs()
        expected = "one input (1, 3, h, w) or (3, h, w) of float32"
        sizes = [
            given for given in inputs if given.type == "tensor(int64)" and _ends(given.shape, 2)
        ]
        pictures = [given for given in inputs if given not in sizes]
        if len(pictures) != 1 or len(sizes) > 1:
            raise BadWeights(self._path, f"has {len(inputs)} inputs, expected {expected}")
        shape, kind = list(pictures[0].shape), pictures[0].type
        leading = shape[:-3] if len(shape) in (3, 4) else [0]
        several = any(isinstance(n, int) and n != 1 for n in leading)
        if kind not in DTYPES or several or not _is_size(shape[-3], 3) or shape[-1] == 3:
            raise BadWeights(
                self._path, f"has the input {_words(shape)} of {kind}, expected {expected}"
            )
        self._name, self._dtype, self._batched = pictures[0].name, DTYPES[kind], len(shape) == 4
        self._sizes = sizes[0].name if sizes else None
        own = self._settings.imgsz or (0, 0)
        height, width = (
            int(n) if isinstance(n, int) else side for n, side in zip(shape[-2:], own, strict=True)
        )
        self._fixed = (width, height) if width > 0 and height > 0 else None
        self._working_width = width or working_width

    def _normalisation(self) -> tuple[Float32, Float32]:
        """Return factor and summand from a colour, 0 to 255, to the input, (3,) each."""
        mean, std = IMAGENET if set(PAIRS[0]) <= set(self._outputs) else ((0.0,) * 3, (1.0,) * 3)
        middle, spread = np.array(self._settings.mean or mean), np.array(self._settings.std or std)
        factor = (255.0 if self._settings.range == "0..255" else 1.0) / spread
        return (factor / 255.0).astype(np.float32), (-middle * factor).astype(np.float32)

    def _fit(self, colour: UInt8) -> FittedPicture:
        """Return a picture in the form of the input: stretched, or in its middle with grey at the sides."""
        height, width = colour.shape[:2]
        factors = np.full(2, self._working_width / width)
        if self._fixed is not None:
            factors[1] = self._fixed[1] / height
            if not self._stretched:
                factors[:] = factors.min()
        across, down = (
            max(1, round(side * factor))
            for side, factor in zip((width, height), factors, strict=True)
        )
        flag = cv2.INTER_AREA if factors.max() < 1.0 else cv2.INTER_LINEAR
        picture = cv2.resize(np.ascontiguousarray(colour), (across, down), interpolation=flag)
        stride = self._settings.stride
        full = self._fixed or tuple(-(-side // stride) * stride for side in (across, down))
        right, below = full[0] - across, full[1] - down
        left, top = right // 2, below // 2
        border = top, below - top, left, right - left
        picture = cv2.copyMakeBorder(picture, *border, cv2.BORDER_CONSTANT, value=GREY)
        colours = (picture * self._scale + self._shift)[
            ..., :: -1 if self._settings.order == "bgr" else 1
        ]
        planes = np.ascontiguousarray(colours.transpose(2, 0, 1)).astype(self._dtype)
        return FittedPicture(planes, factors, np.array([left, top], float))

    def _run(self, fitted: FittedPicture) -> Mapping[str, NDArray[Any]]:
        """Return the outputs by name, fractions as float64."""
        planes = fitted.planes
        inputs: dict[str, NDArray[Any]] = {self._name: planes[None] if self._batched else planes}
        if self._sizes is not None:  # boxes then come in pixels of the input
            inputs[self._sizes] = np.array([planes.shape[:0:-1]], np.int64)
        try:
            outputs = self._session.run(None, inputs)
        except Exception as error:  # ONNX Runtime's errors have no common root
            shape = inputs[self._name].shape
            raise BadWeights(
                self._path, f"fails on a picture {shape}: {type(error).__name__}"
            ) from error
        arrays = (np.asarray(output) for output in outputs)
        plain = [
            array if array.dtype.kind in "iu" else array.astype(np.float64) for array in arrays
        ]
        return dict(zip(self._outputs, plain, strict=True))

    def _read(
        self, outputs: Mapping[str, NDArray[Any]], fitted: FittedPicture
    ) -> tuple[Float64, Float64]:
        """Return corners (n, 4) [px of the input] and scores (n,) of the fruit's class."""
        height, width = fitted.planes.shape[1:]
        try:
            return read_boxes(outputs, self._form, self._settings, self._fruit, width, height)
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


def _ends(shape: Any, side: int) -> bool:
    return bool(shape) and shape[-1] == side


def _is_size(given: object, wanted: int) -> bool:
    return not isinstance(given, int) or given == wanted


def _words(shape: Any) -> str:
    return f"({', '.join(str(side) for side in shape)})"
