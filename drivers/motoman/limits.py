"""Limits of the arm's trajectories, from the robot's only description (MJCF or URDF)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from drivers.errors import UnusableRobotFile
from drivers.interfaces import ArmLimits
from drivers.robot_file import read_spec


def read_limits(description: Path, dof: int) -> ArmLimits:
    """Ranges of the first `dof` actuated joints, and the numerics arm_velocity, arm_acceleration and arm_jerk.

    Raises:
        UnusableRobotFile: the file cannot be read, has fewer joints, or lacks one of the numerics.
    """
    model = read_spec(description).compile()
    joints = model.actuator_trnid[:dof, 0]
    if len(joints) < dof:
        raise UnusableRobotFile(description, f"has {len(joints)} actuated joints, the arm has {dof}")
    rates = []
    for name in ("arm_velocity", "arm_acceleration", "arm_jerk"):
        try:
            rate = np.array(model.numeric(name).data, dtype=np.float64)
        except KeyError as error:
            raise UnusableRobotFile(description, f"<custom> lacks the numeric '{name}'") from error
        if rate.shape != (dof,) or rate.min() <= 0.0:
            raise UnusableRobotFile(description, f"'{name}' needs {dof} positive numbers")
        rates.append(rate)
    ranges = np.array(model.jnt_range[joints], dtype=np.float64)
    return ArmLimits(ranges[:, 0], ranges[:, 1], *rates)
