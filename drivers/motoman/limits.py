"""Limits of the arm's trajectories, from the robot's only description (MJCF or URDF)."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from drivers.errors import DriverError
from drivers.interfaces import ArmLimits


class UnusableDescription(DriverError):
    """A robot file that does not say the arm's limits."""


def read_limits(description: Path, dof: int) -> ArmLimits:
    """Ranges of the first `dof` actuated joints, and the numerics arm_velocity, arm_acceleration and arm_jerk.

    Raises:
        UnusableDescription: the file cannot be read, has fewer joints, or lacks one of the numerics.
    """
    os.environ.setdefault("MUJOCO_GL", "disable")  # no graphics here
    import mujoco  # takes a moment; only this needs it

    try:
        model = mujoco.MjModel.from_xml_path(str(description))
    except ValueError as error:
        raise UnusableDescription(f"{description}: cannot be read: {error}") from error
    joints = model.actuator_trnid[:dof, 0]
    if len(joints) < dof:
        raise UnusableDescription(f"{description}: has {len(joints)} actuated joints, the arm has {dof}")
    rates = []
    for name in ("arm_velocity", "arm_acceleration", "arm_jerk"):
        try:
            rate = np.array(model.numeric(name).data, dtype=np.float64)
        except KeyError as error:
            raise UnusableDescription(f"{description}: <custom> lacks the numeric '{name}'") from error
        if rate.shape != (dof,) or rate.min() <= 0.0:
            raise UnusableDescription(f"{description}: '{name}' needs {dof} positive numbers")
        rates.append(rate)
    ranges = np.array(model.jnt_range[joints], dtype=np.float64)
    return ArmLimits(ranges[:, 0], ranges[:, 1], *rates)
