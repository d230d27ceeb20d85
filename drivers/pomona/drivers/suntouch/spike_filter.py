"""Rejects readings in which a taxel jumps alone, unless the next reading confirms the jump.

A load on the pad moves the taxels around it, too: its jumps are valid, however fast a contact breaks or forms.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

JUMP = 0.05  # a taxel that changes by more than this between two successive readings jumps [V]
# A jump is a load if so many other taxels change by at least this ratio of the largest change. A row of the pad has
# four others; a contact of the emulated pad moves six, even at its corner.
OTHERS, FOLLOWS = 5, 0.25


class SpikeFilter:
    """One per finger; `rejected` counts."""

    def __init__(self) -> None:
        self.rejected = 0
        self._accepted: NDArray[np.float64] | None = None
        self._suspect: NDArray[np.float64] | None = None

    def accept(self, volts: NDArray[np.float64]) -> bool:
        """Return True for a valid reading, shape (25,) [V]. A step is accepted one reading late."""
        usual = self._accepted is None or self._follows(volts, self._accepted)
        confirmed = self._suspect is not None and self._follows(volts, self._suspect)
        if usual or confirmed:
            self._accepted, self._suspect = volts, None
            return True
        self._suspect = volts
        self.rejected += 1
        return False

    def forget(self) -> None:
        """Accept the next reading in any case: after a gap all values may have changed."""
        self._accepted = self._suspect = None

    def _follows(self, volts: NDArray[np.float64], before: NDArray[np.float64]) -> bool:
        """Return True unless a taxel jumps alone."""
        changes = np.abs(volts - before)
        largest = float(changes.max())
        return largest <= JUMP or int(np.count_nonzero(changes >= FOLLOWS * largest)) > OTHERS
