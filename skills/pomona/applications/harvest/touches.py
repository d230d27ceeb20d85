"""Contacts of a step, sorted by their partners, for fruit, wood and wires: normal forces and closing speeds."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from pomona.applications.harvest.model import WallModel
from pomona.executive import Float64
from pomona.tools.simulation import PADS

Index = NDArray[np.int64]

BY_PAD, BY_LINING, BY_HARD = (
    0,
    1,
    2,
)  # columns of the forces on a fruit: soft pads, the bin's foam, all else
_OTHER, _FRUIT, _PAD, _ROBOT, _LINING, _WOOD, _WIRE, _GROUND = range(8)
APART = 0.02  # bodies that touch again within this time still touch [s]: the engine's bounces are shorter


class Touches:
    """The contacts of the newest step.

    Attributes:
        forces: largest normal force of one partner on each fruit, by its kind: shape (n, 3) [N]; see BY_PAD and so on.
            The forces of several partners act at several places of the skin, so their sum presses nowhere.
        speeds: normal speed at which a touch begins in this step, shape (n, 3) [m/s]; 0 without one and for pads. Of
            two fruit half of it: by symmetry each meets a rigid plane at half the speed.
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
        self._bodies, self._roots = (
            model.geom_bodyid.astype(np.int64),
            model.body_rootid.astype(np.int64),
        )
        self._touched = np.full((self._count, model.nbody), -np.inf)
        self.forces, self.pads = np.zeros((self._count, 3)), np.zeros((self._count, 2))
        self.speeds = np.zeros((self._count, 3))
        self.by_robot, self.grounded = (
            np.zeros(self._count, np.bool_),
            np.zeros(self._count, np.bool_),
        )
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
        """Largest normal force of the robot on fixed objects [N]."""
        return float(self._others[2])

    def look(self) -> None:
        """Sort the contacts of the newest step."""
        data = self._data
        contact = data.contact
        _sort(
            contact.geom, contact.efc_address, data.efc_force, self._kind, self._number,
            self.forces, self.pads, self.by_robot, self.grounded, self.laterals, self._others,
        )  # fmt: skip
        _meet(
            contact.geom, contact.efc_address, contact.pos, contact.frame, data.cvel, data.subtree_com,
            self._bodies, self._roots, self._kind, self._number, float(data.time), self._touched, self.speeds,
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
    pressed = 0.0
    for c in range(len(addresses)):
        # The engine lists the contacts of a pair of geoms one after the other: their sum is one partner's force.
        if c == 0 or geoms[c, 0] != geoms[c - 1, 0] or geoms[c, 1] != geoms[c - 1, 1]:
            pressed = 0.0
        if addresses[c] < 0:
            continue
        f = force[addresses[c]]
        pressed += f
        for a, b in ((geoms[c, 0], geoms[c, 1]), (geoms[c, 1], geoms[c, 0])):
            first, second = kind[a], kind[b]
            if first == _FRUIT:
                i = number[a]
                column = BY_PAD if second == _PAD else BY_LINING if second == _LINING else BY_HARD
                forces[i, column] = max(forces[i, column], pressed)
                if second == _PAD:
                    pads[i, number[b]] += f
                by_robot[i] |= second in (_PAD, _ROBOT)
                grounded[i] |= second == _GROUND
            elif first in (_PAD, _ROBOT):
                if second == _WOOD:
                    others[0] = max(others[0], f)
                    if number[b] >= 0:
                        laterals[number[b]] = True
                elif second == _WIRE:
                    others[1] = max(others[1], f)
                elif second == _LINING:
                    others[2] = max(others[2], f)


@numba.njit(cache=True)
def _meet(
    geoms: NDArray[np.int32],
    addresses: NDArray[np.int32],
    points: Float64,
    frames: Float64,
    velocities: Float64,
    centres: Float64,
    bodies: Index,
    roots: Index,
    kind: Index,
    number: Index,
    now: float,
    touched: Float64,
    speeds: Float64,
) -> None:
    """Normal speed of the touches that begin in this step, before the step's forces have acted."""
    speeds[:] = 0.0
    for c in range(len(addresses)):
        if addresses[c] < 0:
            continue
        closing = 0.0
        for sign, g in ((1.0, geoms[c, 0]), (-1.0, geoms[c, 1])):
            v, root = velocities[bodies[g]], centres[roots[bodies[g]]]
            x, y, z = points[c, 0] - root[0], points[c, 1] - root[1], points[c, 2] - root[2]
            closing += sign * frames[c, 0] * (v[3] + v[1] * z - v[2] * y)
            closing += sign * frames[c, 1] * (v[4] + v[2] * x - v[0] * z)
            closing += sign * frames[c, 2] * (v[5] + v[0] * y - v[1] * x)
        for a, b in ((geoms[c, 0], geoms[c, 1]), (geoms[c, 1], geoms[c, 0])):
            if kind[a] != _FRUIT:
                continue
            i, partner = number[a], kind[b]
            if now - touched[i, bodies[b]] > APART and partner != _PAD:
                column = BY_LINING if partner == _LINING else BY_HARD
                speeds[i, column] = max(
                    speeds[i, column], 0.5 * closing if partner == _FRUIT else closing
                )
            touched[i, bodies[b]] = now
