"""Photographs with boxes around fruit: what a box teaches, and what it leaves open.

A box says where a fruit is and how large it appears, not how it lies. One that the picture's border cuts is completed
where its uncut side tells how; what is too small, too narrow or marked as a crowd is neither fruit nor background.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float64, UInt8
from pomona.skills.perception.detection.close_look import SIZE_OF_BOX
from pomona.skills.perception.detection.errors import BadPhotographs
from pomona.skills.perception.training.losses import FRUIT_IN_INPUT

BORDER = 2.0
"""A box that ends this close to the picture's border is cut by it [px]."""

SLIVER = 0.45
"""A box whose shorter side is less than this part of the longer one shows too little to learn from."""

WHOLE = 0.75
"""A box at least this square shows a fruit whose size it tells; apples' own outlines are 0.8 to 1."""

USUAL_ASPECT = 0.85
"""Shorter over longer side of the box of a whole apple: a quarter of the boxes that no border cuts have less."""

TINY = 14.0
"""A box whose longer side is shorter than this is ignored [px of the photograph]."""


@dataclass(frozen=True, slots=True, eq=False)
class Labels:
    """What the boxes of one picture teach, (n, …) each.

    Attributes:
        boxes: as drawn: x, y, w, h [px].
        centres: pixel of the whole fruit's middle, outside its box where the border cuts it, (n, 2).
        sizes: what `REFERENCE_LENGTH` of the fruit measures [px]; NaN where the box does not tell.
        counted: whether the box is taught as fruit; where not, nothing is said there.
    """

    boxes: Float64
    centres: Float64
    sizes: Float64
    counted: NDArray[np.bool_]


def labels_of(boxes: Float64, crowd: NDArray[np.bool_], width: int, height: int) -> Labels:
    """What boxes teach in a picture of this size.

    Args:
        boxes: x, y, w, h (n, 4) [px].
        crowd: boxes around more than one fruit, or marked as doubtful, (n,).
        width, height: of the picture [px].
    """
    low, extent = boxes[:, :2], boxes[:, 2:]
    limits = np.array([width, height], np.float64)
    longer, shorter = extent.max(axis=1), extent.min(axis=1)
    counted = ~crowd & (longer >= TINY) & (shorter >= SLIVER * longer)
    before, behind = low < BORDER, low + extent > limits - BORDER
    cut = before | behind
    centres = low + 0.5 * extent
    for across, along in ((0, 1), (1, 0)):
        # The side along the border is whole: a round fruit reaches as far across it.
        completed = cut[:, across] & ~cut[:, along] & (extent[:, across] < extent[:, along])
        far = low[:, across] + extent[:, across] - 0.5 * extent[:, along]
        near = low[:, across] + 0.5 * extent[:, along]
        centres[completed, across] = np.where(before[:, across], far, near)[completed]
    size_known = np.where(cut.any(axis=1), ~cut.all(axis=1), shorter >= WHOLE * longer)
    sizes = np.where(size_known, SIZE_OF_BOX * longer, np.nan)
    # A box ends at the outer sides of pixels, whose middles are at integers.
    return Labels(boxes, centres - 0.5, sizes, counted)


def most_visible(box: Float64) -> float:
    """The largest part of a round fruit's silhouette that a box can show, 0..1.

    Of a disc as wide as the box is long, a box that is narrower shows at most the part between a chord and the rim.
    A whole apple is itself a little narrower than long.
    """
    longer, shorter = float(box[2:].max()), float(box[2:].min())
    h = min(1.0, shorter / longer / USUAL_ASPECT)
    c = 1.0 - 2.0 * h
    return float((np.arccos(c) - c * np.sqrt(1.0 - c * c)) / np.pi)


@dataclass(frozen=True, eq=False)
class Photograph:
    """A picture of a file and the boxes that people drew.

    Attributes:
        path: of the picture.
        width, height: [px].
        boxes: x, y, w, h (n, 4) [px], inside the picture.
        crowd: boxes of more than one fruit or marked as doubtful, (n,).
        group: pictures of one group show the same place, so that a group is either learnt from or measured on.
        empty: it is known that no fruit is in it; elsewhere people may have left out some.
    """

    path: Path
    width: int
    height: int
    boxes: Float64
    crowd: NDArray[np.bool_]
    group: str = ""
    empty: bool = False

    @cached_property
    def labels(self) -> Labels:
        """What its boxes teach."""
        return labels_of(self.boxes, self.crowd, self.width, self.height)

    @property
    def name(self) -> str:
        """The picture's file name, by which places in it are kept."""
        return self.path.name

    @property
    def K(self) -> Float64:
        """Camera matrix (3, 3) [px], as `camera_of` supposes it."""
        return camera_of(self.width, self.height)

    def picture(self) -> UInt8:
        """RGB, (h, w, 3).

        Raises:
            BadPhotographs: it can no longer be read.
        """
        picture = cv2.imread(str(self.path), cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
        if picture is None:
            raise BadPhotographs(self.path, "cannot be read as a picture")
        return np.ascontiguousarray(picture[..., ::-1], np.uint8)


def camera_of(width: int, height: int) -> Float64:
    """Camera matrix (3, 3) [px] for a photograph that names none: long, so a look is nearly a piece of the picture."""
    focal = 4.0 * max(width, height)
    return np.array([[focal, 0.0, 0.5 * (width - 1)], [0.0, focal, 0.5 * (height - 1)], [0.0, 0.0, 1.0]])


@dataclass(frozen=True, slots=True)
class PhotoSet:
    """Labelled photographs: to learn from, and to measure on; and pictures without fruit to learn from."""

    train: tuple[Photograph, ...]
    val: tuple[Photograph, ...]
    empty: tuple[Photograph, ...] = ()


def fruit_scale(photographs: Sequence[Photograph]) -> float:
    """The factor by which these photographs are shrunk for the finder."""
    longer = [photo.boxes[:, 2:].max(axis=1) for photo in photographs if len(photo.boxes)]
    return FRUIT_IN_INPUT / float(np.median(np.concatenate(longer)))
