"""Which pixels show one connected surface: a depth image cut at its steps."""

from __future__ import annotations

import numpy as np
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
    valid = np.isfinite(depth) & (depth > 0.0)
    z = np.where(valid, depth, np.inf)
    nearest = ndimage.minimum_filter(z, size=3, mode="nearest")
    # Of two pixels at a step the far one is dropped: the front object keeps its outline.
    with np.errstate(invalid="ignore"):
        smooth = valid & (z - nearest <= stride * _STEP * np.maximum(1.0, (nearest / _STEP_DEPTH) ** 2))
    labels, count = ndimage.label(smooth)
    inside = np.bincount(labels[covered], minlength=count + 1)
    supporting = np.bincount(labels[agreeing & covered], minlength=count + 1)
    kept = (supporting >= _LEAST_PIXELS / stride**2) & (supporting >= _LEAST_SHARE * inside)
    kept[0] = False
    chosen: NDArray[np.bool_] = kept[labels]
    return chosen


def without_edge(surface: NDArray[np.bool_], pixels: int) -> NDArray[np.bool_]:
    """Return a surface of shape (h, w) without its outermost pixels: these mix foreground and background."""
    inner: NDArray[np.bool_] = ndimage.binary_erosion(surface, iterations=pixels, border_value=1)
    return inner
