"""True size and position of a detected fruit from a depth image."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from drivers.interfaces import Intrinsics
from skills.refine.checks import check_depth, check_pose, extents
from skills.refine.errors import AtBound, SizeOutOfRange, TooFewInliers
from skills.refine.paper import fit_scale_by_rendering, sigma_bound
from skills.refine.render import DepthImage, ImageBox, RendererName, Triangles, render_depth
from skills.refine.scale_fit import ScaleFit, fit_scale

Float64 = NDArray[np.float64]
Method = Literal["uniform", "paper"]


@dataclass(frozen=True, slots=True)
class Limits:
    """What is accepted as a measurement.

    Attributes:
        inlier_band: half-width of the band in which depth agrees with the model [m].
        min_inliers: least share of the measured pixels that must agree.
        size: least and largest size relative to the model.
    """

    inlier_band: float = 4e-3
    min_inliers: float = 0.25
    size: tuple[float, float] = (0.4, 1.6)


@dataclass(frozen=True, slots=True, eq=False)
class RefineResult:
    """A fruit's refined pose and size, in the camera frame.

    Attributes:
        T_camera_object: pose of the refined shape's cuboid.
        dimensions: (d_x, d_y, d_z) [m], shape (3,).
        mu, sigma: scale factor and displacement [m] of the uniform fit (the paper's).
        covariance: of (position in the camera frame, dimensions), shape (6, 6) [m²].
        inlier_ratio: share of the model's measured pixels whose depth agrees.
        residual: root mean square of the inliers' depth residuals [m].
        box: part of the image that the next two cover.
        inliers: pixels that agree, bool, shape `box.shape`.
        virtual_depth: the refined model's z-depth, float32, shape `box.shape` [m]; 0 outside it.
        method: the formulation that gave the result.
    """

    T_camera_object: Float64
    dimensions: Float64
    mu: float
    sigma: float
    covariance: Float64
    inlier_ratio: float
    residual: float
    box: ImageBox
    inliers: NDArray[np.bool_]
    virtual_depth: DepthImage
    method: str


def refine(
    depth: DepthImage,
    intrinsics: Intrinsics,
    T_camera_object: Float64,
    mesh: Triangles,
    *,
    method: Method = "uniform",
    limits: Limits | None = None,
    using: RendererName = "pyrender",
) -> RefineResult:
    """Measure a fruit whose pose was estimated as if it had the size of its CAD model.

    Args:
        depth: z-depth, shape (h, w) [m]; 0 or not finite where the sensor saw nothing.
        intrinsics: of the depth image.
        T_camera_object: the detector's pose of the CAD-sized model (the paper's p_hat and Q_hat).
        mesh: the CAD model, watertight, its origin in the centre of its cuboid; a `FruitModel` is one.
        method: uniform - the closed form with one render; paper - the same optimum by repeated rendering.
        limits: what is accepted as a measurement.
        using: name of the renderer.

    Raises:
        RefineError: `BadDepth`, `BadMesh`, `BadPose` for what is no depth image of this camera, no mesh, no pose;
            `NoDepth`, `TooFewInliers`, `SizeOutOfRange`, `AtBound`, `RenderFailed` where there is no measurement.
    """
    limits = limits or Limits()
    check_depth(depth, intrinsics)
    check_pose(T_camera_object)
    model_dimensions = extents(mesh)
    virtual_depth, box = render_depth(mesh, T_camera_object, intrinsics, using=using)
    measured = depth[box.slices]
    if method == "paper":
        fit = fit_scale_by_rendering(
            measured, mesh, T_camera_object, intrinsics, box, inlier_band=limits.inlier_band, using=using
        )
    else:
        fit = fit_scale(measured, virtual_depth, limits.inlier_band)
    return _scaled(fit, T_camera_object, model_dimensions, virtual_depth, box, limits, method)


def _scaled(
    fit: ScaleFit,
    T_camera_object: Float64,
    model_dimensions: Float64,
    virtual_depth: DepthImage,
    box: ImageBox,
    limits: Limits,
    method: str,
) -> RefineResult:
    """The model moved and scaled by a fit (eqs. position-update and scale-update), if that is acceptable."""
    p_hat = T_camera_object[:3, 3]
    sigma = (1.0 - fit.mu) * float(np.linalg.norm(p_hat))
    bound = sigma_bound(p_hat)
    if abs(sigma) >= 0.999 * bound:
        raise AtBound(sigma, bound)
    if fit.inlier_ratio < limits.min_inliers:
        raise TooFewInliers(fit.inlier_ratio, limits.min_inliers)
    if not limits.size[0] <= fit.mu <= limits.size[1]:
        raise SizeOutOfRange(fit.mu, *limits.size)
    T_refined = T_camera_object.copy()
    T_refined[:3, 3] = fit.mu * p_hat
    change = np.concatenate([p_hat, model_dimensions])
    return RefineResult(
        T_camera_object=T_refined,
        dimensions=fit.mu * model_dimensions,
        mu=fit.mu,
        sigma=sigma,
        covariance=fit.variance * np.outer(change, change),
        inlier_ratio=fit.inlier_ratio,
        residual=fit.residual,
        box=box,
        inliers=fit.inliers,
        virtual_depth=np.float32(fit.mu) * virtual_depth,
        method=method,
    )
