"""True size and position of a detected fruit from depth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pomona.drivers.interfaces import Intrinsics
from pomona.executive.values.arrays import Float64
from pomona.skills.perception.fruit.sizes import KindSizes
from pomona.skills.perception.refinement.cloud import Cloud, Plane, gather, gather_others, near_model, plane_below
from pomona.skills.perception.refinement.curvature import least_curvature
from pomona.skills.perception.refinement.depth_image import (
    DepthImage,
    ImageBox,
    Limits,
    Method,
    RefineResult,
    Triangles,
    check_pose,
    extents,
    farthest,
)
from pomona.skills.perception.refinement.errors import (
    AtBound,
    NotItsShape,
    RefineError,
    SizeOutOfRange,
    TooFewInliers,
)
from pomona.skills.perception.refinement.render import DepthLook
from pomona.skills.perception.refinement.scale_fit import ScaleFit, fit_scale, fit_scale_by_rendering, sigma_bound
from pomona.skills.perception.refinement.shape_fit import (
    FEW_POINTS,
    MAX_POINTS,
    RIGID,
    Judge,
    Priors,
    ShapeFit,
    fit_shape,
    other_starts,
)

_LEAST_POINTS = 150
_FEW_STARTS, _FINALISTS = 3, 2
"""More other axes of the stem than that are fitted with few points first, and the best ones with all points."""
_LEAST_AGREEMENT = 0.8  # least ratio of a stretched model's agreeing pixels to the scaled model's

_NOISE_IN_BAND = 2.0
"""Minimum width of the band in standard deviations of the depth error. Of 53 finds with depth in two real frames (1.0
to 1.9 m) a band of 4 mm measures 45, one of 8 mm 49, of 10 mm and of 16 mm 51, all as exactly: 10 mm results there from
the sensor's noise and a registration error of 5 px."""

_AROUND_CENTRE = 8  # half the edge of the square in which that deviation is looked up [px]

_THROUGH = 2.0
_MOST_THROUGH = 0.1  # ratio of a stretched model that may be seen through, by this number of bands

_UNMODELLED = np.array([0.01, 0.01, 0.01, 0.003, 0.012, 0.003])
_UNMODELLED_ON_SUPPORT = np.array([0.01, 0.01, 0.01, 0.003, 0.004, 0.003])
"""Standard deviations of position and dimensions from form errors of a stretched model (lobes, dents, one shoulder
higher than the other, the turn about the axis), relative to the mean dimension; over the visible ratio of the fruit.
"""

_UNSEEN_DOUBT = 0.6
"""If a fruit is half hidden, the mean sizes of the stretched and the scaled model differ by errors of the former: the
dimensions' uncertainty is this factor times the difference, times the hidden over the visible ratio.
"""

_FLAT, _CURVED, _SURELY = 0.2, 0.5, 2.0
_SMOOTH = 0.9
"""Relative curvature of flat and of curved surfaces, the number of standard deviations, and the ratio of the surface
that one curvature must explain: a leaf beside a fruit makes no smooth surface. The least of 290 whole and half hidden
apples was 0.77, with its uncertainty; 28 walls and posts had 0.2 at most; of 53 finds in real frames one is refused."""

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
class _Task:
    """One fruit to measure; `limits.inlier_band` already holds the sensor's noise."""

    look: DepthLook
    mesh: Triangles
    method: Method
    known: FruitContext
    limits: Limits

    @property
    def model_proportion(self) -> float:
        """Height over mean width of the model."""
        size = extents(self.mesh)
        return float(size[1] / size[[0, 2]].mean())


