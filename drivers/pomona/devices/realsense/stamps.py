"""When a frame was taken, on the cell's clock, from the time that the camera gave it."""

from __future__ import annotations

import time
from collections.abc import Callable

from pomona.devices.realsense.source import Pair
from pomona.executive import Clock

LATENCY = 0.035  # from exposure to arrival, where the camera's time cannot be compared with the host's clock [s]
DRIFT = 2e-4  # the camera's counter and the host's clock drift apart by less than this
STARTING = 0.5  # the first frames of a camera come late by less than this [s]


class Stamps:
    """Follows one camera from its opening on.

    A timestamp of the host's clock gives the age of a frame. For a counter of the camera, the offset is the smallest
    difference to the cell's clock so far, so that late frames show.
    """

    def __init__(self, clock: Clock, host_time: Callable[[], float] = time.time) -> None:
        self._clock = clock
        self._host_time = host_time
        self._offset: float | None = None
        self._then = 0.0

    def restart(self) -> None:
        """The camera was opened anew."""
        self._offset = None

    def stamp(self, pair: Pair) -> float:
        """Return the time of the exposure on the cell's clock [s]; of a recording, that of the look at it."""
        now = self._clock.now()
        if pair.taken is None:
            return now - LATENCY
        if pair.on_host_clock:
            return now - (self._host_time() - pair.taken)
        difference = now - pair.taken
        offset = difference if self._offset is None else self._offset + DRIFT * (now - self._then)
        if (
            difference > offset - STARTING
        ):  # else the counter jumped ahead, and its frames seem to be of the future
            offset = min(offset, difference)
        self._offset = offset
        self._then = now
        return pair.taken + offset - LATENCY
