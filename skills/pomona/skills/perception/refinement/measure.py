"""From a detection to a measured fruit in the base frame."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import cv2
import numpy as np

from pomona.executive.values.arrays import Float64
from pomona.skills.geometry import inverse
from pomona.skills.perception.detection.detection import Detection
from pomona.skills.perception.measured_fruit import MeasuredFruit
from pomona.skills.perception.refinement.cloud import Plane, gather, horizontal_plane, points_around, seen_elsewhere
from pomona.skills.perception.refinement.depth_image import (
    DepthImage,
    ImageBox,
    Limits,
    Method,
    RefineResult,
    RendererName,
    Triangles,
    extents,
)
from pomona.skills.perception.refinement.errors import NoDepth, TooFewInliers
from pomona.skills.perception.refinement.refinement import FruitContext, refine
from pomona.skills.perception.refinement.render import DepthLook, render_depth
from pomona.skills.perception.refinement.scale_fit import fit_scale
from pomona.skills.perception.refinement.shape_fit import FEW_POINTS, RIGID, fit_shape


def measure(
    detection: Detection,
    method: Method | Literal["none"] = "shape",
    limits: Limits | None = None,
    renderer: RendererName = "pyrender",
    table_z: float | None = None,
    earlier: MeasuredFruit | None = None,
) -> MeasuredFruit:
    """Refine a detection and express it in the base frame; method `none` keeps the detector's pose and the CAD size.

    Args:
        method, limits: see `refinement.refine`.
        table_z: height of the table in the base frame [m], if the fruit may stand on one.
        earlier: the same fruit, measured from another place: its looks are fused in.

    Raises RefineError: see `refinement.refine`; `NoDepth` also when the frame has no depth image.
    """
    frame = detection.frame
    if method == "none":
        return _unrefined(detection, renderer)
    if frame.depth is None:
        raise NoDepth(0, 0)
    past = () if earlier is None else (*earlier.earlier, (earlier.frame, earlier.T_base_camera))
    T_camera_base = inverse(detection.T_base_camera)
    support = None if table_z is None else horizontal_plane(detection.T_base_camera, table_z)
    look = DepthLook(frame.depth, frame.intrinsics, frame.depth_model, renderer=renderer)
    looks = tuple(
        DepthLook(f.depth, f.intrinsics, f.depth_model, T_camera_base @ T, renderer)
        for f, T in past
        if f.depth is not None
    )
    known = FruitContext(
        support=support, looks=looks, sizes=detection.fruit.sizes, size_deviation=detection.size_deviation
    )
    result = refine(look, detection.T_camera_object, detection.fruit, method=method, known=known, limits=limits)
    turn = np.eye(6)
    turn[:3, :3] = detection.T_base_camera[:3, :3]
    return MeasuredFruit(
        fruit=detection.fruit,
        T_base_fruit=detection.T_base_camera @ result.T_camera_object,
        T_base_camera=detection.T_base_camera,
        dimensions=result.dimensions,
        mu=result.mu,
        sigma=result.sigma,
        covariance=turn @ result.covariance @ turn.T,
        inlier_ratio=result.inlier_ratio,
        residual=result.residual,
        contour=outline(result.virtual_depth, result.box),
        frame=frame,
        method=result.method,
        earlier=past if result.method.endswith("+views") else (),
        doubt="" if support is None else _doubt(look, result, support),
    )


def _doubt(look: DepthLook, result: RefineResult, support: Plane) -> str:
    """Return a sentence if the surface around the fruit contradicts the cell file, otherwise an empty text."""
    elsewhere = seen_elsewhere(support, points_around(look, result.box, result.virtual_depth))
    if elsewhere is None:
        return ""
    height, tilt = elsewhere
    side = "above" if height > 0.0 else "below"
    return (
        f"around the fruit a surface is seen {1e3 * abs(height):.0f} mm {side} the table and {math.degrees(tilt):.0f}° "
        "tilted against it: the fruit lies on an object, or the table's height, the camera's place or its intrinsics "
        "are wrong"
    )


def outline(virtual_depth: DepthImage, box: ImageBox) -> Float64:
    """Return the longest outline of the pixels with depth in the whole image, shape (n, 2) [px]; may be empty."""
    seen = (virtual_depth > 0.0).astype(np.uint8)
    contours, _ = cv2.findContours(seen, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    if not contours:
        return np.empty((0, 2))
    longest = max(contours, key=len).reshape(-1, 2).astype(np.float64)
    shifted: Float64 = longest + np.array([box.left, box.top], dtype=np.float64)
    return shifted


def _unrefined(detection: Detection, renderer: RendererName) -> MeasuredFruit:
    virtual_depth, box = render_depth(
        detection.fruit, detection.T_camera_object, detection.frame.intrinsics, using=renderer
    )
    R = detection.T_base_camera[:3, :3]
    covariance = np.zeros((6, 6))
    covariance[:3, :3] = R @ detection.covariance[3:, 3:] @ R.T
    return MeasuredFruit(
        fruit=detection.fruit,
        T_base_fruit=detection.T_base_camera @ detection.T_camera_object,
        T_base_camera=detection.T_base_camera,
        dimensions=detection.fruit.dimensions.copy(),
        mu=1.0,
        sigma=0.0,
        covariance=covariance,
        inlier_ratio=0.0,
        residual=0.0,
        contour=outline(virtual_depth, box),
        frame=detection.frame,
        method="none",
    )


NEAR = replace(RIGID, place=0.02, size=0.002)
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


def fit_place(look: DepthLook, mesh: Triangles, T_camera_mesh: Float64, support: Plane | None) -> PlaceFit:
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
    none, size = np.zeros((6, 6)), extents(mesh)
    seen = RefineResult(
        T_camera_mesh, size, 1.0, 0.0, none, fit.inlier_ratio, fit.residual, box, fit.inliers, virtual_depth, "uniform"
    )
    points = gather(look, seen, support)
    if len(points.points) < FEWEST:
        raise TooFewInliers(len(points.points) / max(fit.model_pixels, 1), FEWEST / max(fit.model_pixels, FEWEST))
    placed = fit_shape(points, mesh, T_camera_mesh, 1.0, band=4e-3, priors=NEAR, at_most=FEW_POINTS)
    return PlaceFit(placed.T_camera_object[:3, 3].copy(), fit.inlier_ratio)
