"""What is let through of the sensor's stream: in order, once, finite."""

from __future__ import annotations

import math

from pomona.executive.values.arrays import Float64

LONGEST_CATCH_UP = 0.02
"""After a gap the filters run on with the new sample for at most so long [s]."""

RESTART_AFTER = 0.05
"""A sequence that falls back with stamps this much later is a sensor that was restarted [s]."""


class StreamGuard:
    """Counts periods between usable samples, and what was not usable."""

    def __init__(self, period: float) -> None:
        self.period = period
        self._most_periods = max(round(LONGEST_CATCH_UP / period), 1)
        self.stamp = -math.inf
        self.sequence = -1
        self.repeated = self.out_of_order = self.missing = self.not_finite = 0
        self.longest_gap = 0.0

    def periods(self, stamp: float, sequence: int, wrenches: Float64) -> int:
        """Periods that passed since the last usable sample, 1 in a flawless stream; 0 for a sample to be ignored."""
        if not (math.isfinite(stamp) and math.isfinite(wrenches.sum())):
            self.not_finite += 1
            return 0
        first = self.sequence < 0
        if not first and sequence <= self.sequence and stamp < self.stamp + RESTART_AFTER:
            if sequence == self.sequence:
                self.repeated += 1
            else:
                self.out_of_order += 1
            return 0
        if stamp <= self.stamp:
            self.out_of_order += 1
            return 0
        gap = 0.0 if first else stamp - self.stamp - self.period
        lost = 0 if first else max(sequence - self.sequence - 1, 0)
        self.missing += lost
        self.longest_gap = max(self.longest_gap, gap)
        self.stamp, self.sequence = stamp, sequence
        return 1 + min(max(round(gap / self.period), 0), self._most_periods - 1)

    def findings(self) -> tuple[str, ...]:
        """What was odd so far, one sentence each."""
        found = []
        if self.repeated:
            found.append(f"{self.repeated} repeated samples were ignored")
        if self.out_of_order:
            found.append(f"{self.out_of_order} samples came out of order and were ignored")
        if self.not_finite:
            found.append(f"{self.not_finite} samples held values that are not finite and were ignored")
        if self.missing or self.longest_gap > 1.5 * self.period:
            found.append(f"{self.missing} samples are missing, the longest gap was {1e3 * self.longest_gap:.0f} ms")
        return tuple(found)
