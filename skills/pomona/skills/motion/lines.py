"""Straight lines of the tool as joint paths."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pomona.executive.values.arrays import Float64
from pomona.skills.motion.line_tracking import JOINT_LIMIT, JUMP, OUT_OF_REACH, REACHED, track_poses
from pomona.skills.motion.robot import RobotModel

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


def straight_line(robot: RobotModel, q_start: Float64, T_base_goal: Float64, step: float = STEP) -> StraightLine:
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
        from scipy.spatial.transform import Rotation, Slerp  # SciPy takes 0.1 s of the processor to load

        turn = Slerp([0.0, 1.0], Rotation.from_matrix([T_base_start[:3, :3], T_base_goal[:3, :3]]))
        poses[:, :, :3] = turn(shares).as_matrix()
    poses[:, :, 3] = T_base_start[:3, 3] + shares[:, None] * offset
    q = np.empty((count + 1, robot.dof))
    largest_step = max(LARGEST_RATE * length / count, 0.05)
    T_last_tcp = np.ascontiguousarray(robot.T_link_tcp[:3])
    ended, solved = track_poses(
        robot.steps, robot.sliding, T_last_tcp, robot.lower, robot.upper, q_start, poses, largest_step, q
    )
    if solved == 0:
        return StraightLine(q_start[None], length, 0.0, _REASONS.get(ended, "the line cannot be followed"))
    q[0] = q_start
    reason = "" if ended == REACHED else _REASONS[ended]
    return StraightLine(q[:solved], length, float(shares[solved - 1]), reason)
