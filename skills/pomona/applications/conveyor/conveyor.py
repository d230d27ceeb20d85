"""The belt as a device: where it runs, and how far and how fast its encoder has measured."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from pomona.drivers import Carrier
from pomona.executive import LENGTH, Float64, Measure, ReadOnly, value

FASTEST = 0.5  # speed of a belt up to which the arm was tried and the simulated one is checked [m/s]
SILENCE = 0.15  # age of an encoder's newest measurement from which it is lost [s]


@dataclass(frozen=True, slots=True, eq=False)
class Belt(ReadOnly):
    """Where a belt runs.

    Attributes:
        T_base_belt: pose of the surface's middle in the base frame, shape (4, 4): x with the travel, z up.
        length, width: of the surface [m].
    """

    T_base_belt: Float64
    length: float
    width: float

    @property
    def top(self) -> float:
        """Height of the surface in the base frame [m]."""
        return float(self.T_base_belt[2, 3])

    @property
    def direction(self) -> Float64:
        """Direction of travel in the base frame, shape (3,)."""
        return self.T_base_belt[:3, 0]


@dataclass(frozen=True, slots=True, kw_only=True)
class BeltPlace:
    """Options of a cell file: where a belt runs, along x of the base frame."""

    beside: float = value(Measure(LENGTH, "-2 m", "2 m"), help="of the belt's middle line in the base frame, y")
    top: float = value(Measure(LENGTH, "-1 m", "1 m"), help="height of the belt's surface in the base frame")
    width: float = value(Measure(LENGTH, "100 mm", "1 m"), "240 mm", "of the belt")
    length: float = value(Measure(LENGTH, "1 m", "4 m"), "1.8 m", "of the belt, its middle before the robot")

    @property
    def belt(self) -> Belt:
        """Where the belt runs."""
        T = np.eye(4)
        T[:3, 3] = 0.0, self.beside, self.top
        return Belt(T, self.length, self.width)


@dataclass(frozen=True, slots=True)
class ConveyorState:
    """Measurements of a belt's encoder: at `stamp` [s] it has travelled `position` [m] and moves at `speed` [m/s]."""

    stamp: float
    position: float
    speed: float


@runtime_checkable
class Conveyor(Carrier, Protocol):
    """A belt with an encoder. The line's own control starts it again after a stop."""

    @property
    def belt(self) -> Belt:
        """Where it runs."""

    def travelled(self) -> ConveyorState | None:
        """Return the newest measurement, or None before the first. Never waits; the caller judges the stamp's age."""


BELT = (Conveyor, Carrier)  # interfaces of a belt's device
