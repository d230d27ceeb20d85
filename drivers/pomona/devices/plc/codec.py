"""Modbus TCP: requests, answers and their frames (Modbus application protocol 1.1b3, messaging on TCP/IP 1.0b)."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass

from pomona.drivers import Malformed

PORT = 502
HEAD = struct.Struct(">HHHB")
"""Of a frame: transaction, protocol (0), bytes that follow, unit."""
LONGEST = 253
"""Bytes of the longest request or answer, without its head."""
REFUSED = 0x80
"""Added to the function by an answer that refuses the request."""

READS = {"coil": 1, "discrete": 2, "holding": 3, "input": 4}
"""Function that reads an area: coils and discrete inputs are bits, holding and input registers have 16 bits."""
WRITES = {"coil": 15, "holding": 16}
"""Function that writes an area; the others can only be read."""
BITS = ("coil", "discrete")
MOST = {1: 2000, 2: 2000, 3: 125, 4: 125, 15: 1968, 16: 123}
"""Most values of one request, by its function."""

REASONS = {
    1: "it does not have this function",
    2: "it has no such address",
    3: "it does not accept this value",
    4: "it has failed",
    6: "it is busy",
    10: "its gateway has no way to this unit",
    11: "nothing answers behind its gateway as this unit",
}
"""Modbus exceptions."""


@dataclass(frozen=True, slots=True)
class MemorySpan:
    """Values that lie side by side: their area, the first address, and their number."""

    area: str
    first: int
    count: int

    @property
    def cells(self) -> list[tuple[str, int]]:
        """Area and address of each value."""
        return [(self.area, self.first + i) for i in range(self.count)]


def read_request(span: MemorySpan) -> bytes:
    """Return the request for the values of a span."""
    return struct.pack(">BHH", READS[span.area], span.first, span.count)


def write_request(area: str, first: int, values: Sequence[int]) -> bytes:
    """Return the request that writes values from an address on."""
    data = packed_bits(values) if area in BITS else struct.pack(f">{len(values)}H", *values)
    return struct.pack(">BHHB", WRITES[area], first, len(values), len(data)) + data


def packed_bits(values: Sequence[int]) -> bytes:
    """Return bits in bytes, the first as the lowest."""
    number = sum(1 << i for i, value in enumerate(values) if value)
    return number.to_bytes((len(values) + 7) // 8, "little")


def unpacked_bits(data: bytes, count: int) -> tuple[int, ...]:
    """Return the first `count` bits of `packed_bits`."""
    number = int.from_bytes(data, "little")
    return tuple(number >> i & 1 for i in range(count))


def read_answer(span: MemorySpan, answer: bytes) -> tuple[int, ...]:
    """Return the values in an answer to `read_request`. Raises Malformed: it is none."""
    size = (span.count + 7) // 8 if span.area in BITS else 2 * span.count
    if len(answer) != 2 + size or answer[0] != READS[span.area] or answer[1] != size:
        raise Malformed(answer, f"is no answer with {span.count} values of the area '{span.area}'")
    if span.area in BITS:
        return unpacked_bits(answer[2:], span.count)
    return struct.unpack(f">{span.count}H", answer[2:])


def written(request: bytes, answer: bytes) -> None:
    """Check the answer to `write_request`. Raises Malformed: it is none."""
    if answer != request[:5]:
        raise Malformed(answer, "does not confirm the values that were written")


def frame(transaction: int, unit: int, message: bytes) -> bytes:
    """Return the bytes of a request or an answer on the wire."""
    return HEAD.pack(transaction, 0, 1 + len(message), unit) + message


def take_frame(buffer: bytearray) -> tuple[int, int, bytes] | None:
    """Take transaction, unit and message from the beginning of the received bytes; None while they are not whole.

    Raises Malformed: they are no frame.
    """
    if len(buffer) < HEAD.size:
        return None
    transaction, protocol, size, unit = HEAD.unpack_from(buffer)
    if protocol != 0 or not 2 <= size <= 1 + LONGEST:
        raise Malformed(bytes(buffer), "is no Modbus frame")
    if len(buffer) < HEAD.size - 1 + size:
        return None
    message = bytes(buffer[HEAD.size : HEAD.size - 1 + size])
    del buffer[: HEAD.size - 1 + size]
    return transaction, unit, message
