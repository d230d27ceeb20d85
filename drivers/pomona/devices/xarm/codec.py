"""UFACTORY's protocol: requests to registers with one answer each (port 502), and pushed reports (port 30003)."""

from __future__ import annotations

import re
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from pomona.drivers import Malformed
from pomona.executive import Float64

PLACES = 7  # joints of every message; arms with fewer leave the last ones 0
# report, with its joints, and message of a controller [bytes]
SHORTEST = 35
LARGEST = 1024
HEADER = struct.Struct(">HHH")
"""Transaction, protocol, number of bytes that follow."""
PROTOCOLS = (2, 3)
"""3 is answered to clients that send heart beats."""
ERROR = 0x40
WARNING = 0x20
NOT_READY = 0x10
INVALID = 0x08
"""Flags of each answer."""
_REPORT = struct.Struct(">IB")
_JOINTS = struct.Struct(f"<{PLACES}f")
_SERVO = struct.Struct(f"<{PLACES + 3}f")
_IDENTITY = re.compile(r"(\d+),(\d+),[^,]*,[^,]*,\D*(\d+)\.(\d+)\.(\d+)")


class Register(IntEnum):
    """Registers that the driver uses."""

    VERSION = 1
    MOTION_ENABLE = 11
    SET_STATE = 12
    GET_STATE = 13
    QUEUED = 14
    ERROR = 15
    CLEAN_ERROR = 16
    CLEAN_WARNING = 17
    SET_MODE = 19
    SERVO_JOINTS = 29
    JOINTS = 42


@dataclass(frozen=True, slots=True)
class XArmAnswer:
    """The answer to a request; `flags` are those of the controller at that moment."""

    transaction: int
    register: int
    flags: int
    body: bytes


@dataclass(frozen=True, slots=True)
class Report:
    """State (1 moving, 2 ready, 3 paused, 4 stopped), mode (1 servo); its other fields are read by requests."""

    state: int
    mode: int


def encode(transaction: int, register: int, parameters: bytes = b"") -> bytes:
    """Return a request."""
    return (
        HEADER.pack(transaction, PROTOCOLS[0], 1 + len(parameters)) + bytes([register]) + parameters
    )


def decode_answers(buffer: bytearray) -> list[XArmAnswer]:
    """Take the whole answers from the beginning of a stream. Raises Malformed: it is another protocol."""
    found = []
    while len(buffer) >= HEADER.size:
        transaction, protocol, size = HEADER.unpack_from(buffer)
        if protocol not in PROTOCOLS or not 2 <= size <= LARGEST:
            raise Malformed(bytes(buffer), "is no answer of a UFACTORY controller")
        whole = HEADER.size + size
        if len(buffer) < whole:
            break
        register, flags = buffer[HEADER.size : HEADER.size + 2]
        found.append(
            XArmAnswer(transaction, register, flags, bytes(buffer[HEADER.size + 2 : whole]))
        )
        del buffer[:whole]
    return found


def decode_reports(buffer: bytearray) -> list[Report]:
    """Take the whole reports from the beginning of a stream. Raises Malformed: it is another protocol."""
    found = []
    while len(buffer) >= _REPORT.size:
        size, status = _REPORT.unpack_from(buffer)
        if not SHORTEST <= size <= LARGEST:
            raise Malformed(bytes(buffer), "is no report of a UFACTORY controller")
        if len(buffer) < size:
            break
        found.append(Report(status & 0x0F, status >> 4))
        del buffer[:size]
    return found


def servo_point(q: Sequence[float]) -> bytes:
    """Return the parameters of a set-point in servo mode, for joints [rad]; speeds and time are not used there."""
    return _SERVO.pack(*q, *([0.0] * (PLACES + 3 - len(q))))


def joints(body: bytes) -> tuple[Float64, Float64]:
    """Return positions [rad] and velocities [rad/s], shape (7,) each, of an answer to JOINTS with the count 2.

    Raises Malformed: it has another length.
    """
    if len(body) != 2 * _JOINTS.size:
        raise Malformed(body, f"has not the {2 * _JOINTS.size} bytes of positions and velocities")
    return np.array(_JOINTS.unpack_from(body)), np.array(_JOINTS.unpack_from(body, _JOINTS.size))


def identity(body: bytes) -> tuple[str, tuple[int, ...]]:
    """Return a robot's model, as in the cell file, and its firmware's version, of an answer to VERSION.

    Such as "6,6,XI1304…,AC1304…,v2.5.0": axes, type, serial numbers, firmware.

    Raises Malformed: it is in another form.
    """
    found = _IDENTITY.search(body.split(b"\0")[0].decode("ascii", "replace"))
    if found is None:
        raise Malformed(body, "is no version of a UFACTORY controller")
    axes, kind, *version = (int(number) for number in found.groups())
    return {(6, 9): "lite6", (6, 12): "850"}.get((axes, kind), f"xarm{axes}"), tuple(version)
