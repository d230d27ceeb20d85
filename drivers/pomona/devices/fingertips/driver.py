"""Two TSF-85 fingertips as a `PressSensor`: the sum of the taxels above zero, times the force of one count."""

from __future__ import annotations

import contextlib

import numpy as np

from pomona.devices.fingertips.codec import autosend, take_packets
from pomona.devices.wrist_sensors.sensor import StreamingSensor
from pomona.drivers import SIDES, Link, Malformed, Nonsense, PressSensor
from pomona.executive import Clock, Float64

# packets whose mean is the zero, and the time in which they must come [s]
TAKEN = 20
DEADLINE = 2.0
MOST = 600  # bytes without a packet after which the peer is no such sensor


class TsfSession:
    """The stream of both fingertips on a serial line."""

    def __init__(
        self,
        device: str,
        link: Link,
        clock: Clock,
        period: float,
        count: float,
        zero: tuple[float, float] | None,
    ) -> None:
        """Start the stream; without a `zero` take it from the next packets: nothing may press then.

        Args:
            period: of packets [s]; count: force of a count of a sum [N]; zero: sums without contact [counts].

        Raises OSError: the line failed; Nonsense: other bytes come; TimeoutError: too few packets for a zero.
        """
        self._device = device
        self._link = link
        self._count = count
        self._buffer = bytearray()
        self._dropped = 0
        self._sums = np.full(2, np.nan)
        link.send(autosend(round(1e3 * period)))
        self.zero = np.array(zero if zero is not None else self._at_rest(clock), dtype=np.float64)

    def _at_rest(self, clock: Clock) -> Float64:
        taken: list[Float64] = []
        end = clock.now() + DEADLINE
        while len(taken) < TAKEN:
            taken += self._read(0.01)
            if clock.now() > end:
                raise TimeoutError(
                    f"only {len(taken)} packets of both fingers within {DEADLINE:g} s"
                )
        mean: Float64 = np.mean(taken, axis=0)
        return mean

    def _read(self, patience: float) -> list[Float64]:
        """Return the sums of both fingers, (2,) [counts], of each packet that renews one."""
        self._buffer += self._link.receive(patience)
        packets, dropped = take_packets(self._buffer)
        self._dropped = 0 if packets else self._dropped + dropped
        if self._dropped > MOST:
            raise Nonsense(
                self._device, Malformed(bytes(self._buffer), "has no packet of a TSF-85")
            )
        found = []
        for fingers in packets:
            for finger, taxels in fingers.items():
                if finger < 2:
                    self._sums[finger] = taxels.sum()
            if fingers and np.isfinite(self._sums).all():
                found.append(self._sums.copy())
        return found

    def receive(self, patience: float) -> list[Float64]:
        """As `WristSession.receive`: shape (2, 6), all but each force z is 0."""
        found = []
        for sums in self._read(patience):
            wrenches = np.zeros((2, 6))
            wrenches[:, 2] = -self._count * (sums - self.zero)
            found.append(wrenches)
        return found

    def close(self) -> None:
        """End the stream and close the line."""
        with contextlib.suppress(OSError):
            self._link.send(autosend(0))
        self._link.close()


class TsfFingertips(StreamingSensor):
    """The fingertips."""

    interfaces = (PressSensor,)
    sides: tuple[str, ...] = SIDES
