"""May an arm execute this trajectory at all? Drivers, planner and collision check ask here, and get one answer."""

from __future__ import annotations

import numpy as np

from pomona.drivers.errors import BadTrajectory
from pomona.drivers.interfaces import ArmLimits, Trajectory
from pomona.executive.values.arrays import Float64

# excess of a position over its limit by rounding [rad]: a few last digits of an f32
ROUNDING = 1e-6
SHARE = 1e-3  # relative tolerance of rate limits, for sampling and rounding of a motion timed to its limits
REST = 1e-3  # speed below which a joint rests [rad/s]: a fifth of the drivers' own threshold, which includes noise
START_TOLERANCE = 2e-3
"""Largest distance of any joint between the arm and the trajectory's first sample [rad]: a choice, a millimetre at half
a metre from the joint; `pomona.devices.motoman.stream` takes it up smoothly."""


def check_trajectory(
    trajectory: Trajectory, limits: ArmLimits, q_arm: Float64 | None = None
) -> None:
    """Check every sample.

    Args:
        trajectory: to be executed.
        limits: of the arm; infinite where none is known.
        q_arm: present joints, shape (dof,) [rad]; None when the trajectory is not to be started now.

    Raises BadTrajectory: shapes that disagree, values that are not finite, time that does not increase from 0, ends
    that are not at rest, a position, velocity, acceleration or jerk beyond its limit, positions that differ from the
    integral of the velocities, or a start away from the arm; the text has the joint and the time.
    """
    _check_form(trajectory, limits.lower.size)
    _check_range(trajectory, limits)
    _check_rates(trajectory, limits)
    _check_consistency(trajectory, limits)
    if q_arm is not None:
        _check_start(trajectory, q_arm)


def _check_form(trajectory: Trajectory, dof: int) -> None:
    t = np.asarray(trajectory.t)
    parts = {"position": trajectory.q, "velocity": trajectory.qd, "acceleration": trajectory.qdd}
    if t.ndim != 1 or t.size < 2 or any(np.shape(part) != (t.size, dof) for part in parts.values()):
        raise BadTrajectory(
            f"the trajectory's arrays do not hold two or more samples of {dof} joints"
        )
    for name, part in ({"time": t} | parts).items():
        if not np.isfinite(part).all():
            sample = int(np.argwhere(~np.isfinite(part))[0][0])
            raise BadTrajectory(f"the {name} of sample {sample} is not a finite number", sample)
    late = np.diff(t) <= 0.0
    if t[0] != 0.0 or late.any():
        sample = int(late.argmax()) + 1 if late.any() else 0
        raise BadTrajectory(
            f"the trajectory's time does not increase from 0 (sample {sample})", sample
        )


def _check_range(trajectory: Trajectory, limits: ArmLimits) -> None:
    t = trajectory.t
    q = trajectory.q
    outside = np.maximum(limits.lower - q, q - limits.upper)
    if outside.max() > ROUNDING:
        sample, joint = divmod(int(outside.argmax()), q.shape[1])
        span = f"{np.degrees(limits.lower[joint]):.1f}° and {np.degrees(limits.upper[joint]):.1f}°"
        where = f"{np.degrees(q[sample, joint]):.1f}° after {t[sample]:.2f} s"
        raise BadTrajectory(
            f"joint {joint + 1} would be at {where}, its limits are {span}", sample, joint
        )


def _check_rates(trajectory: Trajectory, limits: ArmLimits) -> None:
    t = trajectory.t
    qd = trajectory.qd
    qdd = trajectory.qdd
    if np.abs(qd[[0, -1]]).max() > REST:
        sample, joint = divmod(int(np.abs(qd[[0, -1]]).argmax()), qd.shape[1])
        speed = abs(qd[[0, -1]][sample, joint])
        words = f"joint {joint + 1} {'ends' if sample else 'starts'} with {speed:.4f} rad/s"
        raise BadTrajectory(
            f"the trajectory does not start and end at rest: {words}", sample * (t.size - 1), joint
        )
    for name, part, limit, unit in (
        ("velocity", qd, limits.velocity, "rad/s"),
        ("acceleration", qdd, limits.acceleration, "rad/s²"),
        ("jerk", np.diff(qdd, axis=0) / np.diff(t)[:, None], limits.jerk, "rad/s³"),
    ):
        share = np.abs(part) / limit
        if share.max() > 1.0 + SHARE:
            sample, joint = divmod(int(share.argmax()), qd.shape[1])
            raise BadTrajectory(
                f"the {name} of joint {joint + 1} would be {abs(part[sample, joint]):.2f} {unit} after "
                f"{t[sample]:.2f} s, its limit is {limit[joint]:.2f} {unit}",
                sample,
                joint,
            )


def _check_consistency(trajectory: Trajectory, limits: ArmLimits) -> None:
    """Compare the positions with the integral of the velocities; otherwise the limits of the rates would be
    meaningless.

    The trapezoidal rule is off by at most a dt² / 4 for a motion whose acceleration stays within a.
    """
    dt = np.diff(trajectory.t)[:, None]
    off = np.abs(
        np.diff(trajectory.q, axis=0) - dt * (trajectory.qd[1:] + trajectory.qd[:-1]) / 2.0
    )
    beyond = off - (1.0 + SHARE) * limits.acceleration * dt**2 / 4.0
    if beyond.max() > 2.0 * ROUNDING:
        sample, joint = divmod(int(beyond.argmax()), trajectory.q.shape[1])
        jump = f"joint {joint + 1} jumps by {np.degrees(off[sample, joint]):.2f}° after {trajectory.t[sample]:.2f} s"
        raise BadTrajectory(
            f"the trajectory's velocities do not belong to its positions: {jump}", sample, joint
        )


def _check_start(trajectory: Trajectory, q_arm: Float64) -> None:
    if not np.isfinite(q_arm).all():
        raise BadTrajectory("the arm's position is unknown: its joints are not finite", 0)
    distance = np.abs(trajectory.q[0] - q_arm)
    if distance.max() > START_TOLERANCE:
        joint = int(distance.argmax())
        away = f"{np.degrees(distance[joint]):.2f}° away from the arm at joint {joint + 1}"
        raise BadTrajectory(f"the trajectory starts {away}", 0, joint)
