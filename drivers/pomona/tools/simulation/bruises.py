"""Presses on simulated fruit by all that touches it, beside the force that bruises."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from pomona.drivers.fruit_body import HARD_MODULUS, PAD_MODULUS, bruising_force
from pomona.executive.values.arrays import Float64
from pomona.tools.simulation.layout import PADS

BRUISE_LOOKS = 5
"""Looks over which a force is averaged, 50 ms: shorter peaks are those of the engine's solver, not of fruit."""

Press = tuple[float, str]
"""Ratio of a force on a fruit to the one that bruises it, and the words for both bodies."""


class Presses:
    """Watches each contact of the bodies fruit_0, fruit_1, … with another geometry, at 100 Hz.

    Attributes:
        largest: of each fruit.
        forces: on each fruit by each geometry in the last look, shape (n + 1, m, 3) [N]; the last row is on no fruit.
    """

    def __init__(self, built: Any, state: Any) -> None:
        """Begin with a model and its `fruits` and `shapes`."""
        self._state = state
        self._fruits = [fruit.name for fruit in built.fruits]
        self.largest: list[Press] = [(0.0, "")] * len(self._fruits)
        geoms = [built.model.geom(i) for i in range(built.model.ngeom)]
        bodies = [built.model.body(int(geom.bodyid[0])).name for geom in geoms]
        names = {f"fruit_{i}": name for i, name in enumerate(self._fruits)}
        self._number = np.array([[*names, body].index(body) for body in bodies])
        self._names = [
            geom.name if geom.name in PADS else names.get(body, body.removeprefix("fixed_"))
            for geom, body in zip(geoms, bodies, strict=True)
        ]
        moduli = [PAD_MODULUS if name in PADS else HARD_MODULUS for name in self._names]
        self._limits = np.array(
            [
                [bruising_force(shape.pressure, shape.dimensions[0] / 2.0, each) for each in moduli]
                for shape in built.shapes
            ]
        )
        self._mean = np.zeros_like(self._limits)
        self.forces = np.zeros((len(self._fruits) + 1, len(geoms), 3))
        self._of = {
            name: [i for i, each in enumerate(self._names) if each == name] for name in self._names
        }

    def force(self, i: int, name: str) -> Float64:
        """Return the force on a fruit by all geometries of a name, shape (3,) [N]."""
        force: Float64 = self.forces[i, self._of[name]].sum(axis=0)
        return force

    def watch(self) -> None:
        """Look at the contacts of this moment."""
        contact = self._state.contact
        acts = contact.efc_address >= 0
        # of an elliptic cone: normal force first, then friction, in the contact's own frame
        own = self._state.efc_force[contact.efc_address[acts, None] + np.arange(3)]
        force = np.einsum("ci,cij->cj", own, contact.frame[acts].reshape(-1, 3, 3))
        self.forces[:] = 0.0
        for pressed, other in contact.geom[acts].T, contact.geom[acts, ::-1].T:
            np.add.at(self.forces, (self._number[pressed], other), force)
        self._mean += (np.linalg.norm(self.forces[:-1], axis=2) - self._mean) / BRUISE_LOOKS
        ratios = self._mean / self._limits
        for i, name in enumerate(self._fruits):
            by = int(ratios[i].argmax())
            press = float(ratios[i, by]), f"{name} by {self._names[by]}"
            self.largest[i] = max(self.largest[i], press)


def press_figures(presses: Sequence[Press]) -> dict[str, object]:
    """Return how many fruits are bruised, and the largest press, for a score."""
    largest, words = max(presses, default=(0.0, ""))
    return {
        "bruised": sum(ratio > 1.0 for ratio, _ in presses),
        "largest_press": largest,
        "pressed": words,
    }
