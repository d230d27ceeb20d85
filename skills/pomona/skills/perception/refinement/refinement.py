"""True size and position of a detected fruit from depth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pomona.drivers.depth_model import D4XX, DepthModel
from pomona.drivers.interfaces import Intrinsics
from pomona.executive.values.arrays import Float64
from pomona.skills.perception.fruit.sizes import KindSizes
from pomona.skills.perception.refinement.checks import check_depth, check_pose, extents
from pomona.skills.perception.refinement.curvature import least_curvature
from pomona.skills.perception.refinement.depth_image import DepthImage, ImageBox, RendererName, Triangles
from pomona.skills.perception.refinement.errors import AtBound, NotItsShape, SizeOutOfRange, TooFewInliers
from pomona.skills.perception.refinement.gather import OtherLook, gather, gather_others, near_model
from pomona.skills.perception.refinement.paper import fit_scale_by_rendering, sigma_bound
from pomona.skills.perception.refinement.render import render_depth
from pomona.skills.perception.refinement.result import Limits, Method, RefineResult
from pomona.skills.perception.refinement.scale_fit import ScaleFit, fit_scale
from pomona.skills.perception.refinement.shape_fit import RIGID, Priors, ShapeFit, fit_shape
from pomona.skills.perception.refinement.starts import Judge, best_of_starts, other_starts
from pomona.skills.perception.refinement.support_plane import Plane

_LEAST_POINTS = 150
_LEAST_AGREEMENT = 0.8
"""A stretched model must agree with at least this share of the pixels that the scaled one agreed with."""

_NOISE_IN_BAND = 2.0
"""The band holds at least so many standard deviations of what depth errs by. Of 53 finds with depth in two real frames
(1.0 to 1.9 m) a band of 4 mm measures 45, one of 8 mm 49, of 10 mm and of 16 mm 51, all as exactly: 10 mm is what this
makes there of the sensor's noise and of a registration that is 5 px off."""

_AROUND_CENTRE = 8
"""Half the edge of the square in which that deviation is looked up [px]."""

_THROUGH = 2.0
_MOST_THROUGH = 0.1
"""A stretched model is refused when the camera sees through more than this share of it, by so many bands."""

_UNMODELLED = np.array([0.01, 0.01, 0.01, 0.003, 0.012, 0.003])
_UNMODELLED_ON_SUPPORT = np.array([0.01, 0.01, 0.01, 0.003, 0.004, 0.003])
"""Standard deviations of what no stretched model explains (lobes, dents, one shoulder higher than the other, the turn
about the axis) in place and dimensions, of the mean dimension; over the share of the fruit that is seen."""

_FIT_VARIANCE = 0.75
"""Of what the fit says of itself: its weights are those that measure best, and as variances they are too large."""

_UNSEEN_DOUBT = 0.6
"""Where a fruit is half hidden the stretched and the scaled model's mean sizes differ by errors of the former: by so
much of this difference, times what is hidden over what is seen, the dimensions may be wrong."""

_NO_DOUBT = 0.95
"""With this share of the depth agreeing the shape is not doubted: of 60 walls, posts and edges the most was 0.94."""

_FLAT, _CURVED, _SURELY = 0.2, 0.5, 2.0
_SMOOTH = 0.9
"""What is flat, and what is curved, of the model's curvature, within so many standard deviations; and the share of the
surface that one curvature must explain: a leaf beside a fruit makes no smooth surface. The least of 290 whole and half
hidden apples was 0.77, with its uncertainty; 28 walls and posts had 0.2 at most; of 53 finds in real frames one is
refused."""

_OVAL = 0.02
"""Either width of a fruit that is taken for round differs from their mean by so much, of it."""

_MISPLACED = 0.02
_PROPORTIONS = np.array([0.06, 0.09, 0.06])
"""Standard deviations of a scaled model's place and dimensions, since fruit differ in proportions; of the size. Of 52
calipered apples height over width is 0.957 ± 0.061, and 0.875 of the model: which of the two a detector keeps right
depends on the picture (widths 10 % too large and heights 3 % off in two real frames)."""


