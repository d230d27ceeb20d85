"""The stream of a Robotiq FT 300: frames of 16 bytes, 100 a second, that one write to a Modbus register starts."""

from __future__ import annotations

import struct

import numpy as np

from pomona.devices.robotiq.codec import crc
from pomona.executive import Float64

START_STREAM = bytes.fromhex("09 10 01 9a 00 01 02 02 00 cd ca")
"""Request that starts the stream: 0x0200 to register 410 (FT 300 instruction manual)."""
STOP = b"\xff" * 50
"""Bytes that end a stream."""
HEAD = b"\x20\x4e"
FRAME = struct.Struct("<2s6h2s")
SCALE = np.array([0.01, 0.01, 0.01, 0.001, 0.001, 0.001])  # of one count [N, N·m]
RANGE = 300.0  # of the force along an axis [N]


def take_frames(buffer: bytearray) -> tuple[list[Float64], int]:
    """Take the frames from a stream; bytes that belong to none are dropped.

    Returns:
        wrenches, shape (6,) each [N, N·m], and the number of dropped bytes.
    """
    found = []
    dropped = 0
    while len(buffer) >= FRAME.size:
        head, *counts, check = FRAME.unpack_from(buffer)
        if head == HEAD and crc(bytes(buffer[: FRAME.size - 2])) == check:
            found.append(SCALE * np.array(counts, dtype=np.float64))
            del buffer[: FRAME.size]
            continue
        start = buffer.find(HEAD, 1)
        lost = len(buffer) - 1 if start < 0 else start
        del buffer[:lost]
        dropped += lost
    return found, dropped
