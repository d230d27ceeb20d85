"""Time of conditions and averages: `Timer` and `LowPass`."""

from __future__ import annotations

import math


class Timer:
    """Duration for which a condition has held without a break.

    Attributes:
        lasted: that duration [s]; 0 when the condition does not hold.
    """

    def __init__(self) -> None:
        self.lasted = 0.0

    def update(self, is_true: bool, elapsed: float) -> float:
        """Return the duration after `elapsed` more seconds in which the condition held or not [s]."""
        self.lasted = self.lasted + elapsed if is_true else 0.0
        return self.lasted


class LowPass:
    """First-order average of irregular samples.

    Attributes:
        value: the average; nan until the first sample where no start is given.
    """

    def __init__(self, lag: float, start: float = math.nan) -> None:
        """Take the time constant [s] and the value at the start."""
        self._lag = lag
        self.value = start

    def update(self, sample: float, elapsed: float, lag: float | None = None) -> float:
        """Return the average after a sample that stands for `elapsed` seconds, here perhaps with another lag."""
        if math.isnan(self.value):
            self.value = sample
        self.value += (1.0 - math.exp(-elapsed / (lag or self._lag))) * (sample - self.value)
        return self.value
