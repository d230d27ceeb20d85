"""A z-buffer in compiled loops: no OpenGL, no context, any thread."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pomona.drivers.interfaces import Intrinsics
from pomona.executive.values.arrays import Float64
from pomona.skills.perception.rasteriser import draw, project
from pomona.skills.perception.refinement.checks import winding
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
    u, v, nearness = project(points, camera)
    draw(u, v, nearness, faces, _seen(u, v, faces, winding(mesh)), nearest)
    depth: DepthImage = np.where(nearest > 0.0, 1.0 / np.maximum(nearest, 1e-12), 0.0).astype(np.float32)
    return depth


@njit(cache=True, nogil=True)
def _seen(u: Float64, v: Float64, faces: NDArray[np.int32], outwards: int) -> NDArray[np.bool_]:
    """Return which faces may be seen, (m,): of a closed mesh, those that look at the camera."""
    seen = np.ones(len(faces), np.bool_)
    if outwards == 0:
        return seen
    for i in range(len(faces)):
        a, b, c = faces[i, 0], faces[i, 1], faces[i, 2]
        area = (u[b] - u[a]) * (v[c] - v[a]) - (u[c] - u[a]) * (v[b] - v[a])
        seen[i] = area * outwards < 0.0
    return seen
