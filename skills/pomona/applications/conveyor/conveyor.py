"""The belt as a device: where it runs, and how far and how fast its encoder has measured."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from pomona.drivers import Box, Carrier, Intrinsics, Surroundings, Workspace
from pomona.executive import LENGTH, Float64, Measure, Problem, ReadOnly, value

# speed of a belt up to which the arm was tried and the simulated one is checked [m/s]
FASTEST = 0.5
SILENCE = 0.15  # age of an encoder's newest measurement from which it is lost [s]
AT_REST = 2e-3  # speed below which a belt rests [m/s]
LEVEL = 5e-3  # difference in height of a belt and the workspace's table that counts as none [m]
# height over a belt that its fruit takes, and up to which a watch need not see [m]
FRUIT_ROOM = 0.10
BLIND = 0.20


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

    def pictured(
        self, lens: Intrinsics, T_base_camera: Float64
    ) -> tuple[NDArray[np.int_], Float64, NDArray[np.bool_]]:
        """Return pixels, shape (2, n), and depths [m] of points all over the surface, and which are in the picture."""
        along, aside = np.meshgrid(
            np.linspace(-0.5, 0.5, 61) * self.length, np.linspace(-0.45, 0.45, 9) * self.width
        )
        points = np.stack([along.ravel(), aside.ravel(), np.zeros(along.size), np.ones(along.size)])
        x, y, z = (np.linalg.inv(T_base_camera) @ self.T_base_belt @ points)[:3]
        ahead = z > 0.05
        u = np.round(lens.fx * x / np.where(ahead, z, 1.0) + lens.cx).astype(int)
        v = np.round(lens.fy * y / np.where(ahead, z, 1.0) + lens.cy).astype(int)
        return (
            np.stack([u, v]),
            z,
            ahead & (u >= 0) & (u < lens.width) & (v >= 0) & (v < lens.height),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class BeltPlace:
    """Options of a cell file: where a belt runs, along x of the base frame."""

    beside: float = value(
        Measure(LENGTH, "-2 m", "2 m"), help="of the belt's middle line in the base frame, y"
    )
    top: float = value(
        Measure(LENGTH, "-1 m", "1 m"), help="height of the belt's surface in the base frame"
    )
    width: float = value(Measure(LENGTH, "100 mm", "1 m"), "240 mm", "of the belt")
    length: float = value(
        Measure(LENGTH, "1 m", "4 m"), "1.8 m", "of the belt, its middle before the robot"
    )

    @property
    def belt(self) -> Belt:
        """Where the belt runs."""
        T = np.eye(4)
        T[:3, 3] = 0.0, self.beside, self.top
        return Belt(T, self.length, self.width)

    def fits(self, around: Surroundings) -> Iterator[Problem]:
        """Yield the conflicts of the belt's place with the workspace; those with its watch once there is no other."""
        if (space := around.workspace) is None:
            return
        found = list(self._misplaced(space))
        yield from found or (() if space.watch is None else self._unwatched(space.watch.passing))

    def _room(self, length: float, width: float) -> tuple[Float64, Float64]:
        """Return the corners of the room over so much of the belt's middle that its fruit takes, shape (3,) [m]."""
        half = np.array([length, width, FRUIT_ROOM]) / 2.0
        middle = np.array([0.0, self.beside, self.top + FRUIT_ROOM / 2.0])
        return middle - half, middle + half

    def _misplaced(self, space: Workspace) -> Iterator[Problem]:
        lower, upper = self._room(self.length, self.width)
        belt = f"the belt, y {_mm(lower[1], upper[1])} and z {_mm(self.top)},"
        if space.table_z is not None and abs(self.top - space.table_z) > LEVEL:
            words = f"the belt lies at {_mm(self.top)} and workspace.table_z, by which paths are planned, at "
            yield Problem("top", words + _mm(space.table_z), "give both the height of the belt")
        elif (
            (lower[1:] < space.lower[1:]).any()
            or upper[1] > space.upper[1]
            or self.top > space.upper[2]
        ):
            ends = (
                f"y {_mm(space.lower[1], space.upper[1])}, z {_mm(space.lower[2], space.upper[2])}"
            )
            words = f"{belt} leaves the workspace, {ends}"
            remedy = "move the belt, or workspace.lower and .upper"
            yield Problem("beside", words, remedy)
        boxes = ((box.name, *_corners(box)) for box in space.obstacles)
        inner = lower + LEVEL
        outer = upper - LEVEL
        for name in dict.fromkeys(
            name for name, low, high in boxes if (low < outer).all() and (high > inner).all()
        ):
            yield Problem(
                "beside", f"{belt} runs through the obstacle '{name}'", "move one of the two"
            )

    def _unwatched(self, passing: tuple[Box, ...]) -> Iterator[Problem]:
        lower, upper = self._room(
            self.length / 4.0, self.width / 2.0
        )  # a volume for the belt holds this at least
        inner = lower + LEVEL
        outer = upper - LEVEL
        holding = [
            high
            for low, high in map(_corners, passing)
            if (low < inner).all() and (high > outer).all()
        ]
        high = max((float(corner[2]) - self.top for corner in holding), default=0.0)
        low, up = (
            " ".join(f"{x:.3f}" for x in corner) for corner in self._room(self.length, self.width)
        )
        volume = f"- {{name: belt, lower: {low} m, upper: {up} m}}"
        where = "workspace.watch.passing"
        if not holding:
            words = "no volume `passing` holds the fruit on the belt, so that each fruit would stop the arm"
            yield Problem(where if passing else "workspace.watch", words, volume)
        elif high > BLIND:
            words = f"up to {_mm(high)} over the belt the watch sees no person, and its fruit needs 100 mm"
            yield Problem(where, words, volume, warning=True)


def second_belt(around: Surroundings) -> Iterator[Problem]:
    """Yield the error of a belt below another one."""
    for name in (name for name, device in around.above.items() if Conveyor in device.interfaces):
        yield Problem(
            "driver",
            f"the cell has the belt '{name}' already",
            "leave one of them: the skills follow one",
        )


def _corners(box: Box) -> tuple[Float64, Float64]:
    """Return the corners of the room that a box takes along the axes of the base frame, shape (3,) [m]."""
    half = np.abs(box.T_base_box[:3, :3]) @ np.array(box.half_extents)
    return box.T_base_box[:3, 3] - half, box.T_base_box[:3, 3] + half


def _mm(*metres: float) -> str:
    return " to ".join(f"{1e3 * each:.0f}" for each in metres) + " mm"


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
