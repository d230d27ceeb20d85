"""Following an approach through for many joint solutions, compiled: free, in one configuration, free all the way."""

from __future__ import annotations

import numpy as np

from pomona.executive.values.arrays import Float64, Int64
from pomona.executive.values.numba_kernel import kernel
from pomona.skills.motion.collision.kernel import WorldArrays, check_states
from pomona.skills.motion.collision.robot_shape import RobotArrays
from pomona.skills.motion.collision.segment import check_segment
from pomona.skills.motion.lines import REACHED, track_poses

# how far a solution came; GOOD ones came all the way
GOOD = 3
START_BLOCKED = 0
LINE_BROKEN = 1
LINE_BLOCKED = 2


@kernel(nogil=True)
def follow_through(
    robot: RobotArrays,
    world: WorldArrays,
    T_last_tcp: Float64,
    lower: Float64,
    upper: Float64,
    solutions: Float64,
    poses: Float64,
    width: float,
    largest_step: float,
    wanted: int,
    lines: Float64,
    verdicts: Int64,
    witnesses: Float64,
) -> int:
    """Judge joint solutions of a pre-grasp one after the other, until as many as wanted are good.

    Args:
        robot, world: for the collision kernels.
        T_last_tcp: pose of the TCP in the last link, shape (3, 4).
        lower, upper: joint limits, shape (dof,).
        solutions: of the pre-grasp, shape (n, dof).
        poses: of the TCP along the approach, the pre-grasp first, shape (m, 3, 4).
        width: opening of the gripper [m].
        largest_step: of a joint from pose to pose [rad].
        wanted: number of good solutions after which it ends.
        lines: result: joints along the approach of every solution, shape (n, m, dof).
        verdicts: result: how far each came, shape (n,); -1 where it was not looked at.
        witnesses: result: for those that did not, a posture that shows why, shape (n, dof).

    Returns:
        the number of good solutions.
    """
    good = 0
    clearances = np.empty(1)
    closest = np.empty((1, 2), np.int64)
    verdicts[:] = -1
    for n in range(solutions.shape[0]):
        for j in range(solutions.shape[1]):
            witnesses[n, j] = solutions[n, j]
        verdicts[n] = START_BLOCKED
        check_states(robot, world, solutions[n : n + 1], width, 0.0, clearances, closest)
        if clearances[0] < 0.0:
            continue
        line = lines[n]
        verdicts[n] = LINE_BROKEN
        ended, _ = track_poses(
            robot.steps,
            robot.sliding,
            T_last_tcp,
            lower,
            upper,
            solutions[n],
            poses,
            largest_step,
            line,
        )
        if ended != REACHED:
            continue
        check_states(robot, world, line[-1:], width, 0.0, clearances, closest)
        # most that fail fail at the grasp itself, which is judged far more quickly than the way
        if clearances[0] < 0.0:
            verdicts[n] = LINE_BLOCKED
            for j in range(line.shape[1]):
                witnesses[n, j] = line[-1, j]
            continue
        verdicts[n] = GOOD
        for k in range(line.shape[0] - 1):
            at, _, _, _ = check_segment(robot, world, line[k], line[k + 1], width, 0.0)
            if at <= 1.0:
                verdicts[n] = LINE_BLOCKED
                for j in range(line.shape[1]):
                    witnesses[n, j] = line[k, j] + at * (line[k + 1, j] - line[k, j])
                break
        if verdicts[n] == GOOD:
            good += 1
            if good == wanted:
                break
    return good
