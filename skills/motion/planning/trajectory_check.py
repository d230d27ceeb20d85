"""Whether a trajectory may be executed at all: finite, consistent, within the arm's limits."""

from __future__ import annotations

import numpy as np

from drivers.interfaces import ArmLimits, Trajectory
from skills.motion.planning.errors import BadTrajectory

TOLERANCE = 1e-3
"""Share by which a limit may be exceeded before it counts (rounding of samples)."""


def check_trajectory(trajectory: Trajectory, limits: ArmLimits) -> None:
    """Look at every sample.

    Raises:
        BadTrajectory: shapes that disagree, values that are not finite, time that does not increase from 0, ends that
            are not at rest, or a position, velocity, acceleration or jerk beyond its limit; the text names the joint.
    """
    t, q, qd, qdd = trajectory.t, trajectory.q, trajectory.qd, trajectory.qdd
    dof = len(limits.lower)
    if t.ndim != 1 or len(t) < 2 or any(part.shape != (len(t), dof) for part in (q, qd, qdd)):
        raise BadTrajectory(f"the trajectory's arrays do not hold two or more samples of {dof} joints")
    for name, part in (("time", t), ("position", q), ("velocity", qd), ("acceleration", qdd)):
        if not np.isfinite(part).all():
            sample = int(np.argwhere(~np.isfinite(part))[0][0])
            raise BadTrajectory(f"the {name} of sample {sample} is not a finite number")
    if t[0] != 0.0 or (np.diff(t) <= 0.0).any():
        raise BadTrajectory("the trajectory's time does not increase from 0")
    if np.abs(qd[[0, -1]]).max() > 1e-6:
        raise BadTrajectory("the trajectory does not start and end at rest")
    slack = TOLERANCE * (limits.upper - limits.lower)
    outside = np.maximum(limits.lower - slack - q, q - limits.upper - slack)
    if outside.max() > 0.0:
        sample, joint = divmod(int(outside.argmax()), dof)
        raise BadTrajectory(
            f"joint {joint + 1} would be at {np.degrees(q[sample, joint]):.1f}° after {t[sample]:.2f} s, "
            f"its limits are {np.degrees(limits.lower[joint]):.1f}° and {np.degrees(limits.upper[joint]):.1f}°"
        )
    jerk = np.diff(qdd, axis=0) / np.diff(t)[:, None]
    for name, part, limit, unit in (
        ("velocity", qd, limits.velocity, "rad/s"),
        ("acceleration", qdd, limits.acceleration, "rad/s²"),
        ("jerk", jerk, limits.jerk, "rad/s³"),
    ):
        share = np.abs(part) / limit
        if share.max() > 1.0 + TOLERANCE:
            sample, joint = divmod(int(share.argmax()), dof)
            raise BadTrajectory(
                f"the {name} of joint {joint + 1} would be {abs(part[sample, joint]):.2f} {unit} after "
                f"{t[sample]:.2f} s, its limit is {limit[joint]:.2f} {unit}"
            )
