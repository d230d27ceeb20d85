"""Where the second look goes: square pictures around fruit that the finder saw."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from skills.detect.compact_network import CLOSE_LOOK_SIZE

F64 = NDArray[np.float64]

MARGIN = 1.15
"""Half side of the look over the mean distance of the corners from the centroid: the fruit fills two thirds."""

REFERENCE_LENGTH = 0.0633
"""Length whose picture is called a fruit's size [m]; about the mean projected distance of the CAD apple's corners."""


def keypoint_size(keypoints: F64) -> float:
    """Mean distance of the corners 0..7 from the centroid, in the unit of `keypoints` (9, 2)."""
    return float(np.linalg.norm(keypoints[:8] - keypoints[8], axis=1).mean())


def crop_matrix(centre: F64, size: float) -> F64:
    """Affine map (2, 3) from picture pixels to the look's pixels, for a fruit of keypoint size `size` at `centre`."""
    factor = CLOSE_LOOK_SIZE / (2.0 * MARGIN * max(size, 2.0))
    middle = 0.5 * (CLOSE_LOOK_SIZE - 1)
    return np.array([[factor, 0.0, middle - factor * centre[0]], [0.0, factor, middle - factor * centre[1]]])
