"""The gripper's exact outline as a grasp needs it: how far the fingers reach below the TCP, how deep the palm is.

Collision checks use spheres that cover the links: too coarse where a finger passes millimetres above the table.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from pomona.executive.values.arrays import Float64
from pomona.executive.values.numba_kernel import kernel
from pomona.skills.geometry import apply, inverse
from pomona.skills.motion.robot import Geom, RobotModel
from pomona.skills.perception.measured_fruit import MeasuredFruit


@dataclass(frozen=True, slots=True, eq=False)
class GripperShape:
    """Outline of the fingers in the TCP frame, closed, and how they slide."""

    points: Float64  # corners of all finger geometry, shape (n, 3) [m]
    radii: Float64  # of a sphere around each corner (rounded shapes), shape (n,) [m]
    slides: Float64  # shift of each corner per metre of opening, shape (n, 3)
    bodies: tuple[str, ...]  # name of the body of each corner
    closed: float  # opening at which `points` holds [m]
    palm_depth: float  # distance from the TCP back to the palm [m]

    def forward(self, width: float) -> float:
        """Return the fingertips' shift along the approach since they were closed [m]: by a linkage, or 0."""
        return float((width - self.closed) * self.slides[:, 2].mean()) if len(self.slides) else 0.0

    def lowest(self, T_base_tcp: Float64, width: float) -> tuple[float, str]:
        """Return the height of the fingers' lowest point in the base frame [m], and the body that it belongs to."""
        corners = self.points + (width - self.closed) * self.slides
        heights = apply(T_base_tcp, corners)[:, 2] - self.radii
        lowest = int(heights.argmin())
        return float(heights[lowest]), self.bodies[lowest]

    def levels(self, points_tcp: Float64, width: float, error: float) -> Float64:
        """Return how far before the grasp a fingertip is level with each point, shape (n,) [m].

        It is -inf for points that no displacement brings below a finger.

        Args:
            points_tcp: places in the TCP frame at the grasp, shape (n, 3) [m].
            width, error: opening on the way, and largest displacement across the approach [m].
        """
        corners = self.points + (width - self.closed) * self.slides
        before = np.full(len(points_tcp), -np.inf)
        for body in set(self.bodies):
            own = np.array([name == body for name in self.bodies])
            around = self.radii[own, None]
            lower = (corners[own] - around).min(axis=0)
            upper = (corners[own] + around).max(axis=0)
            beside = (np.abs(points_tcp - (lower + upper) / 2.0) <= (upper - lower) / 2.0 + error)[
                :, :2
            ].all(axis=1)
            before[beside] = np.maximum(before[beside], upper[2] - points_tcp[beside, 2])
        return before

    def way_to(self, points_tcp: Float64, width: float, finger: str) -> Float64:
        """Return the shortest way from points, shape (n, 3) [m], to the left or right finger, (3,); 0 inside of it."""
        corners = self.points + (width - self.closed) * self.slides
        own = (corners[:, 1] > 0.0) == (finger == "left")
        around = self.radii[:, None]
        lower = (corners - around)[own].min(axis=0)
        upper = (corners + around)[own].max(axis=0)
        ways = np.clip(points_tcp, lower, upper) - points_tcp
        return np.asarray(ways[np.linalg.norm(ways, axis=1).argmin()], np.float64)


@lru_cache(maxsize=16)
def gripper_shape(robot: RobotModel) -> GripperShape:
    """Read the outline of fingers and palm from the robot's collision geometry; once for a model."""
    T_tcp_link = inverse(robot.T_link_tcp)
    points = [np.empty((0, 3))]
    radii = [np.empty(0)]
    slides = [np.empty((0, 3))]
    names = []
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
        ends = [
            (around * np.cos(a), around * np.sin(a), z) for z in (-size[1], size[1]) for a in angle
        ]
        return np.array(ends), 0.0
    # a box, or around an ellipsoid
    signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
    corners: Float64 = signs * size[:3]
    return corners, 0.0