def refine(
    look: DepthLook,
    T_camera_object: Float64,
    mesh: Triangles,
    *,
    method: Method = "shape",
    known: FruitContext | None = None,
    limits: Limits | None = None,
) -> RefineResult:
    """Measure a fruit whose pose was estimated as if it had the size of its CAD model.

    Args:
        look: the depth image.
        T_camera_object: the detector's pose of the CAD-sized model (the paper's p_hat and Q_hat).
        mesh: the CAD model or a scan, its origin in the centre of its cuboid; a `FruitModel` is one. It may have holes
            where the camera does not look.
        method: shape - height, widths and tilt separately where the depth supports it, otherwise uniform;
            uniform - the closed form with one render; paper - the same optimum by repeated rendering.
        known: support, other looks, sizes of the kind.
        limits: of accepted measurements.

    Raises:
        RefineError: `BadDepth`, `BadMesh` or `BadPose` if an argument is no depth image of this camera, no mesh or no
            pose; `NoDepth`, `TooFewInliers`, `SizeOutOfRange`, `AtBound`, `NotItsShape` or `RenderFailed` if there is
            no measurement.
    """
    known, limits = known or FruitContext(), limits or Limits()
    for one in (look, *known.looks):
        one.check()
    check_pose(T_camera_object)
    extents(mesh)
    apart = look.depth_model.agreeing(
        _distance(look.depth, look.intrinsics, T_camera_object[:3, 3]), look.intrinsics.fx
    )
    limits = replace(limits, inlier_band=max(limits.inlier_band, _NOISE_IN_BAND * float(apart)))
    task = _Task(look, mesh, method, known, limits)
    if known.sizes is not None:
        proportion = float(np.log(known.sizes.height_over_width / task.model_proportion))
        priors = replace(known.priors, proportion=proportion, aspect=known.sizes.height_over_width_deviation)
        task = replace(task, known=replace(known, priors=priors))
    if method == "shape":
        result = _best_of_starts(task, T_camera_object)
    else:
        result = _scaled_from(task, T_camera_object)
        if method == "uniform" and known.looks:
            result = _fitted(task, result, *_gathered(task, result))
    _check_curvature(task, result)
    return result


def _best_of_starts(task: _Task, T_camera_object: Float64) -> RefineResult:
    """Fit from the detected pose and, if that does not fit well, from other axes of the stem.

    Raises:
        RefineError: no start leads to a measurement; the error is that of the detected pose.
    """
    judge = Judge(task.look.depth, task.limits.inlier_band, extents(task.mesh), task.known.priors.aspect)
    best: RefineResult | None = None
    plane: Plane | None = None  # the support, measured once
    problem: TooFewInliers | None = None
    score = 0.0
    try:
        scaled = _scaled_from(task, T_camera_object)
        cloud, plane = _gathered(task, scaled)
        best = _fitted(task, scaled, cloud, plane)
        score, _, settled = judge.score(best)
        if settled:
            return best
    except TooFewInliers as error:
        problem = error
    # Every start is tried: if half of the fruit is hidden, the first one that fits well may be wrong.
    trials: list[tuple[float, RefineResult, Cloud]] = []
    starts = other_starts(T_camera_object, task.known.support)
    few = len(starts) > _FEW_STARTS
    for T_start in starts:
        try:
            scaled = _scaled_from(task, T_start)
            cloud, plane = _gathered(task, scaled, plane)
        except RefineError:
            continue
        found = judge.score(_fitted(task, scaled, cloud, plane, FEW_POINTS))[0] if few else 0.0
        trials.append((found, scaled, cloud))
    for _, scaled, cloud in sorted(trials, key=lambda trial: -trial[0])[: _FINALISTS if few else _FEW_STARTS]:
        other = _fitted(task, scaled, cloud, plane)
        found, clearly, _ = judge.score(other)
        if other.method.startswith("shape") and found > score + clearly:
            best, score = other, found
    if best is None:
        assert problem is not None
        raise problem
    return best


def _scaled_from(task: _Task, T_start: Float64) -> RefineResult:
    """Move and scale the model along the ray through its centre, from a pose."""
    look, band = task.look, task.limits.inlier_band
    virtual_depth, box = look.render(task.mesh, T_start)
    if task.method == "paper":
        fit = fit_scale_by_rendering(look, task.mesh, T_start, box, inlier_band=band)
    else:
        fit = fit_scale(look.depth[box.slices], virtual_depth, band)
    scaled = _scaled(task, fit, T_start, virtual_depth, box)
    if task.known.sizes is not None and task.method == "uniform":
        return _of_kind(task, scaled, fit, task.known.sizes)
    return _with_sensor(scaled, fit, look)


def _check_curvature(task: _Task, result: RefineResult) -> None:
    """Refuse a measurement whose surface is flat.

    Raises:
        NotItsShape: the points that agree with the model form one smooth surface that is flat in some direction.
    """
    # Ratio of agreeing depth from which the shape is not checked: of 60 walls, posts and edges the most was 0.94
    if result.inlier_ratio > 0.95:
        return
    measured, band = task.look.depth[result.box.slices], task.limits.inlier_band
    found = least_curvature(measured, result.virtual_depth, result.inliers, band, task.look.depth_model.alike)
    if found is None or found.explained < _SMOOTH:
        return
    unsure = _SURELY * found.deviation
    if abs(found.least) <= _FLAT + unsure and found.least + unsure < _CURVED:
        raise NotItsShape(found.least, _CURVED)


