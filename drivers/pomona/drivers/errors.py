"""Errors of robots and their devices, beside those of every cell, which have their names here too.

DriverError
├── CellFileError          the cell file is wrong, with its place
├── BadTrajectory          a trajectory that no arm may execute
├── UnusableRobotFile      the robot's description cannot be used
├── UnusableMesh           a mesh file cannot be used
└── DeviceError            a device refused or failed; carries the device's name
    ├── MotionRefused      nothing has moved
    ├── DeviceLost         no answer, or the stream went stale
    └── DeviceFault        the device reports a fault, or its motion or data are implausible
        ├── StopFailed     it refused to stop, or goes on
        └── FrameUnreadable  a recorded frame cannot be read
"""

from __future__ import annotations

from pathlib import Path

from pomona.executive.cell.errors import (
    CellFileError as CellFileError,
    DeviceError as DeviceError,
    DeviceFault as DeviceFault,
    DeviceLost as DeviceLost,
    DriverError as DriverError,
    MotionRefused as MotionRefused,
    StopFailed as StopFailed,
)


class UnusableRobotFile(DriverError):
    """A robot's description (MJCF or URDF) that cannot be read, or lacks data for a driver."""

    def __init__(self, path: Path, problem: str) -> None:
        self.path = path
        self.problem = problem
        super().__init__(f"{path}: {problem}")


class UnusableMesh(DriverError):
    """A mesh file that cannot be read, or whose size fits no cell, with the remedy."""


class BadTrajectory(DriverError):
    """A trajectory that must not be executed: malformed, or beyond a limit.

    Attributes:
        sample, joint: the first that is wrong, counted from 0; None where no single one is.
    """

    def __init__(self, problem: str, sample: int | None = None, joint: int | None = None) -> None:
        self.problem = problem
        self.sample = sample
        self.joint = joint
        super().__init__(problem)


class FrameUnreadable(DeviceFault):
    """A recorded frame that cannot be read; the next one may."""
