"""Is a timed trajectory one that this arm could follow at all?"""

from __future__ import annotations

import numpy as np

from drivers.interfaces import Trajectory
from skills.motion.collision.errors import BadTrajectory
from skills.motion.robot import RobotModel


def check_shape_and_limits(trajectory: Trajectory, model: RobotModel) -> None:
    """Refuse a trajectory that is malformed or leaves the position limits.

    Raises:
        BadTrajectory: with the first sample that is wrong.
    """
    t, q, qdd = trajectory.t, trajectory.q, trajectory.qdd
    expected = (len(t), model.dof)
    if t.ndim != 1 or len(t) < 1 or q.shape != expected or trajectory.qd.shape != expected or qdd.shape != expected:
        raise BadTrajectory(f"arrays of shapes {t.shape}, {q.shape} do not fit an arm of {model.dof} joints", 0)
    finite = np.isfinite(t) & np.isfinite(np.hstack((q, trajectory.qd, qdd))).all(axis=1)
    if not finite.all():
        raise BadTrajectory("values are not finite", int(np.argmin(finite)))
    if len(t) > 1 and np.any(np.diff(t) <= 0.0):
        raise BadTrajectory("time does not increase", int(np.argmax(np.diff(t) <= 0.0)) + 1)
    outside = (q < model.lower - 1e-9) | (q > model.upper + 1e-9)
    if outside.any():
        sample, joint = (int(n) for n in np.argwhere(outside)[0])
        raise BadTrajectory(f"{model.joint_names[joint]} = {q[sample, joint]:.4f} rad is outside its limits", sample)
