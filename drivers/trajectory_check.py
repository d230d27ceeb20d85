"""What an arm's driver demands of a trajectory before anything moves."""

from __future__ import annotations

import numpy as np

from drivers.interfaces import ArmLimits, Float64, Trajectory

START_TOLERANCE = 2e-3
"""Largest distance of any joint between the arm and the trajectory's first sample [rad]."""
SLACK = 1.02
"""Sampling and rounding may exceed a rate's limit by this factor."""


def problem_with(trajectory: Trajectory, limits: ArmLimits, q: Float64) -> str:
    """Why a trajectory cannot be followed from `q`, as a sentence; empty when it can."""
    t, dof = np.asarray(trajectory.t), limits.lower.size
    arrays = (trajectory.q, trajectory.qd, trajectory.qdd)
    if t.ndim != 1 or t.size < 2 or any(np.shape(array) != (t.size, dof) for array in arrays):
        return f"the trajectory needs times (n,) and joints (n, {dof}) with n at least 2"
    if not all(np.isfinite(array).all() for array in (t, *arrays)):
        return "the trajectory holds values that are not finite"
    if t[0] != 0.0 or np.any(np.diff(t) <= 0.0):
        return "the trajectory's times must increase from 0"
    if not np.isfinite(q).all():
        return "where the arm stands is not known: its joints are not finite"
    distance = np.abs(trajectory.q[0] - q)
    if distance.max() > START_TOLERANCE:
        joint = int(distance.argmax())
        return f"the trajectory starts {np.degrees(distance[joint]):.2f}° away from the arm at joint {joint + 1}"
    return _outside_limits(trajectory, limits) or _inconsistent(trajectory, limits)


def _outside_limits(trajectory: Trajectory, limits: ArmLimits) -> str:
    beyond = np.maximum(limits.lower - trajectory.q, trajectory.q - limits.upper).max(axis=0)
    if beyond.max() > 1e-6:
        joint = int(beyond.argmax())
        return f"joint {joint + 1} would go {np.degrees(beyond[joint]):.1f}° beyond its range"
    for word, rates, limit in (
        ("velocity", trajectory.qd, limits.velocity),
        ("acceleration", trajectory.qdd, limits.acceleration),
    ):
        share = np.abs(rates).max(axis=0) / limit
        if share.max() > SLACK:
            joint = int(share.argmax())
            return f"joint {joint + 1} would need {share[joint]:.2f} times its {word} limit"
    return ""


def _inconsistent(trajectory: Trajectory, limits: ArmLimits) -> str:
    """Positions must be what the velocities integrate to, or the limits above mean nothing."""
    if np.abs(trajectory.qd[[0, -1]]).max() > 1e-3:
        return "the trajectory must start and end at rest"
    dt = np.diff(trajectory.t)[:, None]
    steps = np.diff(trajectory.q, axis=0)
    fastest = (np.abs(steps) / dt / limits.velocity).max(axis=0)
    if fastest.max() > SLACK + 0.03:
        joint = int(fastest.argmax())
        return f"joint {joint + 1} jumps: its samples need {fastest[joint]:.2f} times its velocity limit"
    error = np.abs(steps - dt * (trajectory.qd[1:] + trajectory.qd[:-1]) / 2.0).max()
    if error > 5e-3 + 0.25 * float((dt**2).max() * limits.acceleration.max()):
        return "the trajectory's velocities do not belong to its positions"
    return ""
