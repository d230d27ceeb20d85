"""The belt as a device: where it runs, and how far and how fast its encoder has measured."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from pomona.drivers import Carrier
from pomona.executive import Float64, ReadOnly

SILENCE = 0.15
"""Age of an encoder's newest measurement from which it is lost [s]."""


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
