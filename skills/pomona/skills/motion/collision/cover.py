"""Spheres that cover a convex collision shape, so that a free cover proves a free shape.

Boxes are tiled, capsules strung along their segment. Cylinders, ellipsoids and hulls of meshes are cut into cells;
spheres inside are chosen greedily until each cell lies wholly in one of them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float64
from pomona.skills.motion.robot import Geom

Depth = Callable[[Float64], Float64]

BOX_CORNERS = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
_CELLS = 1500
_HALVINGS = 3
_RIM = 16


@dataclass(frozen=True, slots=True, eq=False)
class Cover:
    """Spheres and support points of one shape, in its own frame."""

    spheres: Float64  # centres and radii whose union covers the shape, shape (n, 4) [m]
    inner: Float64  # radii about the same centres within the shape, shape (n,) [m]; 0 for a centre outside
    # points, shape (k, 3), and `rounding` [m], of all or of each: the hull of the points grown by it contains the
    # shape; for exact distances to planes
    support: Float64
    rounding: float | Float64


def cover(geom: Geom) -> Cover:
    """Cover one collision shape; spheres protrude by at most 2 mm (thin parts) to 8 mm (thick ones)."""
    size = geom.size
    if geom.kind == "sphere":
        return Cover(
            np.array([[0.0, 0.0, 0.0, size[0]]]),
            np.array([size[0]]),
            np.zeros((1, 3)),
            float(size[0]),
        )
    if geom.kind == "capsule":
        return _cover_capsule(float(size[0]), float(size[1]))
    if geom.kind == "box":
        return _cover_box(size[:3])
    if geom.kind == "cylinder":
        return _cover_cylinder(float(size[0]), float(size[1]))
    if geom.kind == "ellipsoid":
        directions = fibonacci_sphere(200)
        directions /= 0.99 * np.min(
            np.max(directions @ fibonacci_sphere(2000).T, axis=0)
        )  # around the unit ball

        def ellipsoid_depth(p: Float64) -> Float64:
            deep: Float64 = (1.0 - np.linalg.norm(p / size[:3], axis=1)) * size[:3].min()
            return deep

        spheres = _cover_in_slices(size[:3], np.zeros(3), ellipsoid_depth)
        return _cover_of(spheres, ellipsoid_depth, directions * size[:3])
    return cover_points(geom.vertices)


def cover_points(points: Float64) -> Cover:
    """Cover the convex hull of points, shape (n, 3) [m]."""
    from scipy.spatial import ConvexHull

    hull = ConvexHull(points)
    normals = hull.equations[:, :3]
    offsets = hull.equations[:, 3]
    corners = points[hull.vertices]
    lower = corners.min(axis=0)
    upper = corners.max(axis=0)

    def depth(p: Float64) -> Float64:
        deep: Float64 = -np.max(p @ normals.T + offsets, axis=1)
        return deep

    return _cover_of(
        _cover_in_slices((upper - lower) / 2.0, (upper + lower) / 2.0, depth), depth, corners
    )


def fibonacci_sphere(count: int) -> Float64:
    """Unit vectors spread evenly, shape (count, 3)."""
    z = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    turn = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(count)
    ring = np.sqrt(1.0 - z * z)
    return np.stack((ring * np.cos(turn), ring * np.sin(turn), z), axis=1)


def _protrusion(thickness: float) -> float:
    """How far spheres may stand out of a shape with this smallest half-extent [m]."""
    return min(max(0.4 * thickness, 2e-3), 8e-3)


def _cover_capsule(radius: float, half: float) -> Cover:
    grown = radius + min(_protrusion(radius), 0.1 * radius)
    reach = np.sqrt(grown**2 - radius**2)  # along the segment, to either side of a centre
    count = int(np.ceil(half / reach)) + 1
    z = np.linspace(-half, half, count)
    covering = np.hypot(radius, half / (count - 1)) if half > 0.0 else radius
    spheres = np.stack((np.zeros(count), np.zeros(count), z, np.full(count, covering)), axis=1)
    return Cover(
        spheres, np.full(count, radius), np.array([[0.0, 0.0, half], [0.0, 0.0, -half]]), radius
    )


def _cover_box(half: Float64) -> Cover:
    tile = _protrusion(float(half.min())) / (
        np.sqrt(3.0) - 1.0
    )  # half-edge of a cube whose sphere protrudes by this distance
    counts = np.ceil(half / tile).astype(int)
    centres = _middles(half, counts)
    radius = float(np.linalg.norm(half / counts))
    spheres = np.column_stack((centres, np.full(len(centres), radius)))
    return Cover(spheres, (half - np.abs(centres)).min(axis=1), BOX_CORNERS * half, 0.0)


def _cover_cylinder(radius: float, half: float) -> Cover:
    """Return spheres on the axis where they stay between the flat ends, smaller ones towards the ends."""

    def depth(p: Float64) -> Float64:
        deep: Float64 = np.minimum(radius - np.hypot(p[:, 0], p[:, 1]), half - np.abs(p[:, 2]))
        return deep

    protrusion = _protrusion(radius)
    large = radius + protrusion
    reach = float(np.sqrt(large**2 - radius**2))  # along the axis, to either side of a centre
    last = half + protrusion - large  # the outermost centre whose sphere stays within the end
    spheres = []
    end = 0.0  # where the flat remainder begins
    if last > 0.0:
        z = np.linspace(-last, last, int(np.ceil(last / reach)) + 1)
        spheres.append(np.column_stack((np.zeros((len(z), 2)), z, np.full(len(z), large))))
        end = min(last + reach, half)
    slab = np.array([radius, radius, (half - end) / 2.0])
    if end == 0.0:
        spheres.append(_cover_greedily(np.array([radius, radius, half]), np.zeros(3), depth))
    elif end < half:
        top = _cover_greedily(slab, np.array([0.0, 0.0, (half + end) / 2.0]), depth)
        spheres += [top, top * (1.0, 1.0, -1.0, 1.0)]
    angles = np.arange(_RIM) * 2.0 * np.pi / _RIM
    rim = radius / np.cos(np.pi / _RIM)  # of the prism around the cylinder
    ring = np.column_stack((rim * np.cos(angles), rim * np.sin(angles), np.full(_RIM, half)))
    return _cover_of(np.vstack(spheres), depth, np.vstack((ring, ring * (1.0, 1.0, -1.0))))


def _cover_in_slices(half: Float64, centre: Float64, depth: Depth) -> Float64:
    """Cover a convex shape inside a box, cut across its longest side into slices that are about as long as wide."""
    longest = int(np.argmax(half))
    count = int(np.ceil(half[longest] / np.sort(half)[1] - 0.2))
    slab = half.copy()
    slab[longest] = half[longest] / count
    slices = []
    for number in range(count):
        middle = centre.copy()
        middle[longest] += (2 * number + 1 - count) * slab[longest]
        slices.append(_cover_greedily(slab, middle, depth))
    return np.vstack(slices)


def _cover_of(spheres: Float64, depth: Depth, support: Float64) -> Cover:
    return Cover(spheres, np.maximum(depth(spheres[:, :3]), 0.0), support, 0.0)


def _middles(half: Float64, counts: NDArray[np.int_]) -> Float64:
    """Return the middles of the parts, so many along each axis, of a box about the origin, shape (n, 3)."""
    axes = [(np.arange(n) + 0.5) * 2.0 * h / n - h for n, h in zip(counts, half, strict=True)]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def _cover_greedily(half: Float64, centre: Float64, depth: Depth) -> Float64:
    """Spheres, shape (n, 4), that cover the part of a convex shape that lies in a box; `depth` is below its surface.

    For points inside, `depth` may underestimate; for points outside, it is no further below zero than their distance.
    """
    edge = float(np.cbrt(np.prod(2.0 * half) / _CELLS))
    counts = np.ceil(2.0 * half / edge).astype(int)
    cell = half / counts  # half-extents of a cell
    cells = _middles(half, counts) + centre
    deep = depth(cells)
    candidates = cells[deep >= 0.0]
    radii = deep[deep >= 0.0] + max(min(0.6 * float(half.min()), 12e-3), 3.0 * float(cell.max()))
    chosen: list[int] = []

    def uncovered() -> Float64:
        inside = cells[depth(cells) > -np.linalg.norm(cell)]
        return inside[~_holds(inside, cell, candidates[chosen], radii[chosen]).any(axis=1)]

    for _ in range(_HALVINGS):
        cells = uncovered()
        holds = _holds(cells, cell, candidates, radii)
        left = np.ones(len(cells), dtype=bool)
        gains = holds.sum(axis=0)
        while gains.any():
            chosen.append(int(np.argmax(gains)))
            newly = left & holds[:, chosen[-1]]
            left &= ~newly
            gains -= holds[newly].sum(axis=0)
        cell = cell / 2.0
        cells = (cells[left][:, None] + BOX_CORNERS * cell).reshape(-1, 3)
    cells = uncovered()
    return np.vstack(
        (
            np.column_stack((candidates[chosen], radii[chosen])),
            np.column_stack((cells, np.full(len(cells), np.linalg.norm(cell)))),
        )
    )


def _holds(cells: Float64, cell: Float64, centres: Float64, radii: Float64) -> NDArray[np.bool_]:
    """Which spheres hold which cells whole, corners included, shape (cells, spheres)."""
    farthest_corner = np.linalg.norm(np.abs(cells[:, None] - centres[None]) + cell, axis=2)
    held: NDArray[np.bool_] = farthest_corner <= radii[None]
    return held
