"""Errors of the occupancy map. None of these is ever read as "free".

OccupancyError
├── NothingMeasured      a look without depth, or without a valid pixel in the mapped volume
├── CameraPoseMismatch   the camera's given pose contradicts the arm or the table
├── MapEmpty             no look has been taken yet
└── MapStale             the newest look is too old
"""

from __future__ import annotations


class OccupancyError(Exception):
    """Root of this package's errors."""


class NothingMeasured(OccupancyError):
    """A frame without information about the mapped volume."""

    def __init__(self, label: str, valid: int, inside: int) -> None:
        self.label, self.valid, self.inside = label, valid, inside
        super().__init__(
            f"frame {label or '(unnamed)'} has {valid} pixels with depth, {inside} of them inside the mapped volume"
        )


class CameraPoseMismatch(OccupancyError):
    """A camera pose that cannot be true."""

    def __init__(self, problem: str, distance: float = 0.0, angle: float = 0.0) -> None:
        self.problem, self.distance, self.angle = problem, distance, angle
        super().__init__(f"the camera's pose contradicts the rest of the cell: {problem}")


class MapEmpty(OccupancyError):
    """A map without any look."""

    def __init__(self) -> None:
        super().__init__("the occupancy map holds no look yet: nothing in it may be taken for free")


class MapStale(OccupancyError):
    """A map whose newest look is too old."""

    def __init__(self, age: float, max_age: float) -> None:
        self.age, self.max_age = age, max_age
        super().__init__(f"the newest look of the occupancy map is {age:.2f} s old, {max_age:.2f} s are allowed")
