"""Place of a fruit whose shape is known and whose pose is nearly so: one frame of a fruit that is tracked."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pomona.executive.values.arrays import Float64
from pomona.skills.perception.refinement.checks import extents
from pomona.skills.perception.refinement.depth_image import Triangles
from pomona.skills.perception.refinement.depth_look import DepthLook
from pomona.skills.perception.refinement.errors import TooFewInliers
from pomona.skills.perception.refinement.gather import gather
from pomona.skills.perception.refinement.result import RefineResult
from pomona.skills.perception.refinement.scale_fit import fit_scale
from pomona.skills.perception.refinement.shape_fit import FEW_POINTS, RIGID, fit_shape
from pomona.skills.perception.refinement.support_plane import Plane

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