def refine(
    depth: DepthImage,
    intrinsics: Intrinsics,
    T_camera_object: Float64,
    mesh: Triangles,
    *,
    method: Method = "shape",
    support: Plane | None = None,
    looks: Sequence[OtherLook] = (),
    limits: Limits | None = None,
    priors: Priors | None = None,
    depth_model: DepthModel = D4XX,
    size_deviation: float = 0.0,
    sizes: KindSizes | None = None,
    using: RendererName = "pyrender",
) -> RefineResult:
    """Measure a fruit whose pose was estimated as if it had the size of its CAD model.

    Args:
        depth: z-depth, shape (h, w) [m]; 0 or not finite where the sensor saw nothing.
        intrinsics: of the depth image.
        T_camera_object: the detector's pose of the CAD-sized model (the paper's p_hat and Q_hat).
        mesh: the CAD model or a scan, its origin in the centre of its cuboid; a `FruitModel` is one. Holes may be where
            the camera does not look.
        method: shape - height, widths and tilt by themselves, where the depth supports it, else uniform;
            uniform - the closed form with one render; paper - the same optimum by repeated rendering.
        support: the plane that the fruit stands on, in the camera frame, where one is known; used by shape.
        looks: other looks at the same fruit; used by shape and uniform.
        limits: what is accepted as a measurement.
        priors: what shape knows beforehand about fruit.
        depth_model: how the depth errs, as its camera says.
        size_deviation: standard deviation of the size that the detector saw in the picture, of that size: one scale
            keeps it, a shape is fitted to points instead.
        sizes: what is known of the sizes of this kind; with it one scale gives width and height apart.
        using: name of the renderer.

    Raises:
        RefineError: `BadDepth`, `BadMesh`, `BadPose` for what is no depth image of this camera, no mesh, no pose;
            `NoDepth`, `TooFewInliers`, `SizeOutOfRange`, `AtBound`, `NotItsShape`, `RenderFailed` where there is no
            measurement.
    """
    limits = limits or Limits()
    check_depth(depth, intrinsics)
    for look in looks:
        check_depth(look.depth, look.intrinsics)
        check_pose(look.T_camera_look)
    check_pose(T_camera_object)
    model_dimensions = extents(mesh)
    model_proportion = float(model_dimensions[1] / model_dimensions[[0, 2]].mean())
    if sizes is not None:
        proportion = float(np.log(sizes.height_over_width / model_proportion))
        priors = replace(priors or Priors(), proportion=proportion, aspect=sizes.height_over_width_deviation)
    apart = depth_model.agreeing(_distance(depth, intrinsics, T_camera_object[:3, 3]), intrinsics.fx)
    limits = replace(limits, inlier_band=max(limits.inlier_band, _NOISE_IN_BAND * float(apart)))

    def scaled_from(T_start: Float64) -> RefineResult:
        virtual_depth, box = render_depth(mesh, T_start, intrinsics, using=using)
        measured = depth[box.slices]
        if method == "paper":
            fit = fit_scale_by_rendering(
                measured, mesh, T_start, intrinsics, box, inlier_band=limits.inlier_band, using=using
            )
        else:
            fit = fit_scale(measured, virtual_depth, limits.inlier_band)
        scaled = _scaled(fit, T_start, model_dimensions, virtual_depth, box, limits, method, size_deviation)
        if sizes is not None and method == "uniform":
            return _of_kind(scaled, fit, sizes, model_proportion, size_deviation, intrinsics, depth_model)
        return _with_sensor(scaled, fit, intrinsics, depth_model)

    def fitted(scaled: RefineResult) -> RefineResult:
        return _fitted(depth, intrinsics, depth_model, mesh, scaled, method, support, looks, limits, priors, using)

    if method == "paper" or (method == "uniform" and not looks):
        result = scaled_from(T_camera_object)
    elif method == "uniform":
        result = fitted(scaled_from(T_camera_object))
    else:
        judge = Judge(depth, limits.inlier_band, model_dimensions, (priors or Priors()).aspect)
        result = best_of_starts(scaled_from, fitted, judge, T_camera_object, other_starts(T_camera_object, support))
    _check_curvature(result, depth, limits.inlier_band, depth_model)
    return result


