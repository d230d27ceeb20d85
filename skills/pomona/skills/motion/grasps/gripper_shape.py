"""The gripper's exact outline as a grasp needs it: how far the fingers reach below the TCP, how deep the palm is.

Collision checks use spheres that cover the links: too coarse where a finger passes millimetres above the table.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from pomona.executive.values.arrays import Float64
from pomona.skills.geometry import apply, inverse
from pomona.skills.motion.robot import Geom, RobotModel


@dataclass(frozen=True, slots=True, eq=False)
class GripperShape:
    """Outline of the fingers in the TCP frame, closed, and how they slide."""

    points: Float64  # corners of all finger geometry, shape (n, 3) [m]
    radii: Float64  # of a sphere around each corner (rounded shapes), shape (n,) [m]
    slides: Float64  # shift of each corner per metre of opening, shape (n, 3)
    bodies: tuple[str, ...]  # name of the body of each corner
    closed: float  # opening at which `points` holds [m]
    palm_depth: float  # distance from the TCP back to the palm [m]

    def lowest(self, T_base_tcp: Float64, width: float) -> tuple[float, str]:
        """Return the height of the fingers' lowest point in the base frame [m], and the body that it belongs to."""
        corners = self.points + (width - self.closed) * self.slides
        heights = apply(T_base_tcp, corners)[:, 2] - self.radii
        lowest = int(heights.argmin())
        return float(heights[lowest]), self.bodies[lowest]

    def first_touch(self, points_tcp: Float64, width: float, error: float) -> float:
        """Return the distance before the grasp at which a finger may touch a displaced object, >= 0 [m].

        Args:
            points_tcp: surface of the object in the TCP frame at the grasp, shape (n, 3) [m].
            width, error: opening on the way, and largest displacement of the object in any direction [m].
        """
        corners = self.points + (width - self.closed) * self.slides
        before = 0.0
        for body in set(self.bodies):
            own = np.array([name == body for name in self.bodies])
            around = self.radii[own, None] + error
            lower, upper = (corners[own] - around).min(axis=0), (corners[own] + around).max(axis=0)
            beside = ((points_tcp >= lower) & (points_tcp <= upper))[:, :2].all(axis=1)
            if beside.any():
                before = max(before, float(upper[2] - points_tcp[beside, 2].min()))
        return before


@lru_cache(maxsize=16)
def gripper_shape(robot: RobotModel) -> GripperShape:
    """Read the outline of fingers and palm from the robot's collision geometry; once for a model."""
    T_tcp_link = inverse(robot.T_link_tcp)
    points, radii, slides, names = [np.empty((0, 3))], [np.empty(0)], [np.empty((0, 3))], []
    palm = -np.inf
    for geom in robot.geoms:
        body = robot.bodies[geom.body]
        corners, radius = outline(geom)
        corners = apply(T_tcp_link @ geom.T_link_geom, corners)
        if body.group == "fingers":
            points.append(corners)
            radii.append(np.full(len(corners), radius))
            slides.append(np.tile(T_tcp_link[:3, :3] @ body.slide, (len(corners), 1)))
            names += [body.name] * len(corners)
        elif body.group == "gripper":
            palm = max(palm, float(corners[:, 2].max()) + radius)
    return GripperShape(
        np.vstack(points),
        np.concatenate(radii),
        np.vstack(slides),
        tuple(names),
        robot.width_min,
        -palm if np.isfinite(palm) else np.inf,
    )


def outline(geom: Geom) -> tuple[Float64, float]:
    """Return corners (n, 3) in the geom's frame and a radius: spheres at the corners whose hull holds the geom."""
    size = geom.size
    if geom.kind == "mesh":
        return geom.vertices, 0.0
    if geom.kind == "sphere":
        return np.zeros((1, 3)), float(size[0])
    if geom.kind == "capsule":
        return np.array([[0.0, 0.0, -size[1]], [0.0, 0.0, size[1]]]), float(size[0])
    if geom.kind == "cylinder":  # a regular polygon around the circle
        angle = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)
        around = size[0] / np.cos(np.pi / 16.0)
        ends = [(around * np.cos(a), around * np.sin(a), z) for z in (-size[1], size[1]) for a in angle]
        return np.array(ends), 0.0
    signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T  # a box, or around an ellipsoid
    corners: Float64 = signs * size[:3]
    return corners, 0.0
