"""The WSG's binary command set: requests and replies as frozen dataclasses.

Wire units are mm, mm/s, mm/s² and N; the dataclasses are in SI units. `pomona.devices.wsg.frame.FrameDecoder` finds
frames in a stream of bytes, `decode_reply` and `decode_request` interpret a frame.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from enum import IntEnum, IntFlag
from typing import ClassVar

from pomona.devices.wsg.frame import WireFrame, encode_frame
from pomona.drivers import Malformed


class Command(IntEnum):
    """Ids of messages."""

    DISCONNECT = 0x07
    HOMING = 0x20
    MOVE = 0x21
    STOP = 0x22
    FAST_STOP = 0x23
    ACKNOWLEDGE = 0x24
    SET_ACCELERATION = 0x30
    GET_ACCELERATION = 0x31
    SET_FORCE_LIMIT = 0x32
    GET_FORCE_LIMIT = 0x33
    SET_SOFT_LIMITS = 0x34
    CLEAR_SOFT_LIMITS = 0x36
    SYSTEM_STATE = 0x40
    WIDTH = 0x43
    SPEED = 0x44
    INFO = 0x50
    LIMITS = 0x53
    SCRIPT_READ = 0xB0
    SCRIPT_SPEED = 0xB2


class Status(IntEnum):
    """The first field of every reply."""

    SUCCESS = 0
    NOT_AVAILABLE = 1
    NO_SENSOR = 2
    NOT_INITIALIZED = 3
    ALREADY_RUNNING = 4
    FEATURE_NOT_SUPPORTED = 5
    INCONSISTENT_DATA = 6
    TIMEOUT = 7
    READ_ERROR = 8
    WRITE_ERROR = 9
    INSUFFICIENT_RESOURCES = 10
    CHECKSUM_ERROR = 11
    NO_PARAM_EXPECTED = 12
    NOT_ENOUGH_PARAMS = 13
    CMD_UNKNOWN = 14
    CMD_FORMAT_ERROR = 15
    ACCESS_DENIED = 16
    ALREADY_OPEN = 17
    CMD_FAILED = 18
    CMD_ABORTED = 19
    INVALID_HANDLE = 20
    NOT_FOUND = 21
    NOT_OPEN = 22
    IO_ERROR = 23
    INVALID_PARAMETER = 24
    INDEX_OUT_OF_BOUNDS = 25
    CMD_PENDING = 26
    OVERRUN = 27
    RANGE_ERROR = 28
    AXIS_BLOCKED = 29
    FILE_EXISTS = 30


class SystemState(IntFlag):
    """Bits of the system state."""

    REFERENCED = 1 << 0
    MOVING = 1 << 1
    BLOCKED_MINUS = 1 << 2
    BLOCKED_PLUS = 1 << 3
    SOFT_LIMIT_MINUS = 1 << 4
    SOFT_LIMIT_PLUS = 1 << 5
    AXIS_STOPPED = 1 << 6
    TARGET_REACHED = 1 << 7
    FORCE_MODE = 1 << 9
    FAST_STOP = 1 << 12
    TEMPERATURE_WARNING = 1 << 13
    TEMPERATURE = 1 << 14
    POWER = 1 << 15
    CURRENT = 1 << 16
    FINGER_FAULT = 1 << 17
    COMMAND_FAILURE = 1 << 18
    SCRIPT_RUNNING = 1 << 19
    SCRIPT_FAILURE = 1 << 20


# ---------------------------------------------------------------------------------------------------- requests


@dataclass(frozen=True, slots=True)
class Plain:
    """A request without parameters: STOP, FAST_STOP, ACKNOWLEDGE, DISCONNECT, INFO, LIMITS, any GET or CLEAR."""

    command: Command


@dataclass(frozen=True, slots=True)
class Homing:
    """Find the reference: 0 in the default direction, 1 opening, 2 closing."""

    command: ClassVar[Command] = Command.HOMING
    direction: int = 0


@dataclass(frozen=True, slots=True)
class Move:
    """Move the jaws to a width [m] with a speed [m/s]."""

    command: ClassVar[Command] = Command.MOVE
    width: float
    speed: float


@dataclass(frozen=True, slots=True)
class SetValue:
    """SET_ACCELERATION [m/s²] or SET_FORCE_LIMIT [N]."""

    command: Command
    value: float


@dataclass(frozen=True, slots=True)
class SetSoftLimits:
    """Keep the width [m] between two limits."""

    command: ClassVar[Command] = Command.SET_SOFT_LIMITS
    minus: float
    plus: float


@dataclass(frozen=True, slots=True)
class Observe:
    """Ask for SYSTEM_STATE, WIDTH or SPEED once, or every `period` [s, whole milliseconds]."""

    command: Command
    auto: bool = False
    period: float = 0.0


@dataclass(frozen=True, slots=True)
class Script:
    """A request to the finger script: SCRIPT_READ, or SCRIPT_SPEED with a speed [m/s]; its width is not used."""

    command: Command
    width: float = 0.0
    speed: float = 0.0


Request = Plain | Homing | Move | SetValue | SetSoftLimits | Observe | Script

_MM = 1000.0
STOP_ON_BLOCK = 2  # flag of MOVE; without the flag 1 its width is absolute
_VALUE_SCALE = {Command.SET_ACCELERATION: _MM, Command.SET_FORCE_LIMIT: 1.0}
_PLAIN = {
    Command.DISCONNECT,
    Command.STOP,
    Command.FAST_STOP,
    Command.GET_ACCELERATION,
    Command.GET_FORCE_LIMIT,
    Command.CLEAR_SOFT_LIMITS,
    Command.INFO,
    Command.LIMITS,
}
_OBSERVABLE = {
    Command.SYSTEM_STATE,
    Command.WIDTH,
    Command.SPEED,
}
_SCRIPT = {Command.SCRIPT_READ, Command.SCRIPT_SPEED}


def encode(request: Request) -> bytes:
    """Return the bytes of a request."""
    match request:
        case Plain(Command.ACKNOWLEDGE):
            return encode_frame(WireFrame(Command.ACKNOWLEDGE, b"ack"))
        case Plain(command):
            return encode_frame(WireFrame(command, b""))
        case Homing(direction):
            return encode_frame(WireFrame(Command.HOMING, bytes([direction])))
        case Move(width, speed):
            values = struct.pack("<Bff", STOP_ON_BLOCK, width * _MM, speed * _MM)
            return encode_frame(WireFrame(Command.MOVE, values))
        case SetValue(command, value):
            return encode_frame(
                WireFrame(command, struct.pack("<f", value * _VALUE_SCALE[command]))
            )
        case SetSoftLimits(minus, plus):
            return encode_frame(
                WireFrame(Command.SET_SOFT_LIMITS, struct.pack("<ff", minus * _MM, plus * _MM))
            )
        case Observe(command, auto, period):
            return encode_frame(
                WireFrame(command, struct.pack("<BH", auto, round(period * 1000.0)))
            )
        case Script(command, width, speed):
            return encode_frame(
                WireFrame(command, struct.pack("<Bff", 0, width * _MM, speed * _MM))
            )


def decode_request(frame: WireFrame) -> Request:
    """Return the request that a frame carries (a gripper's side).

    Raises Malformed: no known command, or a payload that does not fit it.
    """
    command = _command(frame)
    payload = frame.payload
    if command is Command.ACKNOWLEDGE and payload == b"ack":
        return Plain(command)
    if command in _PLAIN and not payload:
        return Plain(command)
    if command is Command.HOMING and len(payload) == 1 and payload[0] <= 2:
        return Homing(payload[0])
    if command is Command.MOVE and len(payload) == 9:
        return Move(*_unpack(frame, "<Bff", payload, (1, _MM, _MM))[1:])
    if command in _VALUE_SCALE and len(payload) == 4:
        return SetValue(command, *_unpack(frame, "<f", payload, (_VALUE_SCALE[command],)))
    if command is Command.SET_SOFT_LIMITS and len(payload) == 8:
        return SetSoftLimits(*_unpack(frame, "<ff", payload, (_MM, _MM)))
    if command in _OBSERVABLE and len(payload) == 3 and payload[0] <= 1:
        auto, period_ms = struct.unpack("<BH", payload)
        return Observe(command, bool(auto), period_ms / 1000.0)
    if command in _SCRIPT and len(payload) == 9:
        return Script(command, *_unpack(frame, "<Bff", payload, (1, _MM, _MM))[1:])
    raise Malformed(encode_frame(frame), f"no request {command.name} has this payload")


# ----------------------------------------------------------------------------------------------------- replies


@dataclass(frozen=True, slots=True)
class Reply:
    """An answer, or an automatic update."""

    command: Command  # the answered command
    status: Status  # SUCCESS, CMD_PENDING for a motion that began, or an error
    # by command, in SI units: WIDTH, SPEED and every GET their numbers; SYSTEM_STATE its bits; SCRIPT_* width and speed;
    # INFO type, hardware, firmware, serial; LIMITS stroke, speeds (least, most), accelerations (least, most), forces
    # (least, nominal, overdrive). Empty unless SUCCESS.
    values: tuple[float, ...] = ()


_REPLY_LAYOUT: dict[Command, tuple[str, tuple[float, ...]]] = {
    Command.GET_ACCELERATION: ("<f", (_MM,)),
    Command.GET_FORCE_LIMIT: ("<f", (1.0,)),
    Command.SYSTEM_STATE: ("<I", (1,)),
    Command.WIDTH: ("<f", (_MM,)),
    Command.SPEED: ("<f", (_MM,)),
    Command.INFO: ("<BBHI", (1, 1, 1, 1)),
    Command.LIMITS: ("<8f", (_MM,) * 5 + (1.0,) * 3),
    **dict.fromkeys(_SCRIPT, ("<ff", (_MM, _MM))),
}


def encode_reply(reply: Reply) -> bytes:
    """Return the bytes of a reply (a gripper's side)."""
    body = b""
    if reply.status is Status.SUCCESS and reply.command in _REPLY_LAYOUT:
        layout, scales = _REPLY_LAYOUT[reply.command]
        body = struct.pack(
            layout, *(value * scale for value, scale in zip(reply.values, scales, strict=True))
        )
    return encode_frame(WireFrame(reply.command, struct.pack("<H", reply.status) + body))


def decode_reply(frame: WireFrame) -> Reply:
    """Return the reply that a frame carries.

    Raises Malformed: no known command or status, or values that do not fit the command.
    """
    command = _command(frame)
    if len(frame.payload) < 2:
        raise Malformed(encode_frame(frame), f"a reply to {command.name} without a status")
    code = struct.unpack_from("<H", frame.payload)[0]
    body = frame.payload[2:]
    try:
        status = Status(code)
    except ValueError:
        raise Malformed(
            encode_frame(frame), f"a reply to {command.name} with the unknown status {code}"
        ) from None
    if status is not Status.SUCCESS:
        return Reply(command, status)
    layout, scales = _REPLY_LAYOUT.get(command, ("<", ()))
    if len(body) != struct.calcsize(layout):
        raise Malformed(
            encode_frame(frame), f"a reply to {command.name} with {len(body)} bytes of values"
        )
    return Reply(command, status, _unpack(frame, layout, body, scales))


def _unpack(
    frame: WireFrame, layout: str, body: bytes, scales: tuple[float, ...]
) -> tuple[float, ...]:
    values = struct.unpack(layout, body)
    if not all(map(math.isfinite, values)):
        raise Malformed(encode_frame(frame), "a message with a value that is not a number")
    return tuple(value / scale for value, scale in zip(values, scales, strict=True))


def _command(frame: WireFrame) -> Command:
    try:
        return Command(frame.command)
    except ValueError:
        raise Malformed(encode_frame(frame), f"the unknown command 0x{frame.command:02x}") from None