def _check_curvature(result: RefineResult, depth: DepthImage, band: float, depth_model: DepthModel) -> None:
    """
    Raises:
        NotItsShape: what agrees with the model is one smooth surface that is flat in some direction.
    """
    if result.inlier_ratio > _NO_DOUBT:
        return
    found = least_curvature(depth[result.box.slices], result.virtual_depth, result.inliers, band, depth_model.alike)
    if found is None or found.explained < _SMOOTH:
        return
    unsure = _SURELY * found.deviation
    if abs(found.least) <= _FLAT + unsure and found.least + unsure < _CURVED:
        raise NotItsShape(found.least, _CURVED)


def _distance(depth: DepthImage, intrinsics: Intrinsics, p_camera: Float64) -> Float64:
    """Depth where the fruit is seen, shape () [m]: measured, since a small fruit is nearer than its model seems."""
    if p_camera[2] <= 0.0:  # behind the camera: rendering says so
        return np.zeros(())
    column, row = intrinsics.K[:2] @ p_camera / p_camera[2]
    top, left = (max(round(float(at)) - _AROUND_CENTRE, 0) for at in (row, column))
    around = depth[top : top + 2 * _AROUND_CENTRE, left : left + 2 * _AROUND_CENTRE]
    seen = around[np.isfinite(around) & (around > 0.0)]
    return np.array(np.median(seen) if len(seen) else p_camera[2], dtype=np.float64)


def _scaled(
    fit: ScaleFit,
    T_camera_object: Float64,
    model_dimensions: Float64,
    virtual_depth: DepthImage,
    box: ImageBox,
    limits: Limits,
    method: str,
    size_deviation: float,
) -> RefineResult:
    """The model moved and scaled by a fit (eqs. position-update and scale-update), if that is acceptable."""
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
    dimensions = fit.mu * model_dimensions
    # Depth shows where the front is: a larger fruit in the picture lies half of the difference farther away.
    deeper = 0.5 * dimensions.mean() * p_hat / np.linalg.norm(p_hat)
    seen_larger = size_deviation * np.concatenate([deeper, dimensions])
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
        method="paper" if method == "paper" else "uniform",
    )


def _with_sensor(scaled: RefineResult, fit: ScaleFit, intrinsics: Intrinsics, depth_model: DepthModel) -> RefineResult:
    """With what the sensor errs by: neighbouring pixels together, all of them together, and either outline."""
    change = np.concatenate([scaled.T_camera_object[:3, 3], scaled.dimensions])
    z = float(scaled.T_camera_object[2, 3])
    alike = depth_model.alike * fit.variance / fit.mu**2
    outline = np.diag(np.r_[np.zeros(3), np.full(3, depth_model.outline(z, intrinsics.fx) ** 2)])
    whole = (alike + depth_model.of_the_whole(z) ** 2) * np.outer(change, change)
    return replace(scaled, covariance=scaled.covariance + whole + outline)


def _of_kind(
    scaled: RefineResult,
    fit: ScaleFit,
    sizes: KindSizes,
    model_proportion: float,
    size_deviation: float,
    intrinsics: Intrinsics,
    depth_model: DepthModel,
) -> RefineResult:
    """Width and height of a fruit of which one scale and its kind's sizes are known; its front stays where it is."""
    p = scaled.T_camera_object[:3, 3]
    ray = p / np.linalg.norm(p)
    shown = float(scaled.dimensions[[0, 2]].mean())
    whole = depth_model.of_the_whole(float(p[2]))
    outline = depth_model.outline(float(p[2]), intrinsics.fx) / shown
    deviation = float(np.sqrt(size_deviation**2 + outline**2 + whole**2 + depth_model.alike * fit.variance / fit.mu**2))
    sine = float(np.linalg.norm(np.cross(ray, scaled.T_camera_object[:3, 1])))
    size, covariance = sizes.given(shown, deviation, sine, model_proportion)
    dimensions = size[[0, 1, 0]]
    spread = covariance[np.ix_([0, 1, 0], [0, 1, 0])] + np.diag((_OVAL * dimensions * [1.0, 0.0, 1.0]) ** 2)
    T_camera_object = scaled.T_camera_object.copy()
    T_camera_object[:3, 3] += 0.5 * (dimensions.mean() - scaled.dimensions.mean()) * ray
    deeper = np.outer(0.5 * ray, np.full(3, 1.0 / 3.0))
    both = np.vstack([deeper, np.eye(3)])
    place = whole**2 * np.outer(p, p) + (_MISPLACED * dimensions.mean()) ** 2 * np.eye(3)
    full = both @ spread @ both.T
    full[:3, :3] += place
    return replace(scaled, T_camera_object=T_camera_object, dimensions=dimensions, covariance=full)


