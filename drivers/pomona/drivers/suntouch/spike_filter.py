"""Rejects readings in which a taxel jumps, unless the next reading confirms that it truly is so."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

JUMP = 0.05  # a taxel that changes by more than this between neighbouring readings is a spike [V]


class SpikeFilter:
    """One per finger; `rejected` counts."""

    def __init__(self) -> None:
        self.rejected = 0
        self._accepted: NDArray[np.float64] | None = None
        self._suspect: NDArray[np.float64] | None = None

    def accept(self, volts: NDArray[np.float64]) -> bool:
        """Return True for a valid reading, shape (25,) [V]. A step is accepted one reading late."""
        usual = self._accepted is None or self._near(volts, self._accepted)
        confirmed = self._suspect is not None and self._near(volts, self._suspect)
        if usual or confirmed:
            self._accepted, self._suspect = volts, None
            return True
        self._suspect = volts
        self.rejected += 1
        return False

    def forget(self) -> None:
        """Accept the next reading in any case: after a gap all values may have changed."""
        self._accepted = self._suspect = None

    def _near(self, a: NDArray[np.float64], b: NDArray[np.float64]) -> bool:
        return bool(np.abs(a - b).max() <= JUMP)
