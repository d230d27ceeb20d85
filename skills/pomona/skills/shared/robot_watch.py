"""View of the robot: its shape once, as triangles, then the poses of its moving parts."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, ClassVar

import numpy as np

from pomona.drivers.interfaces import Arm, Gripper
from pomona.executive.values.arrays import Float64, Int32
from pomona.executive.views import BodiesView, Mesh3, PosesView
from pomona.skills.motion.collision.cover import BOX_CORNERS
from pomona.skills.motion.robot.description import Geom
from pomona.skills.motion.robot.model import RobotModel

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
        return BOX_CORNERS * size[:3]
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


TOPIC = "robot"


class RobotWatch:
    """Shows the arm and its gripper, as their one description has them."""

    devices: ClassVar[tuple[type, ...]] = (Arm, Gripper)

    def __init__(self, device: Callable[[type], Any]) -> None:
        self._arm, self._gripper = device(Arm), device(Gripper)
        self._robot = RobotModel.load(self._arm.description)
        self._parts = [
            (part, [geom for geom in self._robot.geoms if geom.body == number])
            for number, part in enumerate(self._robot.bodies)
        ]
        self._shown: Float64 | None = None
        # Made, and compiled, before the run: its first tick must not wait for it.
        self._shape = self._bodies()
        self._poses(np.zeros(self._robot.dof), 0.0)

    def look(self) -> Iterator[tuple[str, object]]:
        """Yield the shape at the first look; poses whenever something has moved."""
        if self._shown is None:
            yield TOPIC, self._shape
        now = np.append(self._arm.state().q, self._gripper.state().width)
        # motion below which a part has not moved since the last picture [rad, m]
        if self._shown is not None and np.abs(now - self._shown).max() < 1e-4:
            return
        self._shown = now
        yield TOPIC, self._poses(now[:-1], float(now[-1]))

    def _bodies(self) -> BodiesView:
        bodies = []
        for part, geoms in self._parts:
            vertices = [np.empty((0, 3))]
            faces = [np.empty((0, 3), np.int32)]
            start = 0
            for points, triangles in map(solid, geoms):
                vertices.append(points)
                faces.append(triangles + start)
                start += len(points)
            style = "robot" if part.group == "arm" else "tool"
            corners: Float64 = np.vstack(vertices).round(4)
            bodies.append(Mesh3(corners, np.vstack(faces).astype(np.int32), part.name, style))
        return BodiesView(tuple(bodies))

    def _poses(self, q: Float64, width: float) -> PosesView:
        from scipy.spatial.transform import Rotation

        links = self._robot.link_poses(q)
        T = np.array([links[part.link] for part, _geoms in self._parts])
        slides = np.array([part.slide for part, _geoms in self._parts]) * (
            width - self._robot.width_min
        )
        p_base = T[:, :3, 3] + np.einsum("nij,nj->ni", T[:, :3, :3], slides)
        poses = np.column_stack((p_base, Rotation.from_matrix(T[:, :3, :3]).as_quat()))
        return PosesView(np.round(poses, 5), np.round(self._robot.tcp(q)[:3, 3], 5))
