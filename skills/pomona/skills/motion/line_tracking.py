"""Joint paths along which the tool follows given poses without ever jumping to another arm configuration."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float64
from pomona.skills.motion.robot.chain import compose, forward, jacobian
from pomona.skills.motion.robot.numeric_ik import newton_step

REACHED, OUT_OF_REACH, JOINT_LIMIT, JUMP = 0, 1, 2, 3  # how tracking ended

_ROUNDS = 16
_PRECISION = 1e-10


@njit(cache=True, nogil=True)
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
        steps, sliding: the chain, as in `pomona.skills.motion.robot.chain.forward`.
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
    links, T, J = np.empty((dof + 1, 3, 4)), np.empty((3, 4)), np.empty((6, dof))
    error, A, step = np.empty(6), np.empty((6, 6)), np.empty(dof)
    q, q_before = q_start.copy(), np.empty(dof)
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
            for column in range(3):  # half the sum of the axes' cross products: the rotation vector, for small angles
                a0, a1, a2 = T[0, column], T[1, column], T[2, column]
                b0, b1, b2 = target[0, column], target[1, column], target[2, column]
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
