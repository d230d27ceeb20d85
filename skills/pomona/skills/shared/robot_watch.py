"""View of the robot: its shape once, then the poses of its moving parts."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, ClassVar

import numpy as np

from pomona.drivers.interfaces import Arm, Gripper
from pomona.executive.values.arrays import Float64
from pomona.executive.views import BodiesView, Mesh3, PosesView
from pomona.skills.motion.robot.model import RobotModel
from pomona.skills.motion.robot.solids import solid

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
            vertices, faces, start = [np.empty((0, 3))], [np.empty((0, 3), np.int32)], 0
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
        slides = np.array([part.slide for part, _geoms in self._parts]) * (width - self._robot.width_min)
        p_base = T[:, :3, 3] + np.einsum("nij,nj->ni", T[:, :3, :3], slides)
        poses = np.column_stack((p_base, Rotation.from_matrix(T[:, :3, :3]).as_quat()))
        return PosesView(np.round(poses, 5), np.round(self._robot.tcp(q)[:3, 3], 5))
