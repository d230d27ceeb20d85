"""Straight lines of the tool: the joint path that tracks them, by compiled loops."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float64
from pomona.executive.values.numba_kernel import kernel
from pomona.skills.motion.robot import RobotModel
from pomona.skills.motion.robot.inverse_kinematics import newton_step
from pomona.skills.motion.robot.model import compose, forward, jacobian

# how tracking ended
REACHED = 0
OUT_OF_REACH = 1
JOINT_LIMIT = 2
JUMP = 3

_ROUNDS = 16
_PRECISION = 1e-10


@kernel(nogil=True)
def track_poses(
    steps: Float64,
    sliding: NDArray[np.bool_],
    T_last_tcp: Float64,
    lower: Float64,
    upper: Float64,
    q_start: Float64,
    poses: Float64,
    largest_step: float,
    path: Float64,
) -> tuple[int, int]:
    """Solve pose after pose by Newton steps of least joint motion, each from the solution before it.

    Args:
        steps, sliding: the chain, as in `pomona.skills.motion.robot.model.forward`.
        T_last_tcp: pose of the TCP in the last link, shape (3, 4).
        lower, upper: joint limits, shape (dof,).
        q_start: joints from which the first pose is sought, shape (dof,).
        poses: of the TCP in the base frame, shape (n, 3, 4).
        largest_step: of any joint from one pose to the next [rad].
        path: the result, shape (n, dof).

    Returns:
        how it ended, and the number of poses that were reached.
    """
    dof = q_start.shape[0]
    links = np.empty((dof + 1, 3, 4))
    T = np.empty((3, 4))
    J = np.empty((6, dof))
    error = np.empty(6)
    A = np.empty((6, 6))
    step = np.empty(dof)
    q = q_start.copy()
    q_before = np.empty(dof)
    for k in range(poses.shape[0]):
        for i in range(dof):
            q_before[i] = q[i]
        size = 1.0
        for _ in range(_ROUNDS):
            forward(steps, sliding, q, links)
            compose(links[dof], T_last_tcp, T)
            target = poses[k]
            for row in range(3):
                error[row] = target[row, 3] - T[row, 3]
                error[3 + row] = 0.0
            for column in range(
                3
            ):  # half the sum of the axes' cross products: the rotation vector, for small angles
                a0 = T[0, column]
                a1 = T[1, column]
                a2 = T[2, column]
                b0 = target[0, column]
                b1 = target[1, column]
                b2 = target[2, column]
                error[3] += 0.5 * (a1 * b2 - a2 * b1)
                error[4] += 0.5 * (a2 * b0 - a0 * b2)
                error[5] += 0.5 * (a0 * b1 - a1 * b0)
            size = np.abs(error).max()
            if size < _PRECISION:
                break
            jacobian(links, sliding, T[:, 3].copy(), J)
            newton_step(J, error, 1e-9, A, step)
            for i in range(dof):
                q[i] += step[i]
        if size > 1e-7:
            return OUT_OF_REACH, k
        for i in range(dof):
            if q[i] < lower[i] or q[i] > upper[i]:
                return JOINT_LIMIT, k
            if abs(q[i] - q_before[i]) > largest_step:
                return JUMP, k
            path[k, i] = q[i]
    return REACHED, poses.shape[0]


STEP = 4e-3  # distance between two poses on a line [m]
LARGEST_RATE = 25.0  # of any joint along a line [rad/m]; more is a jump to another configuration, or a singularity

_REASONS = {
    OUT_OF_REACH: "the arm does not reach further",
    JOINT_LIMIT: "a joint is at its limit",
    JUMP: "the arm would have to change its configuration",
}


@dataclass(frozen=True, slots=True, eq=False)
class StraightLine:
    """A straight line of the TCP."""

    q: Float64  # joints at equal steps from the start on, shape (n, dof) [rad]; only the part that can be followed
    length: float  # of the whole line [m]
    reached: float  # share of the line that can be followed, 0 to 1
    reason: str  # why it ends early; empty when it does not

    @property
    def complete(self) -> bool:
        """Whether the line reaches its end."""
        return not self.reason


def straight_line(
    robot: RobotModel, q_start: Float64, T_base_goal: Float64, step: float = STEP
) -> StraightLine:
    """Follow a straight line from joints q_start, (dof,) [rad], to a pose of the TCP, in one configuration of the arm.

    The joints are solved pose after pose, at most `step` [m] apart, by Newton steps of least joint motion (redundant
    arms included); the orientation turns evenly.
    """
    q_start = robot.checked(q_start)
    T_base_start = robot.tcp(q_start)
    offset = T_base_goal[:3, 3] - T_base_start[:3, 3]
    length = float(np.linalg.norm(offset))
    count = max(4, int(np.ceil(length / step)))
    shares = np.linspace(0.0, 1.0, count + 1)
    poses = np.empty((count + 1, 3, 4))
    poses[:, :, :3] = T_base_goal[:3, :3]
    if np.abs(T_base_start[:3, :3] - T_base_goal[:3, :3]).max() > 1e-9:
        from scipy.spatial.transform import (
            Rotation,
            Slerp,
        )  # SciPy takes 0.1 s of the processor to load

        turn = Slerp([0.0, 1.0], Rotation.from_matrix([T_base_start[:3, :3], T_base_goal[:3, :3]]))
        poses[:, :, :3] = turn(shares).as_matrix()
    poses[:, :, 3] = T_base_start[:3, 3] + shares[:, None] * offset
    q = np.empty((count + 1, robot.dof))
    largest_step = max(LARGEST_RATE * length / count, 0.05)
    T_last_tcp = np.ascontiguousarray(robot.T_link_tcp[:3])
    ended, solved = track_poses(
        robot.steps,
        robot.sliding,
        T_last_tcp,
        robot.lower,
        robot.upper,
        q_start,
        poses,
        largest_step,
        q,
    )
    if solved == 0:
        return StraightLine(
            q_start[None], length, 0.0, _REASONS.get(ended, "the line cannot be followed")
        )
    q[0] = q_start
    reason = "" if ended == REACHED else _REASONS[ended]
    return StraightLine(q[:solved], length, float(shares[solved - 1]), reason)
