"""A z-buffer in compiled loops: no OpenGL, no context, any thread."""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from drivers.interfaces import Intrinsics
from skills.perception.refinement.depth_image import NEAR, DepthImage, ImageBox, Triangles
from skills.perception.refinement.errors import RenderFailed

Float64 = NDArray[np.float64]


def render_with_zbuffer(mesh: Triangles, T_camera_mesh: Float64, intrinsics: Intrinsics, box: ImageBox) -> DepthImage:
    """`render.DepthRenderer` in compiled loops.

    Raises:
        RenderFailed: a part of the mesh is not in front of the camera.
    """
    points = mesh.vertices @ T_camera_mesh[:3, :3].T + T_camera_mesh[:3, 3]
    if points[:, 2].min() <= NEAR:
        raise RenderFailed("the fruit's pose is behind the camera or touches it: the detection is wrong")
    inverse_depth = np.zeros(box.shape)
    u = intrinsics.fx * points[:, 0] / points[:, 2] + (intrinsics.cx - box.left)
    v = intrinsics.fy * points[:, 1] / points[:, 2] + (intrinsics.cy - box.top)
    _rasterise(u, v, 1.0 / points[:, 2], np.ascontiguousarray(mesh.faces), inverse_depth)
    depth: DepthImage = np.where(inverse_depth > 0.0, 1.0 / np.maximum(inverse_depth, 1e-12), 0.0).astype(np.float32)
    return depth


@numba.njit(cache=True, nogil=True)
def _rasterise(u: Float64, v: Float64, w: Float64, faces: NDArray[np.int32], nearest: Float64) -> None:
    """Keep the largest inverse depth per pixel centre: 1/z is linear over a triangle's image."""
    rows, columns = nearest.shape
    for face in range(faces.shape[0]):
        a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
        area = (u[b] - u[a]) * (v[c] - v[a]) - (u[c] - u[a]) * (v[b] - v[a])
        if area == 0.0:
            continue
        left = max(int(np.ceil(min(u[a], u[b], u[c]))), 0)
        right = min(int(np.floor(max(u[a], u[b], u[c]))), columns - 1)
        top = max(int(np.ceil(min(v[a], v[b], v[c]))), 0)
        bottom = min(int(np.floor(max(v[a], v[b], v[c]))), rows - 1)
        for row in range(top, bottom + 1):
            for column in range(left, right + 1):
                share_b = ((column - u[a]) * (v[c] - v[a]) - (u[c] - u[a]) * (row - v[a])) / area
                share_c = ((u[b] - u[a]) * (row - v[a]) - (column - u[a]) * (v[b] - v[a])) / area
                share_a = 1.0 - share_b - share_c
                if share_a >= -1e-9 and share_b >= -1e-9 and share_c >= -1e-9:
                    inverse_depth = share_a * w[a] + share_b * w[b] + share_c * w[c]
                    if inverse_depth > nearest[row, column]:
                        nearest[row, column] = inverse_depth
