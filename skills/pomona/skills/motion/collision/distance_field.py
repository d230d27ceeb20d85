"""Obstacles: convex solids as sets of planes, and the distance to the nearest blocked cell of a grid.

The distance is exact at the cells' corners, and a proven lower bound between them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pomona.drivers.interfaces import Box, Hull
from pomona.executive.values.arrays import Float32, Float64
from pomona.executive.values.numba_kernel import kernel
from pomona.executive.values.read_only import ReadOnly
from pomona.skills.motion.collision.cover import fibonacci_sphere
from pomona.skills.perception.measured_fruit import MeasuredFruit

_CUBE = np.array(
    [[x, y, z] for x in (-1.0, 0.0, 1.0) for y in (-1.0, 0.0, 1.0) for z in (-1.0, 0.0, 1.0)]
)
_CUBE_DIRECTIONS = np.delete(_CUBE, 13, axis=0) / np.linalg.norm(
    np.delete(_CUBE, 13, axis=0), axis=1, keepdims=True
)
_ROUND_DIRECTIONS = 162
_ROUND = fibonacci_sphere(_ROUND_DIRECTIONS)


@dataclass(frozen=True, slots=True, eq=False)
class Convex:
    """The region n·p <= offset of all planes, in the base frame; it contains the represented shape.

    The distance to it is bounded from below by the largest n·p - offset: exact in front of a face of a box, within some
    percent beside edges, within half a millimetre for a fruit of 5 cm.
    """

    name: str  # for messages
    planes: Float64  # unit normals and offsets, shape (k, 4) [1, m]
    bound: Float64  # a sphere around the shape, shape (4,) [m]

    @staticmethod
    def of_points(name: str, points: ArrayLike, directions: Float64 | None = None) -> Convex:
        """Return a polyhedron around points, shape (n, 3), in the base frame, with normals `directions`, (k, 3)."""
        corners = np.asarray(points, dtype=np.float64)
        normals = fibonacci_sphere(_ROUND_DIRECTIONS) if directions is None else directions
        centre = (corners.min(axis=0) + corners.max(axis=0)) / 2.0
        radius = np.linalg.norm(corners - centre, axis=1).max()
        return Convex(
            name,
            np.column_stack((normals, (corners @ normals.T).max(axis=0))),
            np.append(centre, radius),
        )

    @staticmethod
    def of_box(box: Box) -> Convex:
        """Return a box of the cell: its faces, and planes along its edges and corners."""
        corners = _CUBE[np.abs(_CUBE).sum(axis=1) == 3.0] * box.half_extents
        R = box.T_base_box[:3, :3]
        p = box.T_base_box[:3, 3]
        return Convex.of_points(box.name, corners @ R.T + p, _CUBE_DIRECTIONS @ R.T)

    @staticmethod
    def of_fruit(measured: MeasuredFruit, name: str = "target") -> Convex:
        """Return a measured fruit: the hull of its refined shape."""
        return Convex.of_points(name, fruit_points(measured))

    @staticmethod
    def of_hull(hull: Hull) -> Convex:
        """Return a part of a mesh: its own faces, and planes all around."""
        return Convex.of_points(
            hull.name, hull.points, np.vstack((hull.normals, _CUBE_DIRECTIONS, _ROUND))
        )

    def distance(self, points: ArrayLike) -> Float64:
        """Lower bound of the distance of points, shape (n, 3), in the base frame; negative inside. Shape (n,) [m]."""
        p = np.asarray(points, dtype=np.float64)
        away: Float64 = np.max(p @ self.planes[:, :3].T - self.planes[:, 3], axis=1)
        return away


def fruit_points(measured: MeasuredFruit) -> Float64:
    """Vertices of a measured fruit's refined shape in the base frame, shape (n, 3) [m]."""
    scaled = measured.fruit.vertices * (measured.dimensions / measured.fruit.dimensions)
    points: Float64 = scaled @ measured.T_base_fruit[:3, :3].T + measured.T_base_fruit[:3, 3]
    return points


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
    shapes: tuple[
        Convex, ...
    ] = ()  # obstacles that the map has as shapes; `distance` leaves them out

    @staticmethod
    def of_blocked(
        blocked: NDArray[np.bool_], origin: Float64, resolution: float, limit: float
    ) -> DistanceField:
        """Return the field of a grid of cells, shape (nx, ny, nz)."""
        values = np.empty(tuple(n + 1 for n in blocked.shape), dtype=np.float32)
        _squared_distances(blocked, (limit / resolution) ** 2, values)
        return DistanceField(
            np.sqrt(values, out=values) * np.float32(resolution), origin, resolution, limit
        )

    @staticmethod
    def nothing_blocked() -> DistanceField:
        """Return a field without any blocked cell, for scenes that are given by shapes alone."""
        return DistanceField(np.full((2, 2, 2), 1e3, dtype=np.float32), np.zeros(3), 1e-3, 1e3)

    def distance(self, points: Float64) -> Float64:
        """Lower bound of the distance of points, shape (n, 3), in the base frame from blocked cells; shape (n,) [m]."""
        p = np.ascontiguousarray(points, dtype=np.float64)
        distances: Float64 = _distances(self.values, self.origin, self.resolution, p)
        return distances


@kernel(nogil=True)
def lookup(
    values: Float32, origin: Float64, resolution: float, x: float, y: float, z: float
) -> float:
    """Return the distance at a point of the base frame [m], by trilinear interpolation minus its greatest error."""
    u = (x - origin[0]) / resolution
    v = (y - origin[1]) / resolution
    w = (z - origin[2]) / resolution
    u = min(max(u, 0.0), values.shape[0] - 1.000001)
    v = min(max(v, 0.0), values.shape[1] - 1.000001)
    w = min(max(w, 0.0), values.shape[2] - 1.000001)
    i = int(u)
    j = int(v)
    k = int(w)
    u = u - i
    v = v - j
    w = w - k
    a = values[i, j, k] + w * (values[i, j, k + 1] - values[i, j, k])
    b = values[i, j + 1, k] + w * (values[i, j + 1, k + 1] - values[i, j + 1, k])
    c = values[i + 1, j, k] + w * (values[i + 1, j, k + 1] - values[i + 1, j, k])
    d = values[i + 1, j + 1, k] + w * (values[i + 1, j + 1, k + 1] - values[i + 1, j + 1, k])
    a += v * (b - a)
    c += v * (d - c)
    distance: float = a + u * (c - a) - INTERPOLATION_ERROR * resolution
    return distance


@kernel(nogil=True)
def _distances(values: Float32, origin: Float64, resolution: float, points: Float64) -> Float64:
    """`lookup` at points of shape (n, 3)."""
    distances = np.empty(points.shape[0])
    for i in range(points.shape[0]):
        distances[i] = lookup(values, origin, resolution, points[i, 0], points[i, 1], points[i, 2])
    return distances


@kernel(nogil=True)
def _lower_envelope(
    f: Float32, limit: float, vertex: NDArray[np.int64], cut: Float64, out: Float32
) -> None:
    """out[i] = min over j of f[j] + (i - j)², capped at limit (Felzenszwalb and Huttenlocher 2012)."""
    n = f.shape[0]
    k = -1
    for j in range(n):
        if f[j] >= limit:
            continue
        crossing = -1e18
        while k >= 0:
            crossing = (f[j] + j * j - f[vertex[k]] - vertex[k] * vertex[k]) / (
                2.0 * (j - vertex[k])
            )
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


@kernel(nogil=True)
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
