"""Scale of a fruit from depth: the closed form of the paper's eq. (f_obj).

Moving the model along the ray through its centre by sigma and scaling it with the distance (the paper's eqs.
sigma-translation and sigma scaling) is together a scaling about the camera's origin. The model's pixels stay the same
and D'(sigma) = mu(sigma) * D'(0): one virtual depth image serves every sigma, and eq. (f_obj) is a quadratic in mu.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from pomona.skills.perception.refinement.errors import BadDepth, DepthNotInMetres, NoDepth, TooFewInliers

DepthImage = NDArray[np.float32]

MIN_PIXELS = 30  # fewer valid pixels than this are no measurement
MIN_VALID = 0.05  # a smaller share of the model's pixels than this is no measurement
TOO_DEEP = 100.0  # depth/model ratio above which the depth is in millimetres

_HYPOTHESES = 512
_REFITS = 20


@dataclass(frozen=True, slots=True, eq=False)
class ScaleFit:
    """mu in depth = mu * virtual_depth."""

    mu: float  # the scale factor
    variance: float  # of mu, from the scatter of the inliers, as if their errors were independent
    inliers: NDArray[np.bool_]  # pixels that support it, bool, of the images' shape
    model_pixels: int  # how many pixels the model covers
    valid_pixels: int  # how many of these hold a measurement
    residual: float  # root mean square of the inliers' depth - mu * virtual_depth [m]

    @property
    def inlier_ratio(self) -> float:
        """Share of the model's measured pixels that support the scale."""
        return float(np.count_nonzero(self.inliers)) / self.valid_pixels


def fit_scale(depth: DepthImage, virtual_depth: DepthImage, inlier_band: float = 4e-3) -> ScaleFit:
    """Fit mu in depth = mu * virtual_depth, robust to occluders and background; shapes (h, w) [m], 0: no depth.

    Of the measured ratios, that with the most others within `inlier_band` [m] is the start (RANSAC, but every
    hypothesis is tried). Then least squares on the inliers, mu = sum(d d_hat) / sum(d_hat^2), until they no longer
    change.

    Raises:
        NoDepth: fewer than `MIN_PIXELS` of the model's pixels, or less than `MIN_VALID` of them, hold a measurement.
        TooFewInliers: no two measurements agree.
        DepthNotInMetres: the measurements are about a thousand times the virtual depth.
        BadDepth: the shapes differ.
    """
    if depth.shape != virtual_depth.shape:
        raise BadDepth(f"the depth's shape {depth.shape} is not that of the virtual depth, {virtual_depth.shape}")
    model_pixels, pixels, d, d_hat = _measured(np.ascontiguousarray(depth), virtual_depth)
    if len(pixels) < max(MIN_PIXELS, MIN_VALID * model_pixels):
        raise NoDepth(len(pixels), model_pixels)

    mu = _largest_consensus(d / d_hat, inlier_band / float(d_hat.mean()))
    if mu > TOO_DEEP:
        raise DepthNotInMetres(float(np.median(d)), float(np.median(d_hat)))

    mu, inlier = _least_squares(d, d_hat, mu, inlier_band)
    if not inlier.any():
        raise TooFewInliers(0.0, 1.0 / len(pixels))
    chosen = d_hat[inlier]
    scatter = d[inlier] - mu * chosen
    mean_square = float(scatter @ scatter) / len(scatter)
    inliers = np.zeros(depth.shape, dtype=np.bool_)
    inliers.ravel()[pixels[inlier]] = True
    return ScaleFit(
        mu, mean_square / float(chosen @ chosen), inliers, model_pixels, len(pixels), float(np.sqrt(mean_square))
    )


@numba.njit(cache=True, nogil=True)
def _measured(
    depth: DepthImage, virtual_depth: DepthImage
) -> tuple[int, NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """How many pixels the model covers; of those that hold a measurement the flat indices, the depths d and d_hat."""
    pixels = np.empty(depth.size, dtype=np.int64)
    d, d_hat = np.empty(depth.size), np.empty(depth.size)
    covered = valid = 0
    for i in range(depth.size):
        if virtual_depth.flat[i] > 0.0:
            covered += 1
            if 0.0 < depth.flat[i] < np.inf:
                pixels[valid], d[valid], d_hat[valid] = i, depth.flat[i], virtual_depth.flat[i]
                valid += 1
    return covered, pixels[:valid], d[:valid], d_hat[:valid]


@numba.njit(cache=True, nogil=True, fastmath={"reassoc", "contract"})
def _least_squares(
    d: NDArray[np.float64], d_hat: NDArray[np.float64], mu: float, band: float
) -> tuple[float, NDArray[np.bool_]]:
    """mu = sum(d d_hat) / sum(d_hat^2) over the inliers of the mu before, until they no longer change; the inliers."""
    inlier = np.zeros(len(d), dtype=np.bool_)
    for _ in range(_REFITS):
        changes = 0
        product = square = 0.0
        for i in range(len(d)):
            agrees = abs(d[i] - mu * d_hat[i]) <= band
            changes += agrees != inlier[i]
            inlier[i] = agrees
            product += d[i] * d_hat[i] if agrees else 0.0
            square += d_hat[i] * d_hat[i] if agrees else 0.0
        if changes == 0 or square == 0.0:
            break
        mu = product / square
    return mu, inlier


def _largest_consensus(ratio: NDArray[np.float64], half_width: float) -> float:
    """Return the mean of the best supported interval of width 2 `half_width`, over evenly chosen ratios.

    Nearer objects may hide the fruit, but none farther can be seen through it: measurements beyond an interval count
    against it. Of equally good intervals the one nearest to the median wins.
    """
    ordered = np.sort(ratio[:: max(1, len(ratio) // _HYPOTHESES)])
    first = np.arange(len(ordered))
    beyond = np.searchsorted(ordered, ordered + 2.0 * half_width, side="right")
    # Weight of a measurement beyond the model against one on it: less than that of a fruit that is 60 % visible
    score = (beyond - first) - 0.25 * (len(ordered) - beyond)
    best = np.flatnonzero(score == score.max())
    start = int(best[np.argmin(np.abs(0.5 * (first + beyond)[best] - 0.5 * len(ordered)))])
    return float(ordered[start : beyond[start]].mean())
