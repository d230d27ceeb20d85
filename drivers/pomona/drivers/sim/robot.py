"""Requirements of a robot's file for the simulation."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pomona.drivers.errors import UnusableRobotFile
from pomona.drivers.robot_file import read_spec
from pomona.drivers.sim.gl import load_mujoco

PADS = ("pad_left", "pad_right")
FINGERS = ("finger_left", "finger_right")
NEEDED = {
    "site": ("tcp", "camera", *PADS),
    "geom": PADS,
    "joint": FINGERS,
    "actuator": ("gripper",),
    "numeric": ("arm_velocity", "arm_acceleration", "arm_jerk"),
}
"""Required parts of a robot's file, in addition to its arm's joints with an actuator each."""


def read_robot(path: Path) -> Any:
    """Return the file as an `mujoco.MjSpec` that can be simulated.

    Raises UnusableRobotFile: it cannot be read, or lacks something in `NEEDED`.
    """
    load_mujoco()  # before the reader does: both renderers must work in one process
    spec = read_spec(path)
    for kind, names in NEEDED.items():
        for name in names:
            if getattr(spec, kind)(name) is None:
                there = f"; a simulated cell needs {', '.join(names)}" if len(names) > 1 else ""
                raise UnusableRobotFile(path, f"has no {kind} named '{name}'{there}")
    joints = sum(actuator.name != "gripper" for actuator in spec.actuators)
    for name in NEEDED["numeric"]:
        if len(spec.numeric(name).data) != joints:
            words = f"'{name}' must have a number for each of the {joints} joints that have an actuator"
            raise UnusableRobotFile(path, words)
    return spec
