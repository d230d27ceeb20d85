"""Inverse kinematics behind one function: closed form where the arm has one, a numeric solver for every other arm."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from pomona.executive.values.arrays import Float64
from pomona.skills.motion.robot.model import RobotModel, checked_pose
from pomona.skills.motion.robot.numeric_ik import descend, spread_starts
from pomona.skills.motion.robot.spherical_arm import as_spherical_arm

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


@njit(cache=True, nogil=True)
def _nearest_first(
    solutions: Float64, reference: Float64, lower: Float64, upper: Float64, sliding: NDArray[np.bool_]
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
        place = n  # among those before it: a few dozen, and np.argsort takes three seconds to compile
        while place > 0 and squared[place - 1] > away:
            squared[place] = squared[place - 1]
            for j in range(solutions.shape[1]):
                turned[place, j] = turned[place - 1, j]
            place -= 1
        squared[place] = away
        for j in range(solutions.shape[1]):
            turned[place, j] = q[j]
    return turned
