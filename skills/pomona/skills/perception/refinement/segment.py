"""Which pixels show one connected surface: a depth image cut at its steps."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy import ndimage

from pomona.skills.perception.refinement.depth_image import DepthImage

_STEP = 6e-3  # step between neighbouring pixels that parts two things, at `_STEP_DEPTH` [m]; grows with depth²

_STEP_DEPTH = 0.6
_LEAST_SHARE = 0.3
_LEAST_PIXELS = 20


def connected_to(
    agreeing: NDArray[np.bool_], depth: DepthImage, covered: NDArray[np.bool_], stride: int = 1
) -> NDArray[np.bool_]:
    """Return the surfaces that mostly agree with a model where the model is, shapes (h, w).

    A leaf or a finger in front of a fruit is cut off by the step in depth around it, even where its depth agrees.

    Args:
        depth: z-depth [m]; 0 or not finite where there is none.
        stride: distance of these pixels in the image; steps in depth are higher by this factor.
    """
    z, supporting = np.ascontiguousarray(depth, dtype=np.float32), np.ascontiguousarray(agreeing & covered)
    connected: NDArray[np.bool_] = _flood(
        z, supporting, np.ascontiguousarray(covered), stride * _STEP, _LEAST_PIXELS / stride**2
    )
    return connected


@njit(cache=True, nogil=True)
def _flood(
    depth: DepthImage, supporting: NDArray[np.bool_], covered: NDArray[np.bool_], step: float, least: float
) -> NDArray[np.bool_]:
    """Spread from each supporting pixel over its surface; keep surfaces that are supported enough."""
    rows, columns = depth.shape
    smooth, chosen = np.zeros((rows, columns), np.bool_), np.zeros((rows, columns), np.bool_)
    for i in range(rows):
        for j in range(columns):
            z = depth[i, j]
            if not 0.0 < z < np.inf:
                continue
            nearest = z
            for k in range(max(i - 1, 0), min(i + 2, rows)):
                for m in range(max(j - 1, 0), min(j + 2, columns)):
                    if 0.0 < depth[k, m] < nearest:
                        nearest = depth[k, m]
            # Of two pixels at a step the far one is dropped: the front object keeps its outline.
            smooth[i, j] = z - nearest <= step * max(1.0, (nearest / _STEP_DEPTH) ** 2)
    reached = np.empty((rows * columns, 2), np.int32)
    for i in range(rows):
        for j in range(columns):
            if not (supporting[i, j] and smooth[i, j]):
                continue
            smooth[i, j] = False
            reached[0, 0], reached[0, 1] = i, j
            first, count, inside, support = 0, 1, 0, 0
            while first < count:
                row, column = reached[first, 0], reached[first, 1]
                first += 1
                inside += covered[row, column]
                support += supporting[row, column]
                for down, right in ((-1, 0), (1, 0), (0, -1), (0, 1)):
                    k, m = row + down, column + right
                    if 0 <= k < rows and 0 <= m < columns and smooth[k, m]:
                        smooth[k, m] = False
                        reached[count, 0], reached[count, 1] = k, m
                        count += 1
            if support >= least and support >= _LEAST_SHARE * inside:
                for n in range(count):
                    chosen[reached[n, 0], reached[n, 1]] = True
    return chosen


def without_edge(surface: NDArray[np.bool_], pixels: int) -> NDArray[np.bool_]:
    """Return a surface of shape (h, w) without its outermost pixels: these mix foreground and background."""
    inner: NDArray[np.bool_] = ndimage.binary_erosion(surface, iterations=pixels, border_value=1)
    return inner
