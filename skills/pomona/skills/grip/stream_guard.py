"""Validation of the sensor's stream, once: samples in order, finite, each one only once."""

from __future__ import annotations

import math
from typing import NamedTuple

from pomona.executive.values.arrays import Float64

STALE_AFTER = 0.05
"""A stream without a valid sample for this long is stale [s]; the driver's watchdog stops the fingers at 0.1 s."""

EARLIEST = 0.02  # a sample whose timestamp lies further in the future is rejected [s]
LONGEST_CATCH_UP = 0.02  # after a gap the filters run on with the new sample for at most this long [s]
RESTART_AFTER = 0.05  # a sequence that falls back with a timestamp this much later comes from a restarted sensor [s]


class GripSample(NamedTuple):
    """A valid sample."""

    stamp: float  # time of the sample [s]
    periods: int  # sample periods since the last valid one; 1 in a flawless stream
    elapsed: float  # the same [s]
    wrenches: Float64  # of both fingers, shape (2, 6) [N, N·m], as in `WrenchSample`
    saturated: tuple[bool, bool] = (False, False)  # True for a finger with a channel at the end of its range


class StreamGuard:
    """Lets valid samples through and counts the others."""

    def __init__(self, period: float) -> None:
        self.period = period
        self._most_periods = max(round(LONGEST_CATCH_UP / period), 1)
        self.stamp = -math.inf
        self.sequence = -1
        self.repeated = self.out_of_order = self.missing = self.not_finite = 0
        self.longest_gap = 0.0

    def accept(
        self, stamp: float, sequence: int, wrenches: Float64, saturated: tuple[bool, bool] = (False, False)
    ) -> GripSample | None:
        """Return the sample, or None for one to be ignored."""
        if not (math.isfinite(stamp) and math.isfinite(wrenches.sum())):
            self.not_finite += 1
            return None
        is_first = self.sequence < 0
        if not is_first and sequence <= self.sequence and stamp < self.stamp + RESTART_AFTER:
            if sequence == self.sequence:
                self.repeated += 1
            else:
                self.out_of_order += 1
            return None
        if stamp <= self.stamp:
            self.out_of_order += 1
            return None
        gap = 0.0 if is_first else stamp - self.stamp - self.period
        self.missing += 0 if is_first else max(sequence - self.sequence - 1, 0)
        self.longest_gap = max(self.longest_gap, gap)
        self.stamp, self.sequence = stamp, sequence
        periods = 1 + min(max(round(gap / self.period), 0), self._most_periods - 1)
        return GripSample(stamp, periods, periods * self.period, wrenches, saturated)

    def findings(self) -> tuple[str, ...]:
        """Return one sentence for each kind of invalid sample so far."""
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
