"""Fruit that a robot could grasp and roll off: ground truth by the engine's own kinematics and collisions."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from pomona.applications.harvest.model import WallModel
from pomona.executive import Float64
from pomona.tools.simulation import FINGERS, PADS, load_mujoco, read_robot

AZIMUTHS, ELEVATIONS = (0.0, 25.0, -25.0, 50.0, -50.0), (0.0, 25.0, -20.0, 45.0)
"""Of the approach, from straight towards the wall; positive elevations come from below [deg]."""
ROLLS = (
    0.0,
    25.0,
    -25.0,
    50.0,
    -50.0,
    90.0,
)  # of the hand about the approach [deg]; 0 closes from the sides
BEFORE = 0.08  # the hand must also stand free so far before the grasp [m]
SPARE = (
    0.02  # opening of the fingers beyond the fruit's diameter [m]: wide open they touch neighbours
)
ROLLED, OUT, STEPS = 75.0, 0.06 * np.array([0.0, 0.94, 0.34]), 4
"""Motion that breaks a stem: roll about the approach [deg], shift in the base frame [m], and steps that are checked."""
ITERATIONS, CLOSE = 40, 1e-3
STARTS = ((-1.57, -0.3, 0.0, -0.6, 0.0, -0.7, 0.0), (-1.57, 0.6, 0.0, 0.6, 0.0, 0.3, 1.57))
"""Joints from which the search begins, shortened to the arm's number [rad]; `BRANCHES` in all, the rest drawn."""
BRANCHES, TURNS, TURN = 6, 8, 0.25
"""Branches of the inverse kinematics, and steps of the elbow to each side of each, so far in joint space [rad]."""


def find_reachable(built: WallModel, robot: Path) -> tuple[bool, ...]:
    """Return for each fruit at rest whether a grasp and the motion that rolls it off exist. Leaves may be pushed.

    A grasp is tried from 20 directions with 6 turns of the hand. The hand must be free at the fruit, with its fingers
    `SPARE` wider than the fruit, `BEFORE` it, and during the motion. A fruit without a found grasp counts as
    unreachable, so the count is a lower bound.
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
            self._arm.actuator_trnid[a, 0]
            for a in range(self._arm.nu)
            if self._arm.actuator(a).name != "gripper"
        ]
        self._q = self._arm.jnt_qposadr[joints]
        self._range = self._arm.jnt_range[joints]
        self._tcp = self._arm.site("tcp").id
        names = [self._arm.joint(j).name for j in joints]
        self._built, self._model = built, built.model
        self._data = self._mujoco.MjData(self._model)
        self._full = np.array([int(self._model.joint(name).qposadr[0]) for name in names])
        self._leafy = np.array(
            [self._model.geom(g).name.startswith("leaf_") for g in range(self._model.ngeom)]
        )
        self._geoms = np.arange(self._model.ngeom)
        tool = self._model.body("tool0").id
        below = [b for b in range(self._model.nbody) if tool in _ancestors(self._model, b)]
        self._handy = np.isin(self._model.geom_bodyid, below)
        data = self._data
        self._hand = (
            (data.xpos, data.xmat, below),
            (data.xipos, data.ximat, below),
            (data.geom_xpos, data.geom_xmat, np.flatnonzero(self._handy)),
        )
        self._mujoco.mj_kinematics(self._model, data)
        self._closed = float(np.linalg.norm(data.site(PADS[0]).xpos - data.site(PADS[1]).xpos))
        low, high = self._range.T
        drawn = np.random.default_rng(0).uniform(low, high, (BRANCHES - len(STARTS), len(joints)))
        self._starts = [*(np.array(s[: len(joints)]) for s in STARTS), *drawn]

    def reaches(self, fruit: int) -> bool:
        """Return True if a grasp of this fruit and the motion to the rolled hand are free of all but leaves."""
        return any(self._rolls(fruit, T, q) for T, q in self.grasps(fruit))

    def grasps(self, fruit: int) -> Iterator[tuple[Float64, Float64]]:
        """Yield free grasps of a fruit: T_base_tcp, shape (4, 4), and joints, shape (dof,) [rad]."""
        hung = self._built.wall.fruits[fruit]
        self._preset(2.0 * hung.radius + SPARE)
        for elevation, azimuth, roll in product(ELEVATIONS, AZIMUTHS, ROLLS):
            T = grasp_pose(
                hung.T_base_fruit[:3, 3],
                np.radians(azimuth),
                np.radians(elevation),
                np.radians(roll),
            )
            before = T.copy()
            before[:3, 3] -= BEFORE * T[:3, 2]
            if not (self._hand_free(T) and self._hand_free(before)):
                continue
            for q in self.solutions(T):
                if not self._free(q):
                    continue
                q_before = self.solve(before, q)
                if q_before is not None and self._free(q_before):
                    yield T, q

    def _rolls(self, fruit: int, T: Float64, q_grasp: Float64) -> bool:
        """Return True if the fruit can be rolled off one way or the other; it moves with the hand."""
        for way in (1.0, -1.0):
            q: Float64 | None = q_grasp
            for pose in rolled_poses(T, way):
                q = self.solve(pose, q)
                if q is None or not self._free(q, fruit):
                    break
            else:
                return True
        return False

    def solutions(self, T: Float64) -> Iterator[Float64]:
        """Yield joints, shape (dof,) [rad], for a pose T_base_tcp, shape (4, 4), with the elbow in many places."""
        found: list[Float64] = []
        for start in self._starts:
            q = self._descend(T, start)
            if q is None or any(np.abs(q - other).max() < TURN / 2.0 for other in found):
                continue
            found.append(q)
            yield q
            for side in (1.0, -1.0) if len(q) > 6 else ():
                turned, along = q, None
                for _ in range(TURNS):
                    free = self._null_direction(turned)
                    free *= side if along is None else np.sign(free @ along)
                    along = free
                    step = self._descend(T, turned + TURN * free)
                    if step is None:
                        break
                    turned = step
                    found.append(turned)
                    yield turned

    def solve(self, T: Float64, near: Float64 | None = None) -> Float64 | None:
        """Return joints within the limits, shape (dof,) [rad], for a pose T_base_tcp, shape (4, 4), or None."""
        starts = [near] if near is not None else self._starts
        return next((q for start in starts if (q := self._descend(T, start)) is not None), None)

    def _null_direction(self, q: Float64) -> Float64:
        """Unit joint velocity, shape (dof,), that leaves the tool where it is."""
        jacobian = np.zeros((6, self._arm.nv))
        self._arm_data.qpos[self._q] = q
        self._mujoco.mj_kinematics(self._arm, self._arm_data)
        self._mujoco.mj_comPos(self._arm, self._arm_data)
        self._mujoco.mj_jacSite(self._arm, self._arm_data, jacobian[:3], jacobian[3:], self._tcp)
        direction: Float64 = np.linalg.svd(jacobian[:, : len(q)])[2][-1]
        return direction

    def _preset(self, opening: float) -> None:
        """Open the fingers, as far as they go [m]: a gripper that rests has narrowed its joints in the wall's model."""
        for finger in FINGERS:
            low, high = self._arm.joint(finger).range
            self._data.joint(finger).qpos[0] = np.clip((opening - self._closed) / 2.0, low, high)
        self._mujoco.mj_kinematics(self._model, self._data)
        T_tcp_base = np.linalg.inv(
            _frames(self._data.site("tcp").xpos, self._data.site("tcp").xmat)
        )
        self._hand_poses = [T_tcp_base @ _frames(p[of], R[of]) for p, R, of in self._hand]

    def _hand_free(self, T: Float64) -> bool:
        """Return True if the hand alone, with its TCP at a pose (4, 4), touches nothing but leaves."""
        for (positions, turns, of), poses in zip(self._hand, self._hand_poses, strict=True):
            placed = T @ poses
            positions[of], turns[of] = placed[:, :3, 3], placed[:, :3, :3].reshape(-1, 9)
        self._mujoco.mj_collision(self._model, self._data)
        contact: Any = self._data.contact
        pairs, deep = contact.geom, contact.dist < 0.0
        ours = self._handy[pairs].any(axis=1) & ~(self._leafy | self._built.robotic & ~self._handy)[
            pairs
        ].any(axis=1)
        return not bool((ours & deep).any())

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

    def _free(self, q: Float64, held: int | None = None) -> bool:
        """Return True if the robot touches nothing but leaves and the held fruit, itself included."""
        self._data.qpos[self._full] = q
        self._mujoco.mj_kinematics(self._model, self._data)
        self._mujoco.mj_collision(self._model, self._data)
        contact: Any = self._data.contact
        pairs, deep = contact.geom, contact.dist < 0.0
        passed = (
            self._leafy
            if held is None
            else self._leafy | (self._geoms == self._built.fruit_geoms[held])
        )
        ours = self._built.robotic[pairs].any(axis=1) & ~passed[pairs].any(axis=1)
        return not bool((ours & deep).any())