def _fitted(
    depth: DepthImage,
    intrinsics: Intrinsics,
    depth_model: DepthModel,
    mesh: Triangles,
    scaled: RefineResult,
    method: str,
    support: Plane | None,
    looks: Sequence[OtherLook],
    limits: Limits,
    priors: Priors | None,
    using: RendererName,
) -> RefineResult:
    """The model stretched onto the points of all looks; the scaled one where they do not support it."""
    points, plane = gather(depth, intrinsics, scaled.box, scaled.virtual_depth, scaled.inliers, support, depth_model)
    T_scaled = scaled.T_camera_object.copy()
    T_scaled[:3, :3] *= scaled.mu
    others = gather_others(looks, mesh, T_scaled, plane, limits.inlier_band, using)
    cloud = near_model([points, *others], mesh, T_scaled)
    if len(cloud.points) < _LEAST_POINTS:
        return scaled
    fit = fit_shape(
        cloud,
        mesh,
        scaled.T_camera_object,
        scaled.mu,
        support=plane if support is not None else None,
        band=limits.inlier_band,
        priors=RIGID if method == "uniform" else priors,
    )
    T_fitted = fit.T_camera_object.copy()
    T_fitted[:3, :3] *= fit.stretch
    virtual_depth, box = render_depth(mesh, T_fitted, intrinsics, using=using)
    measured = depth[box.slices]
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
    seen = agreeing / np.count_nonzero(virtual_depth > 0.0) * _share_inside(mesh, T_fitted, intrinsics)
    doubt = _UNSEEN_DOUBT * (1.0 - seen) / seen * float(dimensions.mean() - scaled.dimensions.mean())
    whole = depth_model.of_the_whole(float(fit.T_camera_object[2, 3]))
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
        method=method + ("+plane" if fit.on_support else "") + ("+views" if others else ""),
    )


def _share_inside(mesh: Triangles, T_camera_mesh: Float64, intrinsics: Intrinsics) -> float:
    """Share of a mesh's vertices that lie in the picture: what lies beside it is not seen either."""
    x, y, z = intrinsics.K @ (T_camera_mesh[:3, :3] @ mesh.vertices.T + T_camera_mesh[:3, 3:])
    inside = (x >= 0.0) & (x < intrinsics.width * z) & (y >= 0.0) & (y < intrinsics.height * z)
    return float(inside.mean())


def _covariance(fit: ShapeFit, dimensions: Float64, whole: float, seen: float, doubt: float) -> Float64:
    """Of (position, dimensions): of the fit, of what it does not model, and of what all depth errs by.

    Args:
        fit, dimensions: the stretched model.
        whole: standard deviation of what all depth errs by, relative.
        seen: share of the fruit that is seen and agrees.
        doubt: standard deviation of the dimensions, as other ways to measure disagree [m].
    """
    change = np.concatenate([fit.T_camera_object[:3, 3], dimensions])
    to_size = np.diag(np.concatenate([np.ones(3), dimensions]))
    covariance: Float64 = _FIT_VARIANCE * to_size @ fit.covariance @ to_size
    unmodelled = (_UNMODELLED_ON_SUPPORT if fit.on_support else _UNMODELLED) * dimensions.mean()
    unmodelled /= seen
    unmodelled[3:] = np.hypot(unmodelled[3:], doubt)
    return covariance + np.diag(unmodelled**2) + whole**2 * np.outer(change, change)
