"""What touches what: the normal forces of every contact, sorted by what they mean for fruit, wood and wires."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from pomona.drivers.orchard.model import WallModel
from pomona.drivers.sim.robot import PADS
from pomona.executive.values.arrays import Float64

Index = NDArray[np.int64]

BY_PAD, BY_LINING, BY_HARD = 0, 1, 2
"""Columns of the forces on a fruit: soft pads, the bin's foam, all else."""
_OTHER, _FRUIT, _PAD, _ROBOT, _LINING, _WOOD, _WIRE, _GROUND = range(8)


class Touches:
    """The contacts of the newest step.

    Attributes:
        forces: normal force on each fruit, summed, by what presses: shape (n, 3) [N]; see BY_PAD and so on.
        pads: of each pad on each fruit, shape (n, 2) [N].
        by_robot: whether the robot touches a fruit; grounded: whether it lies on the ground, shape (n,).
        laterals: whether the robot touches a lateral's wood, shape (m,).
    """

    def __init__(self, built: WallModel, data: Any) -> None:
        self._data = data
        self._count = len(built.fruit_geoms)
        model = built.model
        names = [model.geom(g).name for g in range(model.ngeom)]
        bodies = [model.body(b).name for b in model.geom_bodyid]
        self._kind = np.full(model.ngeom, _OTHER, np.int64)
        self._kind[built.robotic] = _ROBOT
        self._kind[[name in PADS for name in names]] = _PAD
        self._kind[built.wooden] = _WOOD
        self._kind[built.wired] = _WIRE
        self._kind[[name == "ground" for name in names]] = _GROUND
        self._kind[[name.startswith("fixed_") for name in bodies]] = _LINING
        self._kind[built.fruit_geoms] = _FRUIT
        self._number = built.lateral_of_geom.copy()
        self._number[built.fruit_geoms] = np.arange(self._count)
        for side, pad in enumerate(PADS):
            if pad in names:
                self._number[names.index(pad)] = side
        self.forces, self.pads = np.zeros((self._count, 3)), np.zeros((self._count, 2))
        self.by_robot, self.grounded = np.zeros(self._count, np.bool_), np.zeros(self._count, np.bool_)
        self.laterals = np.zeros(len(built.wall.laterals), np.bool_)
        self._others = np.zeros(3)

    @property
    def wood(self) -> float:
        """Largest normal force of the robot on wood [N]."""
        return float(self._others[0])

    @property
    def wire(self) -> float:
        """Largest normal force of the robot on a wire [N]."""
        return float(self._others[1])

    @property
    def fixed(self) -> float:
        """Largest normal force of the robot on what is fixed [N]."""
        return float(self._others[2])

    def look(self) -> None:
        """Sort the contacts of the newest step."""
        contact, force = self._data.contact, self._data.efc_force
        _sort(
            contact.geom, contact.efc_address, force, self._kind, self._number,
            self.forces, self.pads, self.by_robot, self.grounded, self.laterals, self._others,
        )  # fmt: skip


@numba.njit(cache=True)
def _sort(
    geoms: NDArray[np.int32],
    addresses: NDArray[np.int32],
    force: Float64,
    kind: Index,
    number: Index,
    forces: Float64,
    pads: Float64,
    by_robot: NDArray[np.bool_],
    grounded: NDArray[np.bool_],
    laterals: NDArray[np.bool_],
    others: Float64,
) -> None:
    forces[:], pads[:], others[:] = 0.0, 0.0, 0.0
    by_robot[:], grounded[:], laterals[:] = False, False, False
    for c in range(len(addresses)):
        if addresses[c] < 0:
            continue
        f = force[addresses[c]]
        for a, b in ((geoms[c, 0], geoms[c, 1]), (geoms[c, 1], geoms[c, 0])):
            first, second = kind[a], kind[b]
            if first == 1:  # a fruit, and what presses it
                i = number[a]
                column = 0 if second == 2 else 1 if second == 4 else 2
                forces[i, column] += f
                if second == 2:
                    pads[i, number[b]] += f
                by_robot[i] |= second == 2 or second == 3
                grounded[i] |= second == 7
            elif first == 2 or first == 3:  # the robot, and what it presses
                if second == 5:
                    others[0] = max(others[0], f)
                    if number[b] >= 0:
                        laterals[number[b]] = True
                elif second == 6:
                    others[1] = max(others[1], f)
                elif second == 4:
                    others[2] = max(others[2], f)
