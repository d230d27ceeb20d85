"""Triangles into pixels, compiled: virtual depth, rendered pictures and shadow maps are all drawn by this one loop.

It needs no OpenGL, gives the same picture on every machine, runs in any thread and releases the interpreter's lock.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float64
from pomona.executive.values.numba_kernel import kernel

Indices = NDArray[np.int32]

EDGE = 1e-9  # a pixel this far outside belongs to a triangle, in shares of its corners: no cracks


def project(
    points: NDArray[Any], camera: tuple[float, float, float, float]
) -> tuple[Float64, Float64, Float64]:
    """Return columns, rows [px] and inverse depths [1/m] of points (n, 3), camera frame, (fx, fy, cx, cy) [px]."""
    x, y, z = np.asarray(points, np.float64).T
    with np.errstate(
        divide="ignore", invalid="ignore"
    ):  # the caller leaves out points in the camera's plane
        nearness = 1.0 / z
        return camera[0] * x * nearness + camera[2], camera[1] * y * nearness + camera[3], nearness


@kernel(nogil=True)
def draw(
    u: Float64,
    v: Float64,
    nearness: Float64,
    faces: Indices,
    drawn: NDArray[np.bool_],
    nearest: Float64,
    face_index: Indices | None = None,
    shares: NDArray[np.float32] | None = None,
) -> None:
    """Keep the nearest triangle at each pixel's centre.

    Args:
        u, v, nearness: column and row (pixel centres lie at whole numbers) and nearness of each vertex, (n,) [px].
        faces, drawn: vertices of each triangle, (m, 3), and which are drawn, (m,).
        nearest, face_index: nearness drawn so far, and triangle that each pixel shows, (h, w); nearer ones replace it.
        shares: how much each pixel's point has of its triangle's first and second vertex, (h, w, 2), by perspective.
    """
    rows, columns = nearest.shape
    for face in range(faces.shape[0]):
        if not drawn[face]:
            continue
        a = faces[face, 0]
        b = faces[face, 1]
        c = faces[face, 2]
        ua = u[a]
        va = v[a]
        wa = nearness[a]
        ub = u[b]
        vb = v[b]
        wb = nearness[b]
        uc = u[c]
        vc = v[c]
        wc = nearness[c]
        area = (ub - ua) * (vc - va) - (uc - ua) * (vb - va)
        if area == 0.0:
            continue
        inverse = 1.0 / area
        left = max(int(np.ceil(min(ua, ub, uc))), 0)
        right = min(int(np.floor(max(ua, ub, uc))), columns - 1)
        top = max(int(np.ceil(min(va, vb, vc))), 0)
        bottom = min(int(np.floor(max(va, vb, vc))), rows - 1)
        for row in range(top, bottom + 1):
            for column in range(left, right + 1):
                share_b = ((column - ua) * (vc - va) - (uc - ua) * (row - va)) * inverse
                share_c = ((ub - ua) * (row - va) - (column - ua) * (vb - va)) * inverse
                share_a = 1.0 - share_b - share_c
                if share_a < -EDGE or share_b < -EDGE or share_c < -EDGE:
                    continue
                here = share_a * wa + share_b * wb + share_c * wc
                if here > nearest[row, column]:
                    nearest[row, column] = here
                    if face_index is not None:
                        face_index[row, column] = face
                    if shares is not None:
                        shares[row, column, 0] = share_a * wa / here
                        shares[row, column, 1] = share_b * wb / here
