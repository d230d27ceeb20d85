"""Errors of a robot's description and of joints for it.

RobotError
├── BadRobotFile      an MJCF or URDF that cannot be compiled, or lacks a joint, site or limit that is needed
├── BadJoints         joints with a wrong number of values, or values that are not finite
└── NotAPose          a pose that is no finite rigid transform
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from pomona.drivers.errors import UnusableRobotFile


class RobotError(Exception):
    """Root of this package's errors."""


class BadRobotFile(RobotError, UnusableRobotFile):
    """A robot description that cannot be used."""


class BadJoints(RobotError):
    """Joint values that no robot can take."""

    def __init__(self, names: tuple[str, ...], q: ArrayLike, problem: str) -> None:
        self.names, self.q, self.problem = names, np.array(q, dtype=object), problem
        super().__init__(f"bad joints for an arm of {len(names)} ({', '.join(names)}): {problem}")


class NotAPose(RobotError):
    """A 4 x 4 matrix that is no pose."""

    def __init__(self, T: ArrayLike) -> None:
        self.T = np.array(T, dtype=object)
        super().__init__(f"not a finite rigid transform of shape (4, 4): {np.asarray(T).tolist()}")
