"""The packets of a Robotiq TSF-85: a start byte, command, length and fields, at a period that one command sets.

Source: Robotiq's client in `pyrobotiqtactile` 0.1.2 (BSD-3). The check byte is a placeholder there, and is not tested.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pomona.executive import Float64

BAUD = 115200
START = 0x9A
AUTOSEND = 0x58
READ = 0x61
TAXELS = 28  # of each finger, 7 rows of 4
FIELDS = {0x10: 2 * TAXELS, 0x20: 2, 0x30: 6, 0x40: 6, 0x50: 6, 0x60: 2, 0x70: 8}
"""Bytes of each kind of field: taxels, vibration, accelerations, turns, magnetic field, temperature, time."""
PRESSED = 0x10


def autosend(period_ms: int) -> bytes:
    """Return the command that lets the sensor send by itself, every 1 … 255 ms; 0 ends it."""
    return bytes([START, 0, AUTOSEND, 1, period_ms])


def take_packets(buffer: bytearray) -> tuple[list[Mapping[int, Float64]], int]:
    """Take the packets of sensors' values from a stream; bytes that belong to none are dropped.

    Returns:
        of each packet, the taxels by finger (0, 1), shape (28,) [counts]; and the number of dropped bytes.
    """
    found: list[Mapping[int, Float64]] = []
    dropped = 0
    while len(buffer) >= 4:
        size = 4 + buffer[3]
        fields = (
            _fields(bytes(buffer[4:size])) if buffer[0] == START and buffer[2] == READ else None
        )
        if buffer[0] == START and buffer[2] == READ and len(buffer) < size:
            break
        if fields is None:
            start = buffer.find(START, 1)
            lost = len(buffer) if start < 0 else start
            del buffer[:lost]
            dropped += lost
            continue
        del buffer[:size]
        found.append(fields)
    return found, dropped


def _fields(body: bytes) -> Mapping[int, Float64] | None:
    """Return the taxels by finger; None for fields that no sensor has."""
    found: dict[int, Float64] = {}
    at = 0
    while at < len(body):
        kind = body[at] & 0xF0
        finger = body[at] >> 2 & 3
        size = FIELDS.get(kind)
        if size is None or at + 1 + size > len(body):
            return None
        if kind == PRESSED:
            found[finger] = np.frombuffer(body, ">u2", TAXELS, at + 1).astype(np.float64)
        at += 1 + size
    return found