def rolled_poses(T: Float64, way: float) -> Iterator[Float64]:
    """Yield T_base_tcp, shape (4, 4), along the motion that rolls a fruit off.

    Args:
        T: the grasp's T_base_tcp.
        way: 1 turns counterclockwise about the approach, -1 clockwise.
    """
    for share in np.linspace(0.0, 1.0, STEPS + 1)[1:]:
        c, s = np.cos(share * np.radians(ROLLED)), way * np.sin(share * np.radians(ROLLED))
        pose = T.copy()
        pose[:3, :3] = T[:3, :3] @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        pose[:3, 3] += share * OUT
        yield pose


def _frames(positions: Float64, turns: Float64) -> Float64:
    """Return poses (…, 4, 4) from positions (…, 3) and rotations (…, 9)."""
    T = np.zeros((*positions.shape[:-1], 4, 4))
    T[..., :3, :3], T[..., :3, 3], T[..., 3, 3] = (
        turns.reshape(*positions.shape[:-1], 3, 3),
        positions,
        1.0,
    )
    return T


def _ancestors(model: Any, body: int) -> set[int]:
    """Return a body and all that carry it."""
    found = {body}
    while body:
        body = int(model.body_parentid[body])
        found.add(body)
    return found


def grasp_pose(p: Float64, azimuth: float, elevation: float, roll: float) -> Float64:
    """T_base_tcp, shape (4, 4), at a point, shape (3,) [m]: approach z towards the wall (-y), fingers along y [rad]."""
    z = np.array(
        [
            np.sin(azimuth) * np.cos(elevation),
            -np.cos(azimuth) * np.cos(elevation),
            np.sin(elevation),
        ]
    )
    side = np.cross(z, [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side)
    y = np.cos(roll) * side + np.sin(roll) * np.cross(z, side)
    T = np.eye(4)
    T[:3, :3] = np.stack([np.cross(y, z), y, z], axis=1)
    T[:3, 3] = p
    return T
