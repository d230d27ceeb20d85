"""Which fruit a robot could grasp at all: ground truth by the engine's own kinematics and collisions."""

from __future__ import annotations

from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from pomona.drivers.orchard.model import WallModel
from pomona.drivers.sim.gl import load_mujoco
from pomona.drivers.sim.robot import FINGERS, read_robot
from pomona.executive.values.arrays import Float64

AZIMUTHS, ELEVATIONS = (0.0, 30.0, -30.0, 60.0, -60.0), (0.0, 30.0, -30.0, 60.0)
"""Of the approach, from straight towards the wall; positive elevations come from below [deg]."""
ROLLS = (0.0, 90.0, 45.0, -45.0)
"""Of the hand about the approach; 0 closes the fingers from the sides [deg]."""
BEFORE = 0.08
"""The hand must also stand free so far before the grasp [m]."""
ITERATIONS, CLOSE = 40, 1e-3
STARTS = ((-1.57, -0.3, 0.0, -0.6, 0.0, -0.7, 0.0), (-1.57, 0.6, 0.0, 0.6, 0.0, 0.3, 1.57))
"""Joints from which the search begins, as far as the arm has so many [rad]."""


def find_reachable(built: WallModel, robot: Path) -> tuple[bool, ...]:
    """For each fruit where it hangs at rest: whether a grasp without collision exists. Leaves may be pushed.

    A grasp is tried from 20 directions with 4 turns of the hand each; the hand must be free at the fruit with open
    fingers and `BEFORE` it. What is not found is called unreachable, so the count is a lower bound.
    """
    search = GraspSearch(built, robot)
    return tuple(search.reaches(i) for i in range(len(built.fruit_bodies)))


class GraspSearch:
    """Grasps of one wall by one robot."""

    def __init__(self, built: WallModel, robot: Path) -> None:
        self._mujoco = load_mujoco()
        self._arm = read_robot(robot).compile()
        self._arm_data = self._mujoco.MjData(self._arm)
        joints = [
            self._arm.actuator_trnid[a, 0] for a in range(self._arm.nu) if self._arm.actuator(a).name != "gripper"
        ]
        self._q = self._arm.jnt_qposadr[joints]
        self._range = self._arm.jnt_range[joints]
        self._tcp = self._arm.site("tcp").id
        names = [self._arm.joint(j).name for j in joints]
        self._built, self._model = built, built.model
        self._data = self._mujoco.MjData(self._model)
        self._full = np.array([int(self._model.joint(name).qposadr[0]) for name in names])
        for finger in FINGERS:
            self._data.joint(finger).qpos[0] = self._model.joint(finger).range[1]
        self._leafy = np.array([self._model.geom(g).name.startswith("leaf_") for g in range(self._model.ngeom)])

    def reaches(self, fruit: int) -> bool:
        """Whether a grasp of this fruit, and the way to it from `BEFORE`, is free of all but leaves."""
        p = self._built.wall.fruits[fruit].T_base_fruit[:3, 3]
        for elevation, azimuth, roll in product(ELEVATIONS, AZIMUTHS, ROLLS):
            T = grasp_pose(p, np.radians(azimuth), np.radians(elevation), np.radians(roll))
            q = self.solve(T)
            if q is None or not self._free(q):
                continue
            T[:3, 3] -= BEFORE * T[:3, 2]
            q = self.solve(T, q)
            if q is not None and self._free(q):
                return True
        return False

    def solve(self, T: Float64, near: Float64 | None = None) -> Float64 | None:
        """Joints, shape (dof,) [rad], for a pose T_base_tcp, shape (4, 4), within the limits, or None."""
        starts = [near] if near is not None else [np.array(s[: len(self._q)]) for s in STARTS]
        return next((q for start in starts if (q := self._descend(T, start)) is not None), None)

    def _descend(self, T: Float64, q: Float64) -> Float64 | None:
        """Damped least squares."""
        model, data = self._arm, self._arm_data
        jacobian = np.zeros((6, model.nv))
        q = np.resize(q, len(self._q)).astype(np.float64)
        for step in range(ITERATIONS):
            data.qpos[self._q] = q
            self._mujoco.mj_kinematics(model, data)
            self._mujoco.mj_comPos(model, data)
            R = data.site_xmat[self._tcp].reshape(3, 3)
            turn = 0.5 * sum((np.cross(R[:, k], T[:3, k]) for k in range(3)), start=np.zeros(3))
            error = np.concatenate([T[:3, 3] - data.site_xpos[self._tcp], turn])
            size = float(np.abs(error).max())
            if size < CLOSE and np.trace(R.T @ T[:3, :3]) > 2.9:
                return q
            if step > 20 and size > 0.15:
                return None
            self._mujoco.mj_jacSite(model, data, jacobian[:3], jacobian[3:], self._tcp)
            J = jacobian[:, : len(q)]
            q = q + J.T @ np.linalg.solve(J @ J.T + 1e-4 * np.eye(6), error)
            q = np.clip(q, self._range[:, 0], self._range[:, 1])
        return None

    def _free(self, q: Float64) -> bool:
        """Whether the robot with open fingers touches nothing but leaves, itself included."""
        self._data.qpos[self._full] = q
        self._mujoco.mj_kinematics(self._model, self._data)
        self._mujoco.mj_collision(self._model, self._data)
        contact: Any = self._data.contact
        pairs, deep = contact.geom, contact.dist < 0.0
        ours = self._built.robotic[pairs].any(axis=1) & ~self._leafy[pairs].any(axis=1)
        return not bool((ours & deep).any())


def grasp_pose(p: Float64, azimuth: float, elevation: float, roll: float) -> Float64:
    """T_base_tcp, shape (4, 4), at a point, shape (3,) [m]: approach z towards the wall (-y), fingers along y [rad]."""
    z = np.array([np.sin(azimuth) * np.cos(elevation), -np.cos(azimuth) * np.cos(elevation), np.sin(elevation)])
    side = np.cross(z, [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side)
    y = np.cos(roll) * side + np.sin(roll) * np.cross(z, side)
    T = np.eye(4)
    T[:3, :3] = np.stack([np.cross(y, z), y, z], axis=1)
    T[:3, 3] = p
    return T
