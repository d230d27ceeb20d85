"""Inverse kinematics of any serial arm: damped least squares from many starts.

Levenberg-Marquardt on the pose error with joints clamped to their limits, after Sugihara (2011): the damping follows
the squared error, so steps are cautious far away and quadratic near the solution.
"""

from __future__ import annotations

from math import atan2, sqrt

import numpy as np
from numba import njit
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float64
from pomona.skills.motion.robot.chain import compose, forward, jacobian
from pomona.skills.motion.robot.model import RobotModel


def descend(model: RobotModel, T_base_tcp: Float64, starts: Float64, iterations: int = 80) -> Float64:
    """Solutions within the limits that the starts, shape (m, dof), descend to; shape (n, dof) [rad]."""
    solutions = np.empty_like(starts)
    count = _descend(
        model.steps,
        model.sliding,
        np.ascontiguousarray(model.T_link_tcp[:3]),
        np.ascontiguousarray(T_base_tcp[:3]),
        np.ascontiguousarray(starts),
        model.lower,
        model.upper,
        iterations,
        solutions,
    )
    return solutions[:count]


def spread_starts(model: RobotModel, count: int) -> Float64:
    """Starts spread over the joint limits, shape (count, dof): the same for every call (R-sequence, Roberts 2018)."""
    golden = 1.0
    for _ in range(40):  # the root of x^(dof+1) = x + 1
        golden = (1.0 + golden) ** (1.0 / (model.dof + 1))
    steps = golden ** -np.arange(1, model.dof + 1)
    shares = (0.5 + np.arange(1, count + 1)[:, None] * steps) % 1.0
    starts: Float64 = model.lower + shares * (model.upper - model.lower)
    return starts


@njit(cache=True, nogil=True)
def _solve_symmetric(A: Float64, b: Float64) -> None:
    """Solve A x = b in place for a symmetric positive definite A, shape (6, 6), by Cholesky; b becomes x."""
    n = b.shape[0]
    for j in range(n):
        for k in range(j):
            A[j, j] -= A[j, k] * A[j, k]
        A[j, j] = sqrt(A[j, j])
        for i in range(j + 1, n):
            for k in range(j):
                A[i, j] -= A[i, k] * A[j, k]
            A[i, j] /= A[j, j]
    for i in range(n):
        for k in range(i):
            b[i] -= A[i, k] * b[k]
        b[i] /= A[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            b[i] -= A[k, i] * b[k]
        b[i] /= A[i, i]


@njit(cache=True, nogil=True)
def newton_step(J: Float64, error: Float64, damping: float, A: Float64, step: Float64) -> None:
    """Write the least joint motion that takes an error away, J^T (J J^T + damping)^-1 error, into `step`.

    Args:
        J: Jacobian, shape (6, dof).
        error: of the pose, shape (6,) [m, rad]; overwritten.
        damping: added to the diagonal.
        A: room of shape (6, 6).
        step: the result, shape (dof,) [rad or m].
    """
    dof = step.shape[0]
    for i in range(6):
        for j in range(i + 1):
            total = 0.0
            for k in range(dof):
                total += J[i, k] * J[j, k]
            A[i, j] = total
        A[i, i] += damping
    _solve_symmetric(A, error)
    for k in range(dof):
        step[k] = 0.0
        for i in range(6):
            step[k] += J[i, k] * error[i]


@njit(cache=True, nogil=True)
def _pose_error(T: Float64, target: Float64, error: Float64) -> float:
    """Write the shift and the rotation vector from pose T to the target, both (3, 4), in the base frame; its norm²."""
    vee = np.zeros(3)
    trace = 0.0
    for k in range(3):
        error[k] = target[k, 3] - T[k, 3]
        for row in range(3):
            trace += target[row, k] * T[row, k]
        vee[0] += target[2, k] * T[1, k] - target[1, k] * T[2, k]
        vee[1] += target[0, k] * T[2, k] - target[2, k] * T[0, k]
        vee[2] += target[1, k] * T[0, k] - target[0, k] * T[1, k]
    sine = 0.5 * sqrt(vee[0] ** 2 + vee[1] ** 2 + vee[2] ** 2)
    angle = atan2(sine, 0.5 * (trace - 1.0))
    scale = 0.5 * angle / sine if sine > 1e-9 else 0.5
    total = 0.0
    for k in range(3):
        error[3 + k] = scale * vee[k]
        total += error[k] ** 2 + error[3 + k] ** 2
    return total


@njit(cache=True, nogil=True)
def _descend(
    steps: Float64,
    sliding: NDArray[np.bool_],
    T_link_tcp: Float64,
    target: Float64,
    starts: Float64,
    lower: Float64,
    upper: Float64,
    iterations: int,
    solutions: Float64,
) -> int:
    dof = starts.shape[1]
    links = np.empty((dof + 1, 3, 4))
    T = np.empty((3, 4))
    J = np.empty((6, dof))
    A = np.empty((6, 6))
    error, step = np.empty(6), np.empty(dof)
    count = 0
    for s in range(starts.shape[0]):
        q = starts[s].copy()
        for _ in range(iterations):
            forward(steps, sliding, q, links)
            compose(links[dof], T_link_tcp, T)
            squared = _pose_error(T, target, error)
            if squared < 1e-11**2:  # norm of the pose error [m, rad]
                break
            jacobian(links, sliding, T[:, 3].copy(), J)
            newton_step(J, error, 0.05 * squared + 1e-9, A, step)
            for k in range(dof):
                q[k] = min(max(q[k] + min(max(step[k], -0.5), 0.5), lower[k]), upper[k])
        forward(steps, sliding, q, links)
        compose(links[dof], T_link_tcp, T)
        if _pose_error(T, target, error) < 1e-9**2:  # accepted error when rounding stops the descent earlier
            for i in range(q.shape[0]):
                solutions[count, i] = q[i]
            count += 1
    return count
