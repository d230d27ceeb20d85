"""The finger's bytes: the host sends 'a', the finger answers 25 voltages as 25 × u16LE. No header, no checksum.

Only the time of the request marks the beginning of an answer: `Assembler.expect` notes it, and drops the rest of an
earlier answer.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np

from pomona.drivers import Malformed
from pomona.executive import Float64

REQUEST = b"a"
TAXELS = 25
SIZE = 2 * TAXELS
COUNTS = 4096
VOLTS = 3.3  # a reading is 12 bits over this range [V]; the upper four bits mean nothing


@dataclass(frozen=True, slots=True, eq=False)
class FingerReading:
    """One answer of a finger."""

    volts: Float64  # shape (25,) [V], of the taxels row by row
    saturated: bool  # whether any taxel is at an end of its range
    dead: bool = False  # whether all of them are at the same end: no light, no supply, or a line that is stuck


def decode(answer: bytes) -> FingerReading:
    """Return the voltages of a whole answer. Raises Malformed: it has not 50 bytes."""
    if len(answer) != SIZE:
        raise Malformed(answer, f"a finger answers {SIZE} bytes, not {len(answer)}")
    counts = np.array(struct.unpack(f"<{TAXELS}H", answer)) & (COUNTS - 1)
    low = int(counts.min())
    high = int(counts.max())
    volts: Float64 = counts * np.float64(VOLTS / COUNTS)
    return FingerReading(volts, low == 0 or high == COUNTS - 1, high == 0 or low == COUNTS - 1)


class Assembler:
    """Puts an answer together from the pieces in which it arrives.

    Attributes:
        damaged: answers that came short or long.
    """

    def __init__(self) -> None:
        self.damaged = 0
        self._buffer = bytearray()
        self._answered = True

    def expect(self) -> None:
        """Note a request: the next bytes are the beginning of its answer."""
        if not self._answered:
            self.damaged += 1
        self._buffer.clear()
        self._answered = False

    def decode(self, chunk: bytes) -> FingerReading | None:
        """Return the reading if these bytes complete it.

        Raises Malformed: more bytes arrived than an answer has, so the answer cannot be located.
        """
        self._buffer += chunk
        if len(self._buffer) > SIZE or (self._answered and chunk):
            received = bytes(self._buffer)
            self.damaged += 1
            self._buffer.clear()
            self._answered = True
            raise Malformed(received, "more bytes than requested")
        if len(self._buffer) < SIZE:
            return None
        answer = bytes(self._buffer)
        self._buffer.clear()
        self._answered = True
        return decode(answer)