@dataclass(frozen=True, slots=True, eq=False)
class CrossSection:
    """The refined shape as the fingers meet it."""

    width: float  # extent along the fingers' sliding direction [m]
    # where the pads meet: on the fruit's axis at the height of its widest section, midway between the two sides across
    # the sliding direction; base frame, shape (3,) [m]
    p_base: Float64
    # angle between the sliding direction and the skin's normal where the pads meet it [rad], of the ellipsoid with the
    # fruit's dimensions: pads that meet it obliquely turn the fruit
    oblique: float
    behind: (
        float  # how far the fruit reaches from `p_base` against the approach, towards the palm [m]
    )
    # sigma_width, sigma_across, sigma_height: standard deviations of the width, of the position along the sliding
    # direction and of the position's height in the base frame [m]
    sigma_width: float
    sigma_across: float
    sigma_height: float


def fruit_section(
    measured: MeasuredFruit, vertices_base: Float64, R_base_tcp: Float64
) -> CrossSection:
    """Measure a refined fruit along the TCP's axes R_base_tcp, shape (3, 3): z approach, y sliding.

    `vertices_base`, shape (n, 3) [m], is its refined shape, handed in because one shape serves many grasps.
    """
    widest = np.empty(3)
    # points within this distance of the outermost one belong to the widest section [m]
    low, high, top = extent(
        vertices_base, measured.T_base_fruit.copy()[:3, 3], R_base_tcp, 1e-3, widest
    )
    axis = R_base_tcp.T @ measured.T_base_fruit[:3, :3] @ measured.fruit.symmetry_axis
    centre = (
        widest @ axis
    ) * axis  # on the axis of the nearly round fruit: the load then has no lever on the pads
    centre[1] = (low + high) / 2.0
    sliding = R_base_tcp[:, 1]
    # the width is a mix of the three dimensions
    in_object = measured.T_base_fruit[:3, :3].T @ sliding
    half = measured.dimensions * in_object
    mix = half * in_object / max(float(np.linalg.norm(half)), 1e-9)
    # points from the ellipsoid's centre to where a pad meets it
    touched = measured.dimensions * half
    oblique = np.arctan2(np.linalg.norm(np.cross(in_object, touched)), in_object @ touched)
    position = measured.covariance[:3, :3]
    size = measured.covariance[3:, 3:]
    return CrossSection(
        width=high - low,
        p_base=measured.T_base_fruit[:3, 3] + R_base_tcp @ centre,
        oblique=float(oblique),
        behind=float(centre[2] - top),
        sigma_width=_deviation(size, mix),
        sigma_across=_deviation(position, sliding),
        sigma_height=_deviation(position, np.array([0.0, 0.0, 1.0])),
    )


@kernel(nogil=True)
def extent(
    vertices: Float64, centre: Float64, R_base_tcp: Float64, band: float, widest: Float64
) -> tuple[float, float, float]:
    """Lowest and highest y and lowest z of vertices about a centre along a gripper's axes [m].

    Writes the mean of the vertices within `band` of either end in y, in the gripper's axes, into `widest`.
    """
    y = np.empty(vertices.shape[0])
    low = 1e9
    high = -1e9
    top = 1e9
    for i in range(vertices.shape[0]):
        a = vertices[i, 0] - centre[0]
        b = vertices[i, 1] - centre[1]
        c = vertices[i, 2] - centre[2]
        y[i] = a * R_base_tcp[0, 1] + b * R_base_tcp[1, 1] + c * R_base_tcp[2, 1]
        low = min(low, y[i])
        high = max(high, y[i])
        top = min(top, a * R_base_tcp[0, 2] + b * R_base_tcp[1, 2] + c * R_base_tcp[2, 2])
    count = 0
    widest[:] = 0.0
    for i in range(vertices.shape[0]):
        if y[i] <= low + band or y[i] >= high - band:
            count += 1
            for k in range(3):
                for row in range(3):
                    widest[k] += (vertices[i, row] - centre[row]) * R_base_tcp[row, k]
    widest /= count
    return low, high, top


def _deviation(covariance: Float64, direction: Float64) -> float:
    return float(np.sqrt(max(direction @ covariance @ direction, 0.0)))
