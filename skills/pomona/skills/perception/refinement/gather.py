"""Which measured points to fit a fruit's shape to: from all looks, without what it stands on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pomona.drivers.depth_model import D4XX, DepthModel
from pomona.drivers.interfaces import Intrinsics
from pomona.executive.values.arrays import Float64
from pomona.skills.geometry import inverse
from pomona.skills.perception.refinement.cloud import Cloud, cloud, together
from pomona.skills.perception.refinement.depth_image import DepthImage, ImageBox, RendererName, Triangles
from pomona.skills.perception.refinement.errors import RenderFailed, TooFewInliers
from pomona.skills.perception.refinement.render import render_depth
from pomona.skills.perception.refinement.segment import connected_to, without_edge
from pomona.skills.perception.refinement.support_plane import Plane, seen_near

_MARGIN = 0.15
_AROUND = 16
_ABOVE_PLANE = 4e-3
_LEAST_ABOVE = 0.5
_BEYOND_MODEL = 0.02
_OTHER_LOOK = 2.0
"""Another look agrees with the model of the first within this many bands: the model is not right yet."""


@dataclass(frozen=True, slots=True, eq=False)
class OtherLook:
    """Another look at the same fruit.

    Attributes:
        depth: z-depth, shape (h, w) [m]; 0 or not finite where there is none.
        intrinsics: of this depth image.
        T_camera_look: pose of this look's camera in the frame of the look that is refined.
        depth_model: how this depth errs.
    """

    depth: DepthImage
    intrinsics: Intrinsics
    T_camera_look: Float64
    depth_model: DepthModel = D4XX


def gather(
    depth: DepthImage,
    intrinsics: Intrinsics,
    box: ImageBox,
    virtual_depth: DepthImage,
    inliers: NDArray[np.bool_],
    known: Plane | None,
    model: DepthModel = D4XX,
) -> tuple[Cloud, Plane | None]:
    """Points of one look around a fruit that was scaled already, and the plane that it stands on.

    Args:
        depth, intrinsics: the look.
        box: part of the image that the model covers.
        virtual_depth: the scaled model's depth, shape `box.shape` [m].
        inliers: pixels that agree with it, shape `box.shape`.
        known: where the support should be, in the camera frame; None if unknown.
        model: how the depth errs.

    Returns:
        the points that do not lie on the support, and the support as the camera sees it: the known one where the
        camera does not see it, None where it is unknown.

    Raises:
        TooFewInliers: what agrees with the model lies on the known support.
    """
    points = _connected(depth, intrinsics, box, virtual_depth, inliers, model)
    if known is None:
        return points, None
    plane = seen_near(known, points_around(depth, intrinsics, box, virtual_depth)) or known
    above = float(np.mean(plane.height(cloud(depth, intrinsics, box, inliers).points) > _ABOVE_PLANE))
    if above < _LEAST_ABOVE:
        raise TooFewInliers(above, _LEAST_ABOVE)  # what looks like fruit is the table itself
    return points.chosen(plane.height(points.points) > _ABOVE_PLANE), plane


def points_around(depth: DepthImage, intrinsics: Intrinsics, box: ImageBox, virtual_depth: DepthImage) -> Float64:
    """What is measured beside a fruit in a box of the image, shape (n, 3) [m], of every fourth pixel."""
    around = box.grown(_AROUND, intrinsics)
    outside = np.zeros(around.shape, dtype=np.bool_)
    outside[::2, ::2] = True
    top, left = box.top - around.top, box.left - around.left
    outside[top : top + box.shape[0], left : left + box.shape[1]] &= virtual_depth <= 0.0
    return cloud(depth, intrinsics, around, outside).points


def gather_others(
    looks: Sequence[OtherLook],
    mesh: Triangles,
    T_camera_mesh: Float64,
    plane: Plane | None,
    band: float,
    using: RendererName,
) -> list[Cloud]:
    """Points of other looks that agree with the scaled model, in the frame of the first look.

    Looks that miss the fruit, or show something else in its place, give none.
    """
    clouds = []
    for look in looks:
        try:
            virtual_depth, box = render_depth(
                mesh, inverse(look.T_camera_look) @ T_camera_mesh, look.intrinsics, using=using
            )
        except RenderFailed:
            continue  # the fruit is not in this picture
        near = np.abs(look.depth[box.slices] - virtual_depth) <= _OTHER_LOOK * band
        points = _connected(look.depth, look.intrinsics, box, virtual_depth, near, look.depth_model)
        points = points.moved(look.T_camera_look)
        if plane is not None:
            points = points.chosen(plane.height(points.points) > _ABOVE_PLANE)
        if len(points.points):
            clouds.append(points)
    return clouds


def _connected(
    depth: DepthImage,
    intrinsics: Intrinsics,
    box: ImageBox,
    virtual_depth: DepthImage,
    inliers: NDArray[np.bool_],
    model: DepthModel,
) -> Cloud:
    """Points in and around a box that are connected to the pixels that agree with a model."""
    wide = box.grown(int(_MARGIN * max(box.shape)) + 2, intrinsics)
    top, left = box.top - wide.top, box.left - wide.left
    covered, agreeing = np.zeros(wide.shape, dtype=np.bool_), np.zeros(wide.shape, dtype=np.bool_)
    part = slice(top, top + box.shape[0]), slice(left, left + box.shape[1])
    covered[part], agreeing[part] = virtual_depth > 0.0, inliers
    connected = connected_to(agreeing, depth[wide.slices], covered)
    if model.edge:
        connected = without_edge(connected, model.edge)
    return cloud(depth, intrinsics, wide, connected, model)


def near_model(clouds: list[Cloud], mesh: Triangles, T_camera_mesh: Float64) -> Cloud:
    """All points that are not farther from the scaled model's centre than it could reach."""
    radius = float(np.linalg.norm(mesh.vertices @ T_camera_mesh[:3, :3].T, axis=1).max())
    points = together(clouds)
    distance = np.linalg.norm(points.points - T_camera_mesh[:3, 3], axis=1)
    return points.chosen(distance < 1.2 * radius + _BEYOND_MODEL)