def _distance(depth: DepthImage, intrinsics: Intrinsics, p_camera: Float64) -> Float64:
    """Return the measured depth of the fruit's visible part, shape () [m]: a small fruit is nearer than its model."""
    if p_camera[2] <= 0.0:  # behind the camera: the rendering reports it
        return np.zeros(())
    column, row = intrinsics.K[:2] @ p_camera / p_camera[2]
    top, left = (max(round(float(at)) - _AROUND_CENTRE, 0) for at in (row, column))
    around = depth[top : top + 2 * _AROUND_CENTRE, left : left + 2 * _AROUND_CENTRE]
    seen = around[np.isfinite(around) & (around > 0.0)]
    return np.array(np.median(seen) if len(seen) else p_camera[2], dtype=np.float64)


def _scaled(
    task: _Task, fit: ScaleFit, T_camera_object: Float64, virtual_depth: DepthImage, box: ImageBox
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
    unlike_model = np.concatenate([np.full(3, _MISPLACED * dimensions.mean()), _PROPORTIONS * dimensions])
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
        method="paper" if task.method == "paper" else "uniform",
    )


def _with_sensor(scaled: RefineResult, fit: ScaleFit, look: DepthLook) -> RefineResult:
    """Add the sensor's errors to the covariance: of neighbouring pixels, of all pixels, and of either outline."""
    intrinsics, depth_model = look.intrinsics, look.depth_model
    change = np.concatenate([scaled.T_camera_object[:3, 3], scaled.dimensions])
    z = float(scaled.T_camera_object[2, 3])
    alike = depth_model.alike * fit.variance / fit.mu**2
    outline = np.diag(np.r_[np.zeros(3), np.full(3, depth_model.outline(z, intrinsics.fx) ** 2)])
    whole = (alike + depth_model.of_the_whole(z) ** 2) * np.outer(change, change)
    return replace(scaled, covariance=scaled.covariance + whole + outline)


def _of_kind(task: _Task, scaled: RefineResult, fit: ScaleFit, sizes: KindSizes) -> RefineResult:
    """Estimate width and height from one scale and the sizes of the kind; the front of the fruit stays in place."""
    intrinsics, depth_model, size_deviation = task.look.intrinsics, task.look.depth_model, task.known.size_deviation
    p = scaled.T_camera_object[:3, 3]
    ray = p / np.linalg.norm(p)
    shown = float(scaled.dimensions[[0, 2]].mean())
    whole = depth_model.of_the_whole(float(p[2]))
    outline = depth_model.outline(float(p[2]), intrinsics.fx) / shown
    deviation = float(np.sqrt(size_deviation**2 + outline**2 + whole**2 + depth_model.alike * fit.variance / fit.mu**2))
    sine = float(np.linalg.norm(np.cross(ray, scaled.T_camera_object[:3, 1])))
    size, covariance = sizes.given(shown, deviation, sine, task.model_proportion)
    dimensions = size[[0, 1, 0]]
    # relative difference between either width and their mean for a fruit that is taken for round
    spread = covariance[np.ix_([0, 1, 0], [0, 1, 0])] + np.diag((0.02 * dimensions * [1.0, 0.0, 1.0]) ** 2)
    T_camera_object = scaled.T_camera_object.copy()
    T_camera_object[:3, 3] += 0.5 * (dimensions.mean() - scaled.dimensions.mean()) * ray
    deeper = np.outer(0.5 * ray, np.full(3, 1.0 / 3.0))
    both = np.vstack([deeper, np.eye(3)])
    place = whole**2 * np.outer(p, p) + (_MISPLACED * dimensions.mean()) ** 2 * np.eye(3)
    full = both @ spread @ both.T
    full[:3, :3] += place
    return replace(scaled, T_camera_object=T_camera_object, dimensions=dimensions, covariance=full)


def _gathered(task: _Task, scaled: RefineResult, plane: Plane | None = None) -> tuple[Cloud, Plane | None]:
    """Return the points of all looks about a scaled fruit, and the support as the camera sees it, unless it is known.

    Raises TooFewInliers: the points that agree with the model lie on the support.
    """
    look, mesh, known = task.look, task.mesh, task.known
    if known.support is not None and plane is None:
        plane = plane_below(look, scaled, known.support)
    points = gather(look, scaled, plane)
    T_scaled = scaled.T_camera_object.copy()
    T_scaled[:3, :3] *= scaled.mu
    others = gather_others(known.looks, mesh, T_scaled, plane, task.limits.inlier_band)
    return near_model([points, *others], T_scaled[:3, 3], scaled.mu * farthest(mesh)), plane


