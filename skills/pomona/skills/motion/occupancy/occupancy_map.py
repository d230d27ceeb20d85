"""The occupancy map: the observed state of the cell's volume, as a frozen snapshot.

None of its errors is ever read as "free":

OccupancyError
├── NothingMeasured      a look without depth, or without a valid pixel in the mapped volume
├── CameraPoseMismatch   the camera's given pose contradicts the arm or the table
├── MapEmpty             no look has been taken yet
└── MapStale             the newest look is too old

"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pomona.executive.values.arrays import Float64
from pomona.executive.values.read_only import read_only
from pomona.skills.motion.collision.distance_field import Convex, DistanceField


class OccupancyError(Exception):
    """Root of this package's errors."""


class NothingMeasured(OccupancyError):
    """A frame without information about the mapped volume."""

    def __init__(self, label: str, valid: int, inside: int) -> None:
        self.label = label
        self.valid = valid
        self.inside = inside
        super().__init__(
            f"frame {label or '(unnamed)'} has {valid} pixels with depth, {inside} of them inside the mapped volume"
        )


class CameraPoseMismatch(OccupancyError):
    """A camera pose that cannot be true."""

    def __init__(self, problem: str, distance: float = 0.0, angle: float = 0.0) -> None:
        self.problem = problem
        self.distance = distance
        self.angle = angle
        super().__init__(f"the camera's pose contradicts the rest of the cell: {problem}")


class MapEmpty(OccupancyError):
    """A map without any look."""

    def __init__(self) -> None:
        super().__init__("the occupancy map holds no look yet: nothing in it may be taken for free")


class MapStale(OccupancyError):
    """A map whose newest look is too old."""

    def __init__(self, age: float, max_age: float) -> None:
        self.age = age
        self.max_age = max_age
        super().__init__(
            f"the newest look of the occupancy map is {age:.2f} s old, {max_age:.2f} s are allowed"
        )


# states of a cell; HIDDEN: close behind a seen surface
UNKNOWN = 0
FREE = 1
OCCUPIED = 2
HIDDEN = 3


@dataclass(frozen=True, eq=False)
class OccupancyMap:
    """A grid of cells in the base frame. OCCUPIED and HIDDEN cells are blocked.

    Attributes:
        origin: lower corner of the volume, shape (3,) [m].
        resolution: edge of a cell [m].
        states: UNKNOWN, FREE, OCCUPIED or HIDDEN, shape (nx, ny, nz), uint8.
        last_look: number of the last frame with information about a cell, same shape, int16; -1 for none.
        stamps: time of each look on the cell's clock [s].
        shapes: objects that were measured and are obstacles by their shapes instead of cells.
    """

    origin: Float64
    resolution: float
    states: NDArray[np.uint8]
    last_look: NDArray[np.int16]
    stamps: tuple[float, ...]
    shapes: tuple[Convex, ...] = ()

    @staticmethod
    def empty(lower: Float64, upper: Float64, resolution: float) -> OccupancyMap:
        """Return a map of the box from `lower` to `upper`, each (3,) [m], that has seen nothing."""
        counts = np.ceil((np.asarray(upper) - np.asarray(lower)) / resolution - 1e-9).astype(int)
        shape = (int(counts[0]), int(counts[1]), int(counts[2]))
        return OccupancyMap(
            np.array(lower, dtype=np.float64),
            resolution,
            np.zeros(shape, np.uint8),
            np.full(shape, -1, np.int16),
            (),
        )

    @property
    def stamp(self) -> float | None:
        """Time of the newest look [s]; None for an empty map."""
        return self.stamps[-1] if self.stamps else None

    def age(self, now: float) -> Float64:
        """Return seconds since each cell was last seen, shape (nx, ny, nz); infinite where never."""
        since = np.append(now - np.array(self.stamps), np.inf)  # last_look -1 reads the last entry
        ages: Float64 = since[self.last_look]
        return ages

    @cached_property
    def blocked(self) -> NDArray[np.bool_]:
        """Which cells nothing may enter, shape (nx, ny, nz)."""
        blocked: NDArray[np.bool_] = read_only(self.states >= OCCUPIED)
        return blocked

    @cached_property
    def field(self) -> DistanceField:
        """Distance to blocked cells, with the measured shapes; computed once."""
        # distances are known up to this [m]
        field = DistanceField.of_blocked(
            self.states >= OCCUPIED, self.origin, self.resolution, 0.30
        )
        return replace(field, shapes=self.shapes)

    def usable_field(self, now: float, max_age: float) -> DistanceField:
        """Return the distance field if the newest look is at most `max_age` old at `now` on the cell's clock [s].

        Raises:
            MapEmpty, MapStale: the map may not be relied on.
        """
        if self.stamp is None:
            raise MapEmpty
        if now - self.stamp > max_age:
            raise MapStale(now - self.stamp, max_age)
        return self.field

    def centres(self, *states: int) -> Float64:
        """Centres of the cells in some states, shape (n, 3), in the base frame [m]."""
        return self.origin + (np.argwhere(np.isin(self.states, states)) + 0.5) * self.resolution

    def cell_of(self, point: Float64) -> tuple[int, int, int]:
        """Return the indices of the cell at a point of the base frame, shape (3,); they may lie outside the grid."""
        i, j, k = np.floor((np.asarray(point) - self.origin) / self.resolution).astype(int)
        return int(i), int(j), int(k)
