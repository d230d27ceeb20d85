"""Photographs with boxes around fruit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float64, UInt8
from pomona.executive.values.pictures import UnusablePicture, read_picture
from pomona.skills.perception.detection.errors import BadPhotographs

FRUIT_IN_INPUT = 45.6
"""Median longer side of the boxes in the finder's input [px]: as large as most rendered fruit, and in a probe on
orchard tiles the scale at which recall was highest."""


@dataclass(frozen=True, eq=False)
class Photograph:
    """A picture file with its labelled boxes."""

    path: Path  # of the picture
    width: int  # width, height: [px]
    height: int
    boxes: Float64  # x, y, w, h (n, 4) [px], inside the picture
    crowd: NDArray[np.bool_]  # boxes of more than one fruit or marked as doubtful, (n,)
    group: str = ""  # pictures of one group show the same place, so that a group is either learnt from or measured on

    @property
    def name(self) -> str:
        """The picture's file name."""
        return self.path.name

    @property
    def K(self) -> Float64:
        """Camera matrix (3, 3) [px], as `camera_of` supposes it."""
        return camera_of(self.width, self.height)

    def picture(self) -> UInt8:
        """RGB, (h, w, 3), upright. Raises BadPhotographs: it can no longer be read."""
        try:
            return read_picture(self.path)
        except UnusablePicture as error:
            raise BadPhotographs(self.path, str(error)) from error


def camera_of(width: int, height: int) -> Float64:
    """Camera matrix (3, 3) [px] for a photograph that names none: long, so a close look is nearly a crop."""
    focal = 4.0 * max(width, height)
    return np.array([[focal, 0.0, 0.5 * (width - 1)], [0.0, focal, 0.5 * (height - 1)], [0.0, 0.0, 1.0]])


@dataclass(frozen=True, slots=True)
class PhotoSet:
    """Labelled photographs: to learn from, and to measure on; and pictures without fruit to learn from."""

    train: tuple[Photograph, ...]
    val: tuple[Photograph, ...]
    empty: tuple[Photograph, ...] = ()


def fruit_scale(photographs: Sequence[Photograph]) -> float:
    """Return the factor by which these photographs are shrunk for the finder."""
    longer = [photo.boxes[:, 2:].max(axis=1) for photo in photographs if len(photo.boxes)]
    return FRUIT_IN_INPUT / float(np.median(np.concatenate(longer)))
