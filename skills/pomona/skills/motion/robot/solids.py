"""Triangles of a robot's collision shapes, for pictures."""

from __future__ import annotations

import numpy as np

from pomona.executive.values.arrays import Float64, Int32
from pomona.skills.motion.robot.description import Geom

AROUND = 16  # corners of a circle


def solid(geom: Geom) -> tuple[Float64, Int32]:
    """Return the surface of a shape in its link's frame: vertices, shape (n, 3) [m], and outward faces."""
    points = _points(geom)
    vertices, faces = hull(points)
    return vertices @ geom.T_link_geom[:3, :3].T + geom.T_link_geom[:3, 3], faces


def hull(points: Float64) -> tuple[Float64, Int32]:
    """Return the convex hull of points, shape (n, 3): its corners and its triangles, counter-clockwise from outside."""
    from scipy.spatial import ConvexHull

    found = ConvexHull(points)
    number = np.full(len(points), -1)
    number[found.vertices] = np.arange(len(found.vertices))
    faces = number[found.simplices]
    corners = points[found.vertices]
    a, b, c = (corners[faces[:, i]] for i in range(3))
    inwards = np.einsum("ij,ij->i", np.cross(b - a, c - a), found.equations[:, :3]) < 0.0
    faces[inwards] = faces[inwards][:, ::-1]
    return corners, faces.astype(np.int32)


def _points(geom: Geom) -> Float64:
    size = geom.size
    if geom.kind == "mesh":
        return geom.vertices
    if geom.kind == "box":
        corners = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
        return corners * size[:3]
    if geom.kind == "cylinder":
        return np.vstack([_ring(float(size[0]), z) for z in (-float(size[1]), float(size[1]))])
    if geom.kind == "ellipsoid":
        return _ball(0.0) * size[:3]
    straight = float(size[1]) if geom.kind == "capsule" else 0.0
    return _ball(straight / float(size[0])) * float(size[0])


def _ball(straight: float) -> Float64:
    """Return points on a ball of radius 1 with its halves moved apart along z."""
    angles = np.radians([0.0, 30.0, 60.0])
    upper = [_ring(float(np.cos(a)), float(np.sin(a)) + straight) for a in angles] + [
        np.array([[0, 0, 1.0 + straight]])
    ]
    half = np.vstack(upper)
    return np.vstack((half, half * (1.0, 1.0, -1.0)))


def _ring(radius: float, z: float) -> Float64:
    angles = np.arange(AROUND) * (2.0 * np.pi / AROUND)
    return np.column_stack((radius * np.cos(angles), radius * np.sin(angles), np.full(AROUND, z)))
