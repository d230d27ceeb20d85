"""Frames of the WSG's binary command set in a stream of bytes.

AA AA AA | id u8 | length u16LE | payload | CRC u16LE
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field

PREAMBLE = b"\xaa\xaa\xaa"
# longest payload [bytes]; the longest known has 34. Bounds the damage of a wrong length
MAX_PAYLOAD = 64


@dataclass(frozen=True, slots=True)
class WireFrame:
    """One frame with a valid checksum."""

    command: int
    payload: bytes


def _table() -> tuple[int, ...]:
    table = []
    for index in range(256):
        value = index << 8
        for _ in range(8):
            value = (value << 1 ^ 0x1021 if value & 0x8000 else value << 1) & 0xFFFF
        table.append(value)
    return tuple(table)


_TABLE = _table()


def checksum(chunk: bytes | bytearray) -> int:
    """The WSG's CRC: the table of 0x1021 (most significant bit first), run from the other end. 0 over a whole frame."""
    crc = 0xFFFF
    for byte in chunk:
        crc = _TABLE[(crc ^ byte) & 0xFF] ^ crc >> 8
    return crc


def encode_frame(frame: WireFrame) -> bytes:
    """Return the bytes of a frame."""
    head = PREAMBLE + struct.pack("<BH", frame.command, len(frame.payload)) + frame.payload
    return head + struct.pack("<H", checksum(head))


@dataclass(slots=True)
class FrameDecoder:
    """Finds frames in a stream of bytes."""

    discarded: int = 0  # bytes so far that belonged to no frame
    _buffer: bytearray = field(default_factory=bytearray)

    def decode(self, chunk: bytes) -> list[WireFrame]:
        """Return the frames that are complete with these bytes, in order."""
        self._buffer += chunk
        return self._scan(final=False)

    def flush(self) -> list[WireFrame]:
        """The frames hidden behind an unfinished one, when nothing more will come of it (the line fell silent)."""
        return self._scan(final=True)

    def _scan(self, final: bool) -> list[WireFrame]:
        frames: list[WireFrame] = []
        buffer = self._buffer
        position = 0
        while True:
            start = buffer.find(PREAMBLE, position)
            if start < 0:
                # The last two bytes may be the beginning of a preamble.
                start = len(buffer) if final else max(position, len(buffer) - 2)
                self.discarded += start - position
                position = start
                break
            self.discarded += start - position
            position = start
            length = (
                int.from_bytes(buffer[start + 4 : start + 6], "little")
                if len(buffer) >= start + 6
                else 0
            )
            end = start + 8 + length
            if length <= MAX_PAYLOAD and end > len(buffer) and not final:
                break
            if length <= MAX_PAYLOAD and end <= len(buffer) and checksum(buffer[start:end]) == 0:
                frames.append(WireFrame(buffer[start + 3], bytes(buffer[start + 6 : end - 2])))
                position = end
            else:
                position += 1
                self.discarded += 1
        del buffer[:position]
        return frames
