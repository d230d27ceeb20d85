"""The paper's method as it is printed: move and scale the model, render it, compare, search. Kept as the reference.

`scale_fit.fit_scale` finds the same optimum from one render; this module is the reference for it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from pomona.executive.values.arrays import Float64
from pomona.skills.perception.refinement.depth_image import DepthImage, ImageBox, Triangles
from pomona.skills.perception.refinement.depth_look import DepthLook
from pomona.skills.perception.refinement.errors import DepthNotInMetres, NoDepth
from pomona.skills.perception.refinement.scale_fit import MIN_PIXELS, MIN_VALID, TOO_DEEP, ScaleFit

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
