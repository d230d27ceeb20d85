"""Check that a lifted fruit still hangs: its weight stays on the pads under any pressing force."""

from __future__ import annotations

import math

from pomona.drivers.errors import DeviceFault
from pomona.skills.grip.grip import LIES
from pomona.skills.grip.hold import Hold

LEAST = 0.25  # the tangential load of a fruit that hangs [N]; the lightest weighs 0.5 N, noise and bias are 0.1 N
LASTING = 0.06  # minimum duration [s]

AVERAGED, REMEMBERED = 0.1, 1.0  # time of the load's average, and in which its largest value fades [s]


class Hanging:
    """Watches the load of a held fruit during the lift, and decides whether it hangs at the end."""

    def __init__(self, hold: Hold) -> None:
        self._hold = hold
        self._stamp = math.nan
        self._load = self._most = 0.0
        self._light_for = 0.0

    def look(self) -> str:
        """Check the newest sample, once a tick; return why the fruit cannot hang any more, or an empty text.

        Raises DeviceFault: the finger readings are not valid.
        """
        require_truth(self._hold)
        reading = self._hold.reading
        elapsed = 0.0 if math.isnan(self._stamp) else max(reading.stamp - self._stamp, 0.0)
        self._stamp = reading.stamp
        self._load += (1.0 - math.exp(-elapsed / AVERAGED)) * (reading.f_t - self._load)
        self._most = max(self._load, self._most * math.exp(-elapsed / REMEMBERED))
        # Less than this share of the load that was there has gone: a lift that slows down with 3 m/s² leaves 0.5
        light = self._most > LEAST and reading.f_t < 0.35 * self._most
        self._light_for = self._light_for + elapsed if light else 0.0
        if self._light_for > LASTING:
            return f"its weight has gone from the fingers: {reading.f_t:.1f} N of {self._most:.1f} N are left"
        return ""

    def missing(self) -> str:
        """Return the evidence against a hanging fruit, at rest; empty without any."""
        if self._load < LEAST:
            return f"no weight hangs on the fingers: {self._load:.2f} N"
        return ""


def require_truth(hold: Hold) -> None:
    """Refuse to continue a grip with invalid finger readings; the run ends in the safe state.

    Raises DeviceFault: they stand still, contradict each other or the motor, or have gone silent.
    """
    problem = hold.problem
    if problem is not None and problem.code in LIES:
        raise DeviceFault("fingers", problem.message)
