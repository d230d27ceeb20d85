"""Measured points for the fit of a fruit's shape: from all looks, without its support."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float64
from pomona.skills.geometry import inverse
from pomona.skills.perception.refinement.cloud import Cloud, cloud, together
from pomona.skills.perception.refinement.depth_image import DepthImage, ImageBox, Triangles
from pomona.skills.perception.refinement.depth_look import DepthLook
from pomona.skills.perception.refinement.errors import RenderFailed, TooFewInliers
from pomona.skills.perception.refinement.result import RefineResult
from pomona.skills.perception.refinement.segment import connected_to, without_edge
from pomona.skills.perception.refinement.support_plane import Plane, seen_near

_MARGIN = 0.15
_AROUND = 16
_ABOVE_PLANE = 4e-3
_LEAST_ABOVE = 0.5
_BEYOND_MODEL = 0.02


def plane_below(look: DepthLook, scaled: RefineResult, known: Plane) -> Plane:
    """Return the plane that a scaled fruit stands on as the camera sees it, else the expected one, camera frame."""
    return seen_near(known, points_around(look, scaled.box, scaled.virtual_depth)) or known


def gather(look: DepthLook, scaled: RefineResult, plane: Plane | None) -> Cloud:
    """Return the points of a look around a scaled fruit, without the plane that it stands on.

    Raises TooFewInliers: the points that agree with the model lie on the plane.
    """
    points = _connected(look, scaled.box, scaled.virtual_depth, scaled.inliers)
    if plane is None:
        return points
    above = float(np.mean(plane.height(cloud(look, scaled.box, scaled.inliers).points) > _ABOVE_PLANE))
    if above < _LEAST_ABOVE:
        raise TooFewInliers(above, _LEAST_ABOVE)  # the detected fruit is the table itself
    return points.chosen(plane.height(points.points) > _ABOVE_PLANE)


def points_around(look: DepthLook, box: ImageBox, virtual_depth: DepthImage) -> Float64:
    """Return every fourth measured point beside a fruit in a box of the image, shape (n, 3) [m]."""
    around = box.grown(_AROUND, look.intrinsics)
    outside = np.zeros(around.shape, dtype=np.bool_)
    outside[::2, ::2] = True
    top, left = box.top - around.top, box.left - around.left
    outside[top : top + box.shape[0], left : left + box.shape[1]] &= virtual_depth <= 0.0
    return cloud(look, around, outside).points


def gather_others(
    looks: Sequence[DepthLook], mesh: Triangles, T_camera_mesh: Float64, plane: Plane | None, band: float
) -> list[Cloud]:
    """Return the points of other looks that agree with the scaled model, in the frame of the first look.

    Looks that miss the fruit, or show something else in its place, give none.
    """
    clouds = []
    for look in looks:
        try:
            virtual_depth, box = look.render(mesh, inverse(look.T_camera_look) @ T_camera_mesh)
        except RenderFailed:
            continue  # the fruit is not in this picture
        # another look agrees with the model of the first within this many bands: the model is not right yet
        near = np.abs(look.depth[box.slices] - virtual_depth) <= 2.0 * band
        points = _connected(look, box, virtual_depth, near).moved(look.T_camera_look)
        if plane is not None:
            points = points.chosen(plane.height(points.points) > _ABOVE_PLANE)
        if len(points.points):
            clouds.append(points)
    return clouds


def _connected(look: DepthLook, box: ImageBox, virtual_depth: DepthImage, inliers: NDArray[np.bool_]) -> Cloud:
    """Return the points in and around a box that are connected to the pixels that agree with a model."""
    wide = box.grown(int(_MARGIN * max(box.shape)) + 2, look.intrinsics)
    top, left = box.top - wide.top, box.left - wide.left
    covered, agreeing = np.zeros(wide.shape, dtype=np.bool_), np.zeros(wide.shape, dtype=np.bool_)
    part = slice(top, top + box.shape[0]), slice(left, left + box.shape[1])
    covered[part], agreeing[part] = virtual_depth > 0.0, inliers
    connected = connected_to(agreeing, look.depth[wide.slices], covered)
    if look.depth_model.edge:
        connected = without_edge(connected, look.depth_model.edge)
    return cloud(look, wide, connected)


def near_model(clouds: list[Cloud], centre: Float64, radius: float) -> Cloud:
    """Return all points that are not farther from the scaled model's centre, shape (3,), than it could reach [m]."""
    points = clouds[0] if len(clouds) == 1 else together(clouds)
    away = points.points - centre
    return points.chosen(np.einsum("ij,ij->i", away, away) < (1.2 * radius + _BEYOND_MODEL) ** 2)
