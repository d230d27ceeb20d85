"""Inverse kinematics: all solutions of a pose, in closed form for a spherical wrist, else by descent from many starts.

The descent is Levenberg-Marquardt on the pose error with joints clamped to their limits, after Sugihara (2011): the
damping follows the squared error, so steps are cautious far away and quadratic near the solution.
"""

from __future__ import annotations

from math import atan2, sqrt

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pomona.executive.values.arrays import Float64
from pomona.executive.values.numba_kernel import kernel
from pomona.skills.motion.robot.model import RobotModel, checked_pose, compose, forward, jacobian
from pomona.skills.motion.robot.spherical_arm import as_spherical_arm


def descend(model: RobotModel, T_base_tcp: Float64, starts: Float64) -> Float64:
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
        80,  # iterations
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


@kernel(nogil=True)
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


@kernel(nogil=True)
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


@kernel(nogil=True)
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


@kernel(nogil=True)
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
    error = np.empty(6)
    step = np.empty(dof)
    count = 0
    for s in range(starts.shape[0]):
        q = starts[s].copy()
        met = np.zeros(dof, np.bool_)
        for _ in range(iterations):
            forward(steps, sliding, q, links)
            compose(links[dof], T_link_tcp, T)
            squared = _pose_error(T, target, error)
            if squared < 1e-11**2:  # norm of the pose error [m, rad]
                break
            jacobian(links, sliding, T[:, 3].copy(), J)
            J *= ~met  # a joint that has met its limit sits out a step: the others, of a redundant arm, do its part
            newton_step(J, error, 0.05 * squared + 1e-9, A, step)
            for k in range(dof):
                wanted = q[k] + min(max(step[k], -0.5), 0.5)
                q[k] = min(max(wanted, lower[k]), upper[k])
                met[k] = q[k] != wanted
        forward(steps, sliding, q, links)
        compose(links[dof], T_link_tcp, T)
        # accepted error when rounding stops the descent earlier
        if _pose_error(T, target, error) < 1e-9**2:
            for i in range(q.shape[0]):
                solutions[count, i] = q[i]
            count += 1
    return count


_STARTS_PER_ARM_ANGLE = 2


def inverse_kinematics(
    model: RobotModel, T_base_tcp: ArrayLike, *, arm_angles: int = 36, near: ArrayLike | None = None
) -> Float64:
    """Return joints within the limits that put the TCP at a pose, shape (n, dof) [rad]; n = 0 when it is out of reach.

    Args:
        arm_angles: how finely the redundancy is sampled: angles of the elbow about the line from shoulder to wrist for
            an arm with a closed form (about 90 solutions for 36), pairs of starts of the descent for any other.
        near: joints, shape (dof,): solutions are sorted by their distance from it, and its posture is among them.

    Raises:
        NotAPose, BadJoints: the pose is no rigid transform, or `near` no joints of this arm.
    """
    pose = checked_pose(T_base_tcp)
    reference = None if near is None else model.checked(near)
    arm = as_spherical_arm(model)
    if arm is not None:
        angles = np.linspace(0.0, 2.0 * np.pi, arm_angles, endpoint=False)
        if reference is not None:
            angles = np.append(angles, arm.arm_angle(reference, pose))
        solutions = arm.solve(pose, angles, model.lower, model.upper)
    else:
        starts = spread_starts(model, _STARTS_PER_ARM_ANGLE * arm_angles)
        if reference is not None:
            starts = np.vstack((reference, starts))
        solutions = _distinct(descend(model, pose, starts))
    if reference is not None:
        solutions = _nearest_first(solutions, reference, model.lower, model.upper, model.sliding)
    return solutions


def nearest_solution(model: RobotModel, T_base_tcp: ArrayLike, near: ArrayLike) -> Float64 | None:
    """Return the joints of a pose by descending from `near`, shape (dof,), or None; continuous and fast (some 10 µs).

    Raises NotAPose, BadJoints: the pose is no rigid transform, or `near` no joints of this arm.
    """
    solutions = descend(model, checked_pose(T_base_tcp), model.checked(near)[None])
    return solutions[0] if len(solutions) else None


def _distinct(solutions: Float64) -> Float64:
    """Solutions without those that repeat an earlier one."""
    kept: list[Float64] = []
    for q in solutions:
        # solutions closer than this in every joint are one [rad]
        if all(np.abs(q - other).max() > 1e-4 for other in kept):
            kept.append(q)
    return np.array(kept).reshape(len(kept), solutions.shape[1])


@kernel(nogil=True)
def _nearest_first(
    solutions: Float64,
    reference: Float64,
    lower: Float64,
    upper: Float64,
    sliding: NDArray[np.bool_],
) -> Float64:
    """Solutions with joints turned by whole turns towards the reference where the limits allow, the nearest first."""
    turned = np.empty_like(solutions)
    squared = np.empty(solutions.shape[0])
    q = np.empty(solutions.shape[1])
    for n in range(solutions.shape[0]):
        away = 0.0
        for j in range(solutions.shape[1]):
            q[j] = solutions[n, j]
            if not sliding[j]:
                whole = 2.0 * np.pi * np.round((reference[j] - q[j]) / (2.0 * np.pi))
                if lower[j] <= q[j] + whole <= upper[j]:
                    q[j] += whole
            away += (q[j] - reference[j]) ** 2
        # among those before it: a few dozen, and np.argsort takes three seconds to compile
        place = n
        while place > 0 and squared[place - 1] > away:
            squared[place] = squared[place - 1]
            for j in range(solutions.shape[1]):
                turned[place, j] = turned[place - 1, j]
            place -= 1
        squared[place] = away
        for j in range(solutions.shape[1]):
            turned[place, j] = q[j]
    return turned
