"""Stems under load: the load on every stem after each step, and its break by the law of strength."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from pomona.applications.harvest.model import WallModel
from pomona.applications.harvest.strength import used
from pomona.executive import Float64

SPINNING = 2e-4
"""Damping of a free fruit's spin [N·m·s/rad]: without any, rounding errors drive it until nothing is stable."""
HANGS, AT_SPUR, TORN = (
    0,
    1,
    2,
)  # how a stem stands: it holds, it came off the spur, it was torn out of the fruit


@numba.njit(cache=True)
def _look(
    passive: Float64,
    stretch: NDArray[np.int64],
    swing: NDArray[np.int64],
    rest: Float64,
    strengths: Float64,
    state: NDArray[np.int8],
    loads: Float64,
) -> int:
    """Loads of all stems; marks at most one that breaks now and returns it, or -1.

    `loads` gets a row a fruit: force [N] and moment [N·m] in the stem's frame (z along it), shape (n, 6).
    """
    worst, broken, how = 1.0, -1, 0
    for i in range(len(stretch)):
        if state[i] != 0:
            continue
        a, b = stretch[i], swing[i]
        for k in range(3):
            loads[i, k] = passive[a + k]
        loads[i, 3] = passive[b] - rest[i, 0]
        loads[i, 4] = passive[b + 2] - rest[i, 2]
        loads[i, 5] = passive[b + 1] - rest[i, 1]
        spur, fruit = used(loads[i, :3], loads[i, 3:], strengths[i])
        if max(spur, fruit) > worst:
            worst, broken, how = max(spur, fruit), i, 1 if spur >= fruit else 2
    if broken >= 0:
        state[broken] = how
    return broken


@dataclass(slots=True)
class Stems:
    """Watches the stems of a wall and breaks them.

    A step breaks one stem at most: a load on two stems acts on the other alone once the first has broken.
    """

    built: WallModel
    data: Any
    state: NDArray[np.int8] = field(init=False)  # HANGS, AT_SPUR or TORN, of each fruit
    # force [N] and moment [N·m] at the spur in the stem's frame, z along it, shape (n, 6); of broken stems the last.
    # The moment is the excess over that of the rest in which the stem grew.
    loads: Float64 = field(init=False)
    peak: Float64 = field(init=False)  # largest force so far, shape (n,) [N]

    def __post_init__(self) -> None:
        count = len(self.built.stretch)
        self.state, self.loads, self.peak = (
            np.zeros(count, np.int8),
            np.zeros((count, 6)),
            np.zeros(count),
        )

    def look(self) -> int:
        """After a step: the fruit whose stem broke in it, or -1."""
        built = self.built
        broken: int = _look(
            self.data.qfrc_passive,
            built.stretch,
            built.swing,
            built.rest_moment,
            built.strengths,
            self.state,
            self.loads,
        )
        hanging = self.state == HANGS
        if broken >= 0:
            hanging[broken] = True
            self.release(broken)
        force = np.sqrt((self.loads[:, :3] ** 2).sum(axis=1))
        np.maximum(self.peak, np.where(hanging, force, 0.0), out=self.peak)
        return broken

    def release(self, i: int) -> None:
        """Make a fruit's joints free of force but for its spin: it is a free body from now on."""
        model, a, b = self.built.model, self.built.stretch[i], self.built.swing[i]
        joints = model.dof_jntid[[a, a + 1, a + 2, b]]
        model.jnt_stiffness[joints] = 0.0
        model.dof_damping[a : a + 3], model.dof_damping[b : b + 3] = 0.0, SPINNING
        if self.state[i] == TORN:  # the stem is left at the spur, not at the fruit
            for label, alpha in (("stem", 0.0), ("torn", 1.0)):
                model.geom(f"fruit_{self.built.wall.fruits[i].number}_{label}").rgba[3] = alpha
