"""A z-buffer in compiled loops: no OpenGL, no context, any thread."""

from __future__ import annotations

import numpy as np

from pomona.drivers.interfaces import Intrinsics
from pomona.executive.values.arrays import Float64
from pomona.skills.perception.rasteriser import draw, project
from pomona.skills.perception.refinement.depth_image import NEAR, DepthImage, ImageBox, Triangles
from pomona.skills.perception.refinement.errors import RenderFailed


def render_with_zbuffer(mesh: Triangles, T_camera_mesh: Float64, intrinsics: Intrinsics, box: ImageBox) -> DepthImage:
    """`render.DepthRenderer` in compiled loops, depth (h, w) [m].

    Raises RenderFailed: a part of the mesh is not in front of the camera.
    """
    points = mesh.vertices @ T_camera_mesh[:3, :3].T + T_camera_mesh[:3, 3]
    if points[:, 2].min() <= NEAR:
        raise RenderFailed("the fruit's pose is behind the camera or touches it: the detection is wrong")
    camera = (intrinsics.fx, intrinsics.fy, intrinsics.cx - box.left, intrinsics.cy - box.top)
    nearest = np.zeros(box.shape)
    faces = np.ascontiguousarray(mesh.faces)
    draw(*project(points, camera), faces, np.ones(len(faces), np.bool_), nearest)
    depth: DepthImage = np.where(nearest > 0.0, 1.0 / np.maximum(nearest, 1e-12), 0.0).astype(np.float32)
    return depth
