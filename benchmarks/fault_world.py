"""Faults of the world: a person takes a fruit away, or moves or takes the crate from which it is picked."""

from __future__ import annotations

import numpy as np

from pomona.executive.cell.device import FaultSwitch
from pomona.tools.simulation.layout import SOURCE
from pomona.tools.simulation.world import SimWorld

ASIDE = (-0.55, 0.10)
"""Place on the table to which a fruit is taken, out of the arm's way: x, y in the base frame [m]."""
SHIFT = (0.04, 0.0)
"""Way of a crate that is moved, with its fruit: x, y in the base frame [m]."""
AWAY = (0.0, 5.0)
"""The same for a crate that is taken away without its fruit [m]."""


class Person(FaultSwitch):
    """A person at the table. A fruit or crate that is taken stays away: a fault of the world is not cleared."""

    known_faults = ("takes_fruit", "moves_crate", "takes_crate")

    def __init__(self, world: SimWorld) -> None:
        super().__init__()
        self._world = world

    def inject_fault(self, kind: str) -> None:
        super().inject_fault(kind)
        fruits = range(len(self._world.scene.fruits))
        match kind:
            case "takes_fruit":
                self._put(0, np.array(ASIDE) - self._place(0))
            case "moves_crate":
                self._move_crate(SHIFT)
                for i in fruits:
                    self._put(i, np.array(SHIFT))
            case _:
                self._move_crate(AWAY)

    def _place(self, i: int) -> np.ndarray:
        place: np.ndarray = np.array(self._world.state.body(f"fruit_{i}").xpos[:2])
        return place

    def _put(self, i: int, way: np.ndarray) -> None:
        body = self._world.model.body(f"fruit_{i}")
        address = self._world.model.jnt_qposadr[body.jntadr[0]]
        self._world.state.qpos[address : address + 2] += way

    def _move_crate(self, way: tuple[float, float]) -> None:
        self._world.model.body(f"fixed_{SOURCE}").pos[:2] += way
