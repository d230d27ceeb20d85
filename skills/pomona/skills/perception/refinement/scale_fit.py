"""Scale of a fruit from depth: the closed form of the paper's eq. (f_obj).

Moving the model along the ray through its centre by sigma and scaling it with the distance (the paper's eqs.
sigma-translation and sigma scaling) is together a scaling about the camera's origin. The model's pixels stay the same
and D'(sigma) = mu(sigma) * D'(0): one virtual depth image serves every sigma, and eq. (f_obj) is a quadratic in mu.

`fit_scale` finds the optimum from one render. `fit_scale_by_rendering` is the method as the paper prints it, the
reference: move and scale the model, render it, compare, search. `scale_model` gives the model of that size, with
its uncertainty.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float64
from pomona.executive.values.later import Later
from pomona.executive.values.numba_kernel import kernel
from pomona.skills.perception.fruit.sizes import KindSizes
from pomona.skills.perception.refinement.cloud import Plane, gather
from pomona.skills.perception.refinement.errors import (
    AtBound,
    BadDepth,
    DepthNotInMetres,
    NoDepth,
    SizeOutOfRange,
    TooFewInliers,
)
from pomona.skills.perception.refinement.render import (
    DepthImage,
    DepthLook,
    ImageBox,
    Limits,
    RefineResult,
    Triangles,
    extents,
)
from pomona.skills.perception.refinement.shape_fit import FEW_POINTS, RIGID, Priors, fit_shape

optimize: Any = Later("scipy.optimize")

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
        raise BadDepth(
            f"the depth's shape {depth.shape} is not that of the virtual depth, {virtual_depth.shape}"
        )
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
        mu,
        mean_square / float(chosen @ chosen),
        inliers,
        model_pixels,
        len(pixels),
        float(np.sqrt(mean_square)),
    )


@kernel(nogil=True)
def _measured(
    depth: DepthImage, virtual_depth: DepthImage
) -> tuple[int, NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """How many pixels the model covers; of those that hold a measurement the flat indices, the depths d and d_hat."""
    pixels = np.empty(depth.size, dtype=np.int64)
    d = np.empty(depth.size)
    d_hat = np.empty(depth.size)
    covered = valid = 0
    for i in range(depth.size):
        if virtual_depth.flat[i] > 0.0:
            covered += 1
            if 0.0 < depth.flat[i] < np.inf:
                pixels[valid], d[valid], d_hat[valid] = i, depth.flat[i], virtual_depth.flat[i]
                valid += 1
    return covered, pixels[:valid], d[:valid], d_hat[:valid]


@kernel(nogil=True, fastmath={"reassoc", "contract"})
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
) -> ScaleFit:
    """Fit sigma by eq. (f_obj) within +- 0.8 p_hat_z, rendering anew for every sigma that the search tries.

    RANSAC with a straight line between virtual and measured depth finds outliers first; then a bounded search (Brent's)
    minimises the mean square over the rest.

    Args:
        box: part of the image that is rendered and compared; the whole image in the paper.
        inlier_band: half-width of RANSAC's band [m].

    Raises:
        NoDepth: too few of the model's pixels hold a measurement.
        DepthNotInMetres: the measurements are about a thousand times the virtual depth.
        RenderFailed: the model cannot be rendered.
    """
    depth = look.depth[box.slices]
    virtual_depth, _ = look.render(mesh, T_camera_object, box)
    covered = virtual_depth > 0.0
    valid = covered & np.isfinite(depth) & (depth > 0.0)
    model_pixels = int(np.count_nonzero(covered))
    valid_pixels = int(np.count_nonzero(valid))
    if valid_pixels < max(MIN_PIXELS, MIN_VALID * model_pixels):
        raise NoDepth(valid_pixels, model_pixels)
    if np.median(depth[valid] / virtual_depth[valid]) > TOO_DEEP:
        raise DepthNotInMetres(
            float(np.median(depth[valid])), float(np.median(virtual_depth[valid]))
        )
    inliers = np.zeros(depth.shape, dtype=np.bool_)
    inliers[valid] = line_inliers(virtual_depth[valid], depth[valid], inlier_band)

    def objective(sigma: float) -> float:
        rendered, _ = look.render(mesh, moved_and_scaled(T_camera_object, sigma), box)
        compared = inliers & (rendered > 0.0)  # a pixel at the rim may be lost to rounding
        difference = depth[compared].astype(np.float64) - rendered[compared]
        return float(np.mean(difference**2))

    p_hat = T_camera_object[:3, 3]
    bound = sigma_bound(p_hat)
    search = optimize.minimize_scalar(
        objective, bounds=(-bound, bound), method="bounded", options={"xatol": 1e-5}
    )
    sigma = float(search.x)
    mean_square = float(search.fun)
    mu = 1.0 - sigma / float(np.linalg.norm(p_hat))
    energy = float(np.sum(virtual_depth[inliers].astype(np.float64) ** 2))
    return ScaleFit(
        mu, mean_square / energy, inliers, model_pixels, valid_pixels, float(np.sqrt(mean_square))
    )


def line_inliers(virtual: DepthImage, measured: DepthImage, band: float) -> NDArray[np.bool_]:
    """RANSAC: which measurements (n,) lie within the band [m] of the line through two of them that has the most such.

    Two of the same virtual depth, as on a face that is seen head-on, give the line through the origin.
    """
    x = virtual.astype(np.float64)
    y = measured.astype(np.float64)
    rng = np.random.default_rng(_SEED)
    best = np.zeros(len(x), dtype=np.bool_)
    for i, j in rng.integers(0, len(x), (_TRIALS, 2)):
        slope = (y[j] - y[i]) / (x[j] - x[i]) if x[i] != x[j] else y[i] / x[i]
        agree = np.abs(y - y[i] - slope * (x - x[i])) <= band
        if np.count_nonzero(agree) > np.count_nonzero(best):
            best = agree
    return best


_MISPLACED = 0.02
_PROPORTIONS = np.array([0.06, 0.09, 0.06])
"""Standard deviations of a scaled model's place and dimensions, since fruit differ in proportions; of the size. Of 52
calipered apples height over width is 0.957 ± 0.061, and 0.875 of the model: which of the two a detector keeps right
depends on the picture (widths 10 % too large and heights 3 % off in two real frames)."""


@dataclass(frozen=True, slots=True, eq=False)
class FruitContext:
    """Knowledge of a fruit beyond its detection and one depth image.

    Attributes:
        support: the plane that the fruit stands on, in the camera frame; used by method shape.
        looks: other looks at the same fruit; used by shape and uniform.
        sizes: sizes of this kind of fruit; with them one scale gives width and height separately.
        size_deviation: standard deviation of the size that the detector saw in the picture, relative. One scale keeps
            it; a shape is fitted to points instead.
        priors: prior deviations of the shape.
    """

    support: Plane | None = None
    looks: Sequence[DepthLook] = ()
    sizes: KindSizes | None = None
    size_deviation: float = 0.0
    priors: Priors = field(default_factory=Priors)


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """One fruit to measure; `limits.inlier_band` already holds the sensor's noise."""

    look: DepthLook
    mesh: Triangles
    known: FruitContext
    limits: Limits

    @property
    def model_proportion(self) -> float:
        """Height over mean width of the model."""
        size = extents(self.mesh)
        return float(size[1] / size[[0, 2]].mean())


def scale_model(task: Task, T_start: Float64) -> RefineResult:
    """Move and scale the model along the ray through its centre, from a pose. Raises RefineError: it does not fit."""
    scaled, fit = _by_scale(task, T_start)
    return _with_sensor(scaled, fit, task.look)


def scale_model_of_kind(task: Task, T_start: Float64) -> RefineResult:
    """As `scale_model`; where the sizes of the kind are known, with the width and height that they give."""
    scaled, fit = _by_scale(task, T_start)
    sizes = task.known.sizes
    return (
        _with_sensor(scaled, fit, task.look)
        if sizes is None
        else _of_kind(task, scaled, fit, sizes)
    )


def scale_model_by_rendering(task: Task, T_start: Float64) -> RefineResult:
    """As `scale_model`, by the method as the paper prints it."""
    virtual_depth, box = task.look.render(task.mesh, T_start)
    fit = fit_scale_by_rendering(
        task.look, task.mesh, T_start, box, inlier_band=task.limits.inlier_band
    )
    return _with_sensor(_scaled(task, fit, T_start, virtual_depth, box, "paper"), fit, task.look)


def _by_scale(task: Task, T_start: Float64) -> tuple[RefineResult, ScaleFit]:
    virtual_depth, box = task.look.render(task.mesh, T_start)
    fit = fit_scale(task.look.depth[box.slices], virtual_depth, task.limits.inlier_band)
    return _scaled(task, fit, T_start, virtual_depth, box, "uniform"), fit


def _scaled(
    task: Task,
    fit: ScaleFit,
    T_camera_object: Float64,
    virtual_depth: DepthImage,
    box: ImageBox,
    method: str,
) -> RefineResult:
    """Return the model moved and scaled by a fit (eqs. position-update and scale-update).

    Raises:
        RefineError: the fit is beyond the limits.
    """
    limits = task.limits
    p_hat = T_camera_object[:3, 3]
    sigma = (1.0 - fit.mu) * float(np.linalg.norm(p_hat))
    bound = sigma_bound(p_hat)
    if fit.inlier_ratio < limits.min_inliers:
        raise TooFewInliers(fit.inlier_ratio, limits.min_inliers)
    if abs(sigma) >= 0.999 * bound:
        raise AtBound(sigma, bound)
    if not limits.size[0] <= fit.mu <= limits.size[1]:
        raise SizeOutOfRange(fit.mu, *limits.size)
    T_refined = T_camera_object.copy()
    T_refined[:3, 3] = fit.mu * p_hat
    dimensions = fit.mu * extents(task.mesh)
    # Depth measures the front: a larger fruit in the picture lies half of the difference farther away.
    deeper = 0.5 * dimensions.mean() * p_hat / np.linalg.norm(p_hat)
    seen_larger = task.known.size_deviation * np.concatenate([deeper, dimensions])
    unlike_model = np.concatenate(
        [np.full(3, _MISPLACED * dimensions.mean()), _PROPORTIONS * dimensions]
    )
    return RefineResult(
        T_camera_object=T_refined,
        dimensions=dimensions,
        mu=fit.mu,
        sigma=sigma,
        covariance=np.outer(seen_larger, seen_larger) + np.diag(unlike_model**2),
        inlier_ratio=fit.inlier_ratio,
        residual=fit.residual,
        box=box,
        inliers=fit.inliers,
        virtual_depth=np.float32(fit.mu) * virtual_depth,
        method=method,
    )


def _with_sensor(scaled: RefineResult, fit: ScaleFit, look: DepthLook) -> RefineResult:
    """Add the sensor's errors to the covariance: of neighbouring pixels, of all pixels, and of either outline."""
    intrinsics = look.intrinsics
    depth_model = look.depth_model
    change = np.concatenate([scaled.T_camera_object[:3, 3], scaled.dimensions])
    z = float(scaled.T_camera_object[2, 3])
    alike = depth_model.alike * fit.variance / fit.mu**2
    outline = np.diag(np.r_[np.zeros(3), np.full(3, depth_model.outline(z, intrinsics.fx) ** 2)])
    whole = (alike + depth_model.of_the_whole(z) ** 2) * np.outer(change, change)
    return replace(scaled, covariance=scaled.covariance + whole + outline)


def _of_kind(task: Task, scaled: RefineResult, fit: ScaleFit, sizes: KindSizes) -> RefineResult:
    """Estimate width and height from one scale and the sizes of the kind; the front of the fruit stays in place."""
    intrinsics = task.look.intrinsics
    depth_model = task.look.depth_model
    size_deviation = task.known.size_deviation
    p = scaled.T_camera_object[:3, 3]
    ray = p / np.linalg.norm(p)
    shown = float(scaled.dimensions[[0, 2]].mean())
    whole = depth_model.of_the_whole(float(p[2]))
    outline = depth_model.outline(float(p[2]), intrinsics.fx) / shown
    deviation = float(
        np.sqrt(
            size_deviation**2 + outline**2 + whole**2 + depth_model.alike * fit.variance / fit.mu**2
        )
    )
    sine = float(np.linalg.norm(np.cross(ray, scaled.T_camera_object[:3, 1])))
    size, covariance = sizes.given(shown, deviation, sine, task.model_proportion)
    dimensions = size[[0, 1, 0]]
    # relative difference between either width and their mean for a fruit that is taken for round
    spread = covariance[np.ix_([0, 1, 0], [0, 1, 0])] + np.diag(
        (0.02 * dimensions * [1.0, 0.0, 1.0]) ** 2
    )
    T_camera_object = scaled.T_camera_object.copy()
    T_camera_object[:3, 3] += 0.5 * (dimensions.mean() - scaled.dimensions.mean()) * ray
    deeper = np.outer(0.5 * ray, np.full(3, 1.0 / 3.0))
    both = np.vstack([deeper, np.eye(3)])
    place = whole**2 * np.outer(p, p) + (_MISPLACED * dimensions.mean()) ** 2 * np.eye(3)
    full = both @ spread @ both.T
    full[:3, :3] += place
    return replace(scaled, T_camera_object=T_camera_object, dimensions=dimensions, covariance=full)


_AT_PLACE = replace(RIGID, place=0.02, size=0.002)
"""Priors: only the place is free, within 20 mm of the expected one [m]; the size is known."""
BAND = 5e-3
"""Distance of a pixel's depth from the expected surface within which it is the fruit's [m]."""
LEAST_AGREEING = 0.3
FEWEST = 60
OTHER_SCALE = 0.06
"""Share of agreeing pixels, number of points, and difference in scale beyond which another object is seen."""


@dataclass(frozen=True, slots=True, eq=False)
class PlaceFit:
    """Place of the fruit's cuboid in the camera frame, shape (3,) [m], and the share of its pixels that agree."""

    p_camera: Float64
    agreeing: float


def fit_place(
    look: DepthLook, mesh: Triangles, T_camera_mesh: Float64, support: Plane | None
) -> PlaceFit:
    """Fit the place of a mesh to a depth image; 1 to 2 ms.

    Args:
        mesh: of the fruit's own size, the same object in every frame: its surface is computed once for each object.
        T_camera_mesh: expected pose, shape (4, 4); its turn is kept.
        support: plane that the fruit stands on, in the camera frame; its points are left out.

    Raises TooFewInliers, or another RefineError: the fruit is hidden or not there.
    """
    virtual_depth, box = look.render(mesh, T_camera_mesh)
    fit = fit_scale(look.depth[box.slices], virtual_depth, BAND)
    if fit.inlier_ratio < LEAST_AGREEING or abs(fit.mu - 1.0) > OTHER_SCALE:
        raise TooFewInliers(fit.inlier_ratio, LEAST_AGREEING)
    none = np.zeros((6, 6))
    size = extents(mesh)
    seen = RefineResult(
        T_camera_mesh,
        size,
        1.0,
        0.0,
        none,
        fit.inlier_ratio,
        fit.residual,
        box,
        fit.inliers,
        virtual_depth,
        "uniform",
    )
    points = gather(look, seen, support)
    if len(points.points) < FEWEST:
        raise TooFewInliers(
            len(points.points) / max(fit.model_pixels, 1), FEWEST / max(fit.model_pixels, FEWEST)
        )
    placed = fit_shape(
        points, mesh, T_camera_mesh, 1.0, band=4e-3, priors=_AT_PLACE, at_most=FEW_POINTS
    )
    return PlaceFit(placed.T_camera_object[:3, 3].copy(), fit.inlier_ratio)
