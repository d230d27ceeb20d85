"""Peaks of the finder's centroid map and the corners that its offsets point to."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from pomona.executive.values.arrays import Float32, Float64
from pomona.skills.perception.detection.close_look import SIZE_OF_BOX
from pomona.skills.perception.detection.errors import BadMaps
from pomona.skills.perception.detection.outputs import FINDER_STRIDE, OFFSET_UNIT

APART = 0.45
"""Two fruit are at least this part of the larger one's keypoint size apart."""
MOST_PEAKS = 60
"""Peaks kept, strongest first: adversarial maps must not cost unbounded time."""


@dataclass(frozen=True, slots=True, eq=False)
class Peak:
    """Where the finder sees a fruit.

    Attributes:
        keypoints: corners and centroid, (9, 2) [px].
        size: mean distance of the corners from the centroid [px].
        belief: of the centroid, 0..1.
        box: around what is seen, x, y, w, h (4,) [px], from a finder that knows boxes.
    """

    keypoints: Float64
    size: float
    belief: float
    box: Float64 | None = None

    @property
    def outline(self) -> Float64:
        """The box, or that of a whole fruit of its size where there is none: x, y, w, h (4,) [px]."""
        if self.box is not None:
            return self.box
        side = self.size / SIZE_OF_BOX
        return np.array([*(self.keypoints[8] + 0.5 - 0.5 * side), side, side])


def decode_offsets(belief: Float32, offsets: Float32, threshold: float, reaches: Float32 | None = None) -> list[Peak]:
    """Fruit in the finder's maps, strongest first.

    Args:
        belief: (9, h, w); only the centroid's map, the last, is read.
        offsets: (17, h, w), centroid to corners and log of their mean distance, in units of `OFFSET_UNIT` cells.
        threshold: least belief of a centroid.
        reaches: (4, h, w), how far what is seen reaches left, up, right and down [cells]; None: boxes are not known.

    Returns:
        Places, in pixels of the finder's input. Cells that are not finite count as zero.

    Raises:
        BadMaps: another number of maps, or sizes that differ.
    """
    if belief.ndim != 3 or offsets.ndim != 3 or belief.shape[0] != 9 or offsets.shape != (17, *belief.shape[1:]):
        raise BadMaps("belief (9, h, w) and offsets (17, h, w)", f"{belief.shape} and {offsets.shape}")
    centroid = np.nan_to_num(np.asarray(belief[8], np.float32), nan=0.0, posinf=0.0, neginf=0.0)
    highest = cv2.dilate(centroid, np.ones((5, 5), np.uint8))
    v, u = np.nonzero((centroid >= highest) & (centroid > threshold))
    order = np.argsort(-centroid[v, u], kind="stable")[:MOST_PEAKS]
    found: list[Peak] = []
    for y, x in zip(v[order].tolist(), u[order].tolist(), strict=True):
        here = np.nan_to_num(offsets[:, y, x].astype(np.float64))
        arms = here[:16].reshape(8, 2) * OFFSET_UNIT
        centre = np.array([x + _sub_cell(centroid, y, x, 0, 1), y + _sub_cell(centroid, y, x, 1, 0)])
        cells = np.vstack([arms + np.array([x, y]), centre])
        points = (cells + 0.5) * FINDER_STRIDE - 0.5
        size = float(np.exp(np.clip(here[16], -3.0, 3.0))) * OFFSET_UNIT * FINDER_STRIDE
        if all(np.linalg.norm(points[8] - p.keypoints[8]) > APART * max(size, p.size) for p in found):
            box = None if reaches is None else _box(reaches[:, y, x], y, x)
            found.append(Peak(points, size, float(centroid[y, x]), box))
    return found


def _box(reach: Float32, y: int, x: int) -> Float64:
    left, up, right, down = np.nan_to_num(reach.astype(np.float64), posinf=0.0).tolist()
    # A cell's middle is at integers; a box ends at the outer sides of pixels.
    return FINDER_STRIDE * np.array([x + 0.5 - left, y + 0.5 - up, left + right, up + down])


def _sub_cell(belief: Float32, y: int, x: int, dy: int, dx: int) -> float:
    """Offset of the peak along one direction, from a parabola through the logarithms of three cells (a Gaussian)."""
    h, w = belief.shape
    if not (dy <= y < h - dy and dx <= x < w - dx):
        return 0.0
    before, here, after = (float(np.log(max(float(belief[y + k * dy, x + k * dx]), 1e-4))) for k in (-1, 0, 1))
    bend = before - 2.0 * here + after
    return 0.0 if bend > -1e-6 else float(np.clip(0.5 * (before - after) / bend, -0.5, 0.5))
