"""One fruit as the compact detector finds it in a picture."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from pomona.executive.values.arrays import Float64, UInt8
from pomona.skills.perception.detection.close_look import SIZE_OF_BOX


@dataclass(frozen=True, slots=True, eq=False)
class FoundFruit:
    """One fruit in a picture."""

    p_camera: Float64  # centre of a CAD-sized fruit of the same appearance, in the camera frame, (3,) [m]
    stem: Float64  # stem axis in the camera frame, unit vector (3,)
    centre: Float64  # the centre in the picture [px]
    size: float  # length of `REFERENCE_LENGTH` of a CAD-sized fruit in the picture [px]
    # mean errors of centre [px], of the logarithm of size, and of the axis [rad] that the network expects, (3,)
    spreads: Float64
    score: float  # estimated ratio of fruit among such detections, 0..1, by the weights' score
    visibility: float  # part of its silhouette that is seen, 0..1, as the network estimates it
    # around its visible part, x, y, w, h (4,) [px], inside the picture; None with weights without boxes
    box: Float64 | None = None

    def outline(self, width: int, height: int) -> Float64:
        """The box, or that of a whole fruit of its size where there is none: x, y, w, h (4,) [px], in the picture."""
        if self.box is not None:
            return self.box
        side = self.size / SIZE_OF_BOX
        return inside(np.array([*(self.centre + 0.5 - 0.5 * side), side, side]), width, height)


class Finder(Protocol):
    """Finds fruit in pictures, such as `CompactDetector`."""

    def find(self, colour: UInt8, K: Float64) -> list[FoundFruit]:
        """Return all fruit in a picture (h, w, 3) uint8 RGB, with camera matrix K (3, 3) [px], by falling score.

        Raises BadFrame: another shape or type.
        """


def inside(box: Float64, width: int, height: int) -> Float64:
    """Return the part of a box x, y, w, h (4,) [px] that lies in the picture, written alike."""
    limits = np.array([width, height], np.float64)
    low, high = np.clip(box[:2], 0.0, limits), np.clip(box[:2] + box[2:], 0.0, limits)
    return np.concatenate([low, high - low])