def _fitted(
    task: _Task, scaled: RefineResult, cloud: Cloud, plane: Plane | None, at_most: int = MAX_POINTS
) -> RefineResult:
    """Stretch the model onto points; return the scaled one where the points do not support that."""
    look, mesh, known, limits = task.look, task.mesh, task.known, task.limits
    if len(cloud.points) < _LEAST_POINTS:
        return scaled
    fit = fit_shape(
        cloud,
        mesh,
        scaled.T_camera_object,
        scaled.mu,
        support=plane,
        band=limits.inlier_band,
        priors=RIGID if task.method == "uniform" else known.priors,
        at_most=at_most,
    )
    T_fitted = fit.T_camera_object.copy()
    T_fitted[:3, :3] *= fit.stretch
    virtual_depth, box = look.render(mesh, T_fitted)
    measured = look.depth[box.slices]
    valid = (virtual_depth > 0.0) & np.isfinite(measured) & (measured > 0.0)
    difference = np.where(valid, measured - virtual_depth, np.inf)
    inliers = np.abs(difference) <= limits.inlier_band
    agreeing = np.count_nonzero(inliers)
    through = np.count_nonzero(difference[valid] > _THROUGH * limits.inlier_band)
    if (
        agreeing < _LEAST_AGREEMENT * np.count_nonzero(scaled.inliers)
        or through > _MOST_THROUGH * np.count_nonzero(valid)
        or not (limits.size[0] <= fit.stretch.min() and fit.stretch.max() <= limits.size[1])
    ):
        return scaled
    dimensions = fit.stretch * extents(mesh)
    seen = agreeing / np.count_nonzero(virtual_depth > 0.0) * _share_inside(mesh, T_fitted, box, look.intrinsics)
    doubt = _UNSEEN_DOUBT * (1.0 - seen) / seen * float(dimensions.mean() - scaled.dimensions.mean())
    whole = look.depth_model.of_the_whole(float(fit.T_camera_object[2, 3]))
    return replace(
        scaled,
        T_camera_object=fit.T_camera_object,
        dimensions=dimensions,
        covariance=_covariance(fit, dimensions, whole, seen, doubt),
        inlier_ratio=agreeing / np.count_nonzero(valid),
        residual=float(np.sqrt(np.mean(difference[inliers] ** 2))),
        box=box,
        inliers=inliers,
        virtual_depth=virtual_depth,
        method=task.method + ("+plane" if fit.on_support else "") + ("+views" if cloud.looks > 1 else ""),
    )


def _share_inside(mesh: Triangles, T_camera_mesh: Float64, box: ImageBox, intrinsics: Intrinsics) -> float:
    """Return the ratio of a mesh's vertices inside the picture; those outside are hidden, too. `box` is the mesh's."""
    if box.left > 0 and box.top > 0 and box.right < intrinsics.width and box.bottom < intrinsics.height:
        return 1.0
    x, y, z = intrinsics.K @ (T_camera_mesh[:3, :3] @ mesh.vertices.T + T_camera_mesh[:3, 3:])
    inside = (x >= 0.0) & (x < intrinsics.width * z) & (y >= 0.0) & (y < intrinsics.height * z)
    return float(inside.mean())


def _covariance(fit: ShapeFit, dimensions: Float64, whole: float, seen: float, doubt: float) -> Float64:
    """Return the covariance of (position, dimensions): of the fit, of form errors, and of the common depth error.

    Args:
        fit, dimensions: the stretched model.
        whole: standard deviation of the common depth error, relative.
        seen: ratio of the fruit that is visible and agrees.
        doubt: standard deviation of the dimensions, as other ways to measure disagree [m].
    """
    change = np.concatenate([fit.T_camera_object[:3, 3], dimensions])
    to_size = np.diag(np.concatenate([np.ones(3), dimensions]))
    # factor on the fit's own variances: its weights measure best, but as variances they are too large
    covariance: Float64 = 0.75 * to_size @ fit.covariance @ to_size
    unmodelled = (_UNMODELLED_ON_SUPPORT if fit.on_support else _UNMODELLED) * dimensions.mean()
    unmodelled /= seen
    unmodelled[3:] = np.hypot(unmodelled[3:], doubt)
    return covariance + np.diag(unmodelled**2) + whole**2 * np.outer(change, change)
