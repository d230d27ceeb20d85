"""Convex obstacles as sets of planes: boxes and cylinders of the cell, the fruit, anything given by points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from pomona.drivers.interfaces import Box, Hull
from pomona.executive.values.arrays import Float64
from pomona.skills.motion.collision.cover import fibonacci_sphere
from pomona.skills.perception.measured_fruit import MeasuredFruit

_CUBE = np.array([[x, y, z] for x in (-1.0, 0.0, 1.0) for y in (-1.0, 0.0, 1.0) for z in (-1.0, 0.0, 1.0)])
_CUBE_DIRECTIONS = np.delete(_CUBE, 13, axis=0) / np.linalg.norm(np.delete(_CUBE, 13, axis=0), axis=1, keepdims=True)
_RIM_DIRECTIONS = 24
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
        return Convex(name, np.column_stack((normals, (corners @ normals.T).max(axis=0))), np.append(centre, radius))

    @staticmethod
    def of_box(box: Box) -> Convex:
        """Return a box of the cell: its faces, and planes along its edges and corners."""
        corners = _CUBE[np.abs(_CUBE).sum(axis=1) == 3.0] * box.half_extents
        R, p = box.T_base_box[:3, :3], box.T_base_box[:3, 3]
        return Convex.of_points(box.name, corners @ R.T + p, _CUBE_DIRECTIONS @ R.T)

    @staticmethod
    def of_cylinder(name: str, T_base_cylinder: Float64, radius: float, length: float) -> Convex:
        """Return a cylinder about its z axis, centred in its frame [m]."""
        angles = np.arange(_RIM_DIRECTIONS) * 2.0 * np.pi / _RIM_DIRECTIONS
        ring = np.stack((np.cos(angles), np.sin(angles), np.zeros(_RIM_DIRECTIONS)), axis=1)
        rim = ring * radius / np.cos(np.pi / _RIM_DIRECTIONS)
        up = np.array([0.0, 0.0, 1.0])
        slanted = np.vstack((ring + up, ring - up)) / np.sqrt(2.0)
        corners = np.vstack((rim + up * length / 2.0, rim - up * length / 2.0))
        R, p = T_base_cylinder[:3, :3], T_base_cylinder[:3, 3]
        return Convex.of_points(name, corners @ R.T + p, np.vstack((ring, slanted, up[None], -up[None])) @ R.T)

    @staticmethod
    def of_fruit(measured: MeasuredFruit, name: str = "target") -> Convex:
        """Return a measured fruit: the hull of its refined shape."""
        return Convex.of_points(name, fruit_points(measured))

    @staticmethod
    def of_hull(hull: Hull) -> Convex:
        """Return a part of a mesh: its own faces, and planes all around."""
        return Convex.of_points(hull.name, hull.points, np.vstack((hull.normals, _CUBE_DIRECTIONS, _ROUND)))

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
