"""Distance to the nearest blocked cell of a grid: exact at the cells' corners, a proven lower bound between them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float32, Float64
from pomona.executive.values.read_only import ReadOnly
from pomona.skills.motion.collision.convex import Convex

INTERPOLATION_ERROR = 0.27  # largest overestimate between corners, in cells (0.256 beside a corner)


@dataclass(frozen=True, slots=True, eq=False)
class DistanceField(ReadOnly):
    """Distances to blocked cells as solid cubes, up to a limit.

    From a corner of the grid, the nearest point of a cube of the grid is a corner too: the distance transform of the
    corners is the exact distance to the cubes. Interpolation is exact on faces and overestimates beside edges and
    corners by less than `INTERPOLATION_ERROR` cells, which is subtracted. Outside the grid the distance of the nearest
    point of the grid's volume is a lower bound.
    """

    values: Float32  # distances at the corners, shape (nx + 1, ny + 1, nz + 1), float32 [m]
    origin: Float64  # position of corner (0, 0, 0) in the base frame, shape (3,) [m]
    resolution: float  # edge of a cell [m]
    limit: float  # larger distances are given as this [m]
    shapes: tuple[Convex, ...] = ()  # obstacles that the map has as shapes; `distance` leaves them out

    @staticmethod
    def of_blocked(blocked: NDArray[np.bool_], origin: Float64, resolution: float, limit: float) -> DistanceField:
        """Return the field of a grid of cells, shape (nx, ny, nz)."""
        values = np.empty(tuple(n + 1 for n in blocked.shape), dtype=np.float32)
        _squared_distances(blocked, (limit / resolution) ** 2, values)
        return DistanceField(np.sqrt(values, out=values) * np.float32(resolution), origin, resolution, limit)

    @staticmethod
    def nothing_blocked() -> DistanceField:
        """Return a field without any blocked cell, for scenes that are given by shapes alone."""
        return DistanceField(np.full((2, 2, 2), 1e3, dtype=np.float32), np.zeros(3), 1e-3, 1e3)

    def distance(self, points: Float64) -> Float64:
        """Lower bound of the distance of points, shape (n, 3), in the base frame from blocked cells; shape (n,) [m]."""
        p = np.ascontiguousarray(points, dtype=np.float64)
        distances: Float64 = _distances(self.values, self.origin, self.resolution, p)
        return distances


@njit(cache=True, nogil=True)
def lookup(values: Float32, origin: Float64, resolution: float, x: float, y: float, z: float) -> float:
    """Return the distance at a point of the base frame [m], by trilinear interpolation minus its greatest error."""
    u, v, w = (x - origin[0]) / resolution, (y - origin[1]) / resolution, (z - origin[2]) / resolution
    u = min(max(u, 0.0), values.shape[0] - 1.000001)
    v = min(max(v, 0.0), values.shape[1] - 1.000001)
    w = min(max(w, 0.0), values.shape[2] - 1.000001)
    i, j, k = int(u), int(v), int(w)
    u, v, w = u - i, v - j, w - k
    a = values[i, j, k] + w * (values[i, j, k + 1] - values[i, j, k])
    b = values[i, j + 1, k] + w * (values[i, j + 1, k + 1] - values[i, j + 1, k])
    c = values[i + 1, j, k] + w * (values[i + 1, j, k + 1] - values[i + 1, j, k])
    d = values[i + 1, j + 1, k] + w * (values[i + 1, j + 1, k + 1] - values[i + 1, j + 1, k])
    a += v * (b - a)
    c += v * (d - c)
    distance: float = a + u * (c - a) - INTERPOLATION_ERROR * resolution
    return distance


@njit(cache=True, nogil=True)
def _distances(values: Float32, origin: Float64, resolution: float, points: Float64) -> Float64:
    """`lookup` at points of shape (n, 3)."""
    distances = np.empty(points.shape[0])
    for i in range(points.shape[0]):
        distances[i] = lookup(values, origin, resolution, points[i, 0], points[i, 1], points[i, 2])
    return distances


@njit(cache=True, nogil=True)
def _lower_envelope(f: Float32, limit: float, vertex: NDArray[np.int64], cut: Float64, out: Float32) -> None:
    """out[i] = min over j of f[j] + (i - j)², capped at limit (Felzenszwalb and Huttenlocher 2012)."""
    n = f.shape[0]
    k = -1
    for j in range(n):
        if f[j] >= limit:
            continue
        crossing = -1e18
        while k >= 0:
            crossing = (f[j] + j * j - f[vertex[k]] - vertex[k] * vertex[k]) / (2.0 * (j - vertex[k]))
            if crossing > cut[k]:
                break
            k -= 1
            crossing = -1e18
        k += 1
        vertex[k], cut[k] = j, crossing
    if k < 0:
        out[:n] = limit
        return
    cut[k + 1] = 1e18
    k = 0
    for i in range(n):
        while cut[k + 1] < i:
            k += 1
        away = i - vertex[k]
        out[i] = min(limit, f[vertex[k]] + away * away)


@njit(cache=True, nogil=True)
def _squared_distances(blocked: NDArray[np.bool_], limit: float, out: Float32) -> None:
    """Squared distances of all corners to the nearest corner of a blocked cell [cells²], capped at limit."""
    nx, ny, nz = out.shape
    out[:] = limit
    for i in range(nx - 1):
        for j in range(ny - 1):
            for k in range(nz - 1):
                if blocked[i, j, k]:
                    for a in range(2):
                        for b in range(2):
                            out[i + a, j + b, k] = 0.0
                            out[i + a, j + b, k + 1] = 0.0
    longest = max(nx, ny, nz)
    vertex = np.empty(longest + 1, np.int64)
    cut = np.empty(longest + 2)
    line = np.empty(longest, np.float32)
    envelope = np.empty(longest, np.float32)
    for i in range(nx):
        for j in range(ny):
            near = False
            for k in range(nz):
                line[k] = out[i, j, k]
                near |= line[k] < limit
            if near:
                _lower_envelope(line[:nz], limit, vertex, cut, out[i, j])
    for i in range(nx):
        for k in range(nz):
            near = False
            for j in range(ny):
                line[j] = out[i, j, k]
                near |= line[j] < limit
            if near:
                _lower_envelope(line[:ny], limit, vertex, cut, envelope)
                for j in range(ny):
                    out[i, j, k] = envelope[j]
    for j in range(ny):
        for k in range(nz):
            near = False
            for i in range(nx):
                line[i] = out[i, j, k]
                near |= line[i] < limit
            if near:
                _lower_envelope(line[:nx], limit, vertex, cut, envelope)
                for i in range(nx):
                    out[i, j, k] = envelope[i]
