"""One finger on its line: ask, answer, bias, spikes, and starting over when the bytes no longer fit."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from pomona.devices.suntouch.calibration import FingerCalibration
from pomona.devices.suntouch.codec import REQUEST, TAXELS, Assembler, FingerReading
from pomona.drivers import Link, Malformed
from pomona.executive import Clock, Float64

FLUSHING = 0.004  # longest time for which a line that is out of step is emptied [s]; an answer takes 0.5 ms at 1 Mbaud


class Finger:
    """Knows one finger's line, bias and calibration.

    Attributes:
        bias: voltages without contact, shape (25,) [V].
        resynchronised: how often the line was out of step.
    """

    def __init__(
        self, open_link: Callable[[], Link], calibration: FingerCalibration, clock: Clock
    ) -> None:
        self.calibration = calibration
        self.bias: Float64 = np.zeros(TAXELS)
        self.resynchronised = 0
        self.spikes = SpikeFilter()
        self._open_link = open_link
        self._clock = clock
        self._link: Link | None = None
        self._assembler = Assembler()

    def open(self) -> None:
        """Open the line and empty it. Raises OSError: it cannot be opened."""
        self.close()
        self._link = self._open_link()
        self._assembler = Assembler()
        self._empty()
        self.spikes.forget()

    def ask(self) -> None:
        """Ask for a reading; `answer` fetches it."""
        self._assembler.expect()
        self._line.send(REQUEST)

    def answer(self, due: float) -> FingerReading | None:
        """Return the reading asked for, waiting until `due`; None when it came short or long: the line is emptied then.

        Raises OSError: the line failed.
        """
        try:
            while True:
                chunk = self._line.receive(max(due - self._clock.now(), 0.0))
                reading = self._assembler.decode(chunk)
                if reading is not None:
                    return reading
                if not chunk and self._clock.now() >= due - 1e-9:
                    break
        except Malformed:
            pass
        self.resynchronised += 1
        self._empty()
        return None

    def wrench(self, reading: FingerReading) -> Float64:
        """Return the force [N] and torque [N·m] of a reading, shape (6,)."""
        return self.calibration.wrench(reading.volts - self.bias)

    def close(self) -> None:
        if self._link is not None:
            self._link.close()
            self._link = None

    @property
    def _line(self) -> Link:
        if self._link is None:
            raise ConnectionError("the line is closed")
        return self._link

    def _empty(self) -> None:
        """Drop bytes in transit, until the line has been quiet for a moment."""
        end = self._clock.now() + FLUSHING
        while self._line.receive(0.25 * FLUSHING) and self._clock.now() < end:
            pass


JUMP = 0.05  # a taxel that changes by more than this between neighbouring readings is a spike [V]


class SpikeFilter:
    """Rejects readings in which a taxel jumps, unless the next reading confirms the jump; `rejected` counts."""

    def __init__(self) -> None:
        self.rejected = 0
        self._accepted: NDArray[np.float64] | None = None
        self._suspect: NDArray[np.float64] | None = None

    def accept(self, volts: NDArray[np.float64]) -> bool:
        """Return True for a valid reading, shape (25,) [V]. A step is accepted one reading late."""
        usual = self._accepted is None or self._near(volts, self._accepted)
        confirmed = self._suspect is not None and self._near(volts, self._suspect)
        if usual or confirmed:
            self._accepted = volts
            self._suspect = None
            return True
        self._suspect = volts
        self.rejected += 1
        return False

    def forget(self) -> None:
        """Accept the next reading in any case: after a gap all values may have changed."""
        self._accepted = self._suspect = None

    def _near(self, a: NDArray[np.float64], b: NDArray[np.float64]) -> bool:
        return bool(np.abs(a - b).max() <= JUMP)
