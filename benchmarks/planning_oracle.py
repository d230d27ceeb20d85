"""MuJoCo's own collision detection as the judge of planned motions: the robot's own shapes among the true things."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from pomona.drivers.interfaces import Box
from pomona.executive.values.arrays import Float64
from pomona.skills.geometry import transform
from pomona.skills.motion.robot import RobotModel
from pomona.skills.perception.measured_fruit import MeasuredFruit

PENETRATION = 1e-6
"""MuJoCo's contacts are good to about this [m]."""


class PlanningOracle:
    """The robot file with a table, boxes and the hulls of fruit around it; shares no code with the planner's checks."""

    def __init__(
        self,
        robot: RobotModel,
        table_z: float,
        boxes: tuple[Box, ...],
        fruits: tuple[MeasuredFruit, ...],
    ) -> None:
        spec = mujoco.MjSpec.from_file(str(robot.path))
        table = Box("table", transform(None, [0.0, 0.0, table_z - 0.5]), (3.0, 3.0, 0.5))
        for box in (table, *boxes):
            self._add(
                spec,
                box.name,
                box.T_base_box,
                type=mujoco.mjtGeom.mjGEOM_BOX,
                size=box.half_extents,
            )
        for number, fruit in enumerate(fruits):
            scaled = fruit.fruit.vertices * (fruit.dimensions / fruit.fruit.dimensions)
            spec.add_mesh(name=f"fruit {number}", uservert=scaled.ravel())
            self._add(
                spec,
                f"fruit {number}",
                fruit.T_base_fruit,
                type=mujoco.mjtGeom.mjGEOM_MESH,
                meshname=f"fruit {number}",
            )
        self._robot = robot
        self._model: Any = spec.compile()
        self._state: Any = mujoco.MjData(self._model)
        self._model.geom_margin[:] = 0.0

    @staticmethod
    def _add(spec: Any, name: str, T: Float64, **shape: Any) -> None:
        quaternion = np.empty(4)
        mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(T[:3, :3]).ravel())
        spec.worldbody.add_geom(
            name=f"{name} geom", pos=T[:3, 3], quat=quaternion, contype=1, conaffinity=2, **shape
        )

    def contacts(self, q: Float64, width: float) -> list[tuple[str, str]]:
        """Names of the geoms that touch in a posture, for an opening of the gripper [m]."""
        for name, value in zip(self._robot.joint_names, q, strict=True):
            self._state.joint(name).qpos[0] = value
        for name in ("finger_left", "finger_right"):
            self._state.joint(name).qpos[0] = (width - self._robot.width_min) / 2.0
        mujoco.mj_kinematics(self._model, self._state)
        mujoco.mj_comPos(self._model, self._state)
        mujoco.mj_collision(self._model, self._state)
        contact = self._state.contact
        return [
            (self._model.geom(int(a)).name, self._model.geom(int(b)).name)
            for distance, (a, b) in zip(contact.dist, contact.geom, strict=True)
            if distance < -PENETRATION
        ]
