"""One clock for everything in a run: the system's monotonic time, or a simulated cell's time."""

from __future__ import annotations

import time
from typing import Protocol

from pomona.executive.lease import command


class Clock(Protocol):
    """The only source of time in a run; every stamp, deadline and duration is read from it."""

    @property
    def simulated(self) -> bool:
        """True for the time of a simulated world: it advances only on request."""

    def now(self) -> float:
        """Return seconds since an arbitrary start; never goes back."""

    @command
    def advance(self, duration: float) -> None:
        """Let `duration` seconds pass: sleep on the system's clock, step the world on a simulated one."""


_GOES_ON: int | None = (
    getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC)
    if hasattr(time, "clock_gettime")
    else None
)
"""Clock that goes on while the computer sleeps; None on Windows, whose monotonic clock does."""


class SystemClock:
    """The system's monotonic clock; it includes the sleep of the computer, so measurements from before are old."""

    simulated = False

    def now(self) -> float:
        return time.monotonic() if _GOES_ON is None else time.clock_gettime(_GOES_ON)

    def advance(self, duration: float) -> None:
        if duration > 0.0:
            time.sleep(duration)


class ManualClock:
    """A simulated clock with nothing behind it: for unit tests, dry runs and recorded frames."""

    simulated = True

    def __init__(self, start: float = 0.0) -> None:
        self._now = start

    def now(self) -> float:
        return self._now

    def advance(self, duration: float) -> None:
        self._now += max(duration, 0.0)
