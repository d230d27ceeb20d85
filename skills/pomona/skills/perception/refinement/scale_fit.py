"""Scale of a fruit from depth: the closed form of the paper's eq. (f_obj).

Moving the model along the ray through its centre by sigma and scaling it with the distance (the paper's eqs.
sigma-translation and sigma scaling) is together a scaling about the camera's origin. The model's pixels stay the same
and D'(sigma) = mu(sigma) * D'(0): one virtual depth image serves every sigma, and eq. (f_obj) is a quadratic in mu.

`fit_scale` finds the optimum from one render. `fit_scale_by_rendering` is the method as the paper prints it, the
reference: move and scale the model, render it, compare, search.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from pomona.executive.values.arrays import Float64
from pomona.skills.perception.refinement.depth_image import DepthImage, ImageBox, Triangles
from pomona.skills.perception.refinement.errors import BadDepth, DepthNotInMetres, NoDepth, TooFewInliers
from pomona.skills.perception.refinement.render import DepthLook

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


_TRIALS = 200
_SEED = 5


def sigma_bound(p_hat: Float64) -> float:
    """The search ends at +- 0.8 p_hat_z [m]."""
    return 0.8 * float(p_hat[2])


def moved_and_scaled(T_camera_object: Float64, sigma: float) -> Float64:
    """Camera from mesh coordinates (4, 4) at sigma [m]: p' = p - sigma p/|p| and s' = mu s."""
    p_hat = T_camera_object[:3, 3]
    mu = 1.0 - sigma / float(np.linalg.norm(p_hat))
    T = T_camera_object.copy()
    T[:3, :3] *= mu
    T[:3, 3] = mu * p_hat
    return T


def fit_scale_by_rendering(
    look: DepthLook,
    mesh: Triangles,
    T_camera_object: Float64,
    box: ImageBox,
    *,
    inlier_band: float = 4e-3,
    tolerance: float = 1e-5,
) -> ScaleFit:
    """Fit sigma by eq. (f_obj) within +- 0.8 p_hat_z, rendering anew for every sigma that the search tries.

    RANSAC with a straight line between virtual and measured depth finds outliers first; then a bounded search (Brent's)
    minimises the mean square over the rest.

    Args:
        box: part of the image that is rendered and compared; the whole image in the paper.
        inlier_band, tolerance: half-width of RANSAC's band, and tolerance of sigma at which the search stops [m].

    Raises:
        NoDepth: too few of the model's pixels hold a measurement.
        DepthNotInMetres: the measurements are about a thousand times the virtual depth.
        RenderFailed: the model cannot be rendered.
    """
    depth = look.depth[box.slices]
    virtual_depth, _ = look.render(mesh, T_camera_object, box)
    covered = virtual_depth > 0.0
    valid = covered & np.isfinite(depth) & (depth > 0.0)
    model_pixels, valid_pixels = int(np.count_nonzero(covered)), int(np.count_nonzero(valid))
    if valid_pixels < max(MIN_PIXELS, MIN_VALID * model_pixels):
        raise NoDepth(valid_pixels, model_pixels)
    if np.median(depth[valid] / virtual_depth[valid]) > TOO_DEEP:
        raise DepthNotInMetres(float(np.median(depth[valid])), float(np.median(virtual_depth[valid])))
    inliers = np.zeros(depth.shape, dtype=np.bool_)
    inliers[valid] = line_inliers(virtual_depth[valid], depth[valid], inlier_band)

    def objective(sigma: float) -> float:
        rendered, _ = look.render(mesh, moved_and_scaled(T_camera_object, sigma), box)
        compared = inliers & (rendered > 0.0)  # a pixel at the rim may be lost to rounding
        difference = depth[compared].astype(np.float64) - rendered[compared]
        return float(np.mean(difference**2))

    p_hat = T_camera_object[:3, 3]
    bound = sigma_bound(p_hat)
    search = minimize_scalar(objective, bounds=(-bound, bound), method="bounded", options={"xatol": tolerance})
    sigma, mean_square = float(search.x), float(search.fun)
    mu = 1.0 - sigma / float(np.linalg.norm(p_hat))
    energy = float(np.sum(virtual_depth[inliers].astype(np.float64) ** 2))
    return ScaleFit(mu, mean_square / energy, inliers, model_pixels, valid_pixels, float(np.sqrt(mean_square)))


def line_inliers(virtual: DepthImage, measured: DepthImage, band: float) -> NDArray[np.bool_]:
    """RANSAC: which measurements (n,) lie within the band [m] of the line through two of them that has the most such.

    Two of the same virtual depth, as on a face that is seen head-on, give the line through the origin.
    """
    x, y = virtual.astype(np.float64), measured.astype(np.float64)
    rng = np.random.default_rng(_SEED)
    best = np.zeros(len(x), dtype=np.bool_)
    for i, j in rng.integers(0, len(x), (_TRIALS, 2)):
        slope = (y[j] - y[i]) / (x[j] - x[i]) if x[i] != x[j] else y[i] / x[i]
        agree = np.abs(y - y[i] - slope * (x - x[i])) <= band
        if np.count_nonzero(agree) > np.count_nonzero(best):
            best = agree
    return best
