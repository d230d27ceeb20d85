"""Detects a support under a held fruit by the load along the pads, sample by sample."""

from __future__ import annotations

import numpy as np

from pomona.executive.values.arrays import Float64
from pomona.skills.grip.pads import MIRROR

LASTING = 3  # number of consecutive samples that begin or end a contact: one may be a spike


class FloorWatch:
    """Compares the load along the pads with the load of the hanging fruit in the first sample.

    A floor reduces the load or reverses it. A contact ends when the load exceeds that of the hanging fruit: then the
    grip must bear more. A fruit that only hangs again is held by the same force as before.

    Attributes:
        carried: True while something else carries the fruit.
    """

    def __init__(self, contact: float) -> None:
        """
        Args:
            contact: change of the load that is a contact [N].
        """
        self._contact = contact
        self._hanging: Float64 | None = None
        self._lasted = 0
        self.carried = False

    def look(self, wrenches: Float64) -> bool:
        """Take one sample as in `WrenchSample`, shape (2, 6); return `carried`."""
        load = wrenches[0, :2] + (MIRROR * wrenches[1])[:2]
        if self._hanging is None:
            self._hanging = load
        change = load - self._hanging
        weight = float(np.linalg.norm(self._hanging))
        grown = float(change @ self._hanging) / max(weight, 1e-9)
        has_grown = grown > self._contact
        carried = not has_grown and (self.carried or float(np.linalg.norm(change)) > self._contact)
        self._lasted = self._lasted + 1 if carried is not self.carried else 0
        if self._lasted >= LASTING:
            self.carried, self._lasted = carried, 0
        return self.carried
