"""Codec of MotoROS' simple message protocol: messages as frozen dataclasses, and a decoder for a stream of bytes.

    length i32 (of the rest) | type i32 | communication i32 | reply i32 | body

All numbers are i32 or f32, in the controller's byte order: big-endian on the FS100, little-endian on DX and YRC. Joints
are in the wire's order S, L, E, U, R, B, T, filled up to ten.
"""

from __future__ import annotations

import math
import struct
from dataclasses import astuple, dataclass
from enum import IntEnum, IntFlag
from typing import ClassVar, Literal, get_args

from pomona.drivers import Malformed

Order = Literal["<", ">"]

JOINTS = 10
Ten = tuple[float, ...]
ZEROS: Ten = (0.0,) * JOINTS


class Communication(IntEnum):
    """Role of a message in the exchange."""

    TOPIC = 1
    REQUEST = 2
    REPLY = 3


class Valid(IntFlag):
    """Which fields of a point or a feedback mean something."""

    TIME = 1
    POSITION = 2
    VELOCITY = 4
    ACCELERATION = 8


class Control(IntEnum):
    """Commands of a MotionControl."""

    CHECK_READY = 200101
    CHECK_QUEUE = 200102
    STOP = 200111
    SERVO_ON = 200112
    SERVO_OFF = 200113
    RESET_ALARM = 200114
    START_TRAJECTORY_MODE = 200121
    STOP_TRAJECTORY_MODE = 200122
    DISCONNECT = 200130


class Result(IntEnum):
    """Results of a MotionReply."""

    SUCCESS = 0
    BUSY = 1
    FAILURE = 2
    INVALID = 3
    ALARM = 4
    NOT_READY = 5
    MOTION_FAILURE = 6


@dataclass(frozen=True, slots=True)
class Ping:
    """Are you there?"""

    TYPE: ClassVar[int] = 1
    LAYOUT: ClassVar[str] = ""


@dataclass(frozen=True, slots=True)
class RobotStatus:
    """Pushed on the state connection; every flag is 1, 0, or −1 for unknown; mode 1 is teach, 2 is play."""

    TYPE: ClassVar[int] = 13
    LAYOUT: ClassVar[str] = "7i"
    drives_powered: int
    e_stopped: int
    error_code: int
    in_error: int
    in_motion: int
    mode: int
    motion_possible: int


@dataclass(frozen=True, slots=True)
class TrajectoryPoint:
    """A point of a trajectory: time from its start [s], positions [rad], velocities [rad/s], accelerations."""

    TYPE: ClassVar[int] = 14
    LAYOUT: ClassVar[str] = "3if30f"
    group: int
    sequence: int
    valid: int
    time: float
    position: Ten
    velocity: Ten
    acceleration: Ten = ZEROS


@dataclass(frozen=True, slots=True)
class JointFeedback:
    """Pushed on the state connection about every 25 ms."""

    TYPE: ClassVar[int] = 15
    LAYOUT: ClassVar[str] = "2if30f"
    group: int
    valid: int
    time: float
    position: Ten
    velocity: Ten = ZEROS
    acceleration: Ten = ZEROS


@dataclass(frozen=True, slots=True)
class MotionControl:
    """A command (`Control`) on the motion connection."""

    TYPE: ClassVar[int] = 2001
    LAYOUT: ClassVar[str] = "3i10f"
    group: int
    sequence: int
    command: int
    values: Ten = ZEROS


@dataclass(frozen=True, slots=True)
class MotionReply:
    """The answer to a MotionControl or a TrajectoryPoint: a `Result`, and a subcode (see `motoman.words`)."""

    TYPE: ClassVar[int] = 2002
    LAYOUT: ClassVar[str] = "5i10f"
    group: int
    sequence: int
    command: int
    result: int
    subcode: int
    values: Ten = ZEROS


Body = Ping | RobotStatus | TrajectoryPoint | JointFeedback | MotionControl | MotionReply
_BODIES: dict[int, type[Body]] = {body.TYPE: body for body in get_args(Body)}
_SIZES = {kind: 16 + struct.calcsize("<" + body.LAYOUT) for kind, body in _BODIES.items()}
"""Bytes of a whole message by type."""


@dataclass(frozen=True, slots=True)
class Message:
    """A body and its place in the exchange; `reply` is 0, or 1 for success and 2 for failure."""

    body: Body
    communication: Communication
    reply: int = 0


def encode(message: Message, order: Order) -> bytes:
    """Return the bytes of a message in a byte order."""
    body = message.body
    numbers: list[float] = []
    for value in astuple(body):
        if isinstance(value, tuple):
            numbers += [*value, *ZEROS[len(value) :]]
        else:
            numbers.append(value)
    size = _SIZES[body.TYPE] - 4
    return struct.pack(
        f"{order}4i{body.LAYOUT}", size, body.TYPE, message.communication, message.reply, *numbers
    )


class MessageDecoder:
    """Finds messages in a stream of bytes; after damage it goes on with the next intact one.

    There is no checksum: an invalid header or a value that is not finite marks garbage.

    Attributes:
        discarded: bytes so far that belonged to no message.
        garbage: the first of them since `complain`, for the error's text.
    """

    def __init__(self, order: Order) -> None:
        self.discarded = 0
        self.garbage = b""
        self._order: Order = order
        self._header = struct.Struct(f"{order}4i")
        self._buffer = bytearray()
        # bytes of the last message, which stay at the buffer's beginning for `_look_back`
        self._taken = 0

    def decode(self, chunk: bytes) -> list[Message]:
        """Return the messages that are complete with these bytes, in order."""
        self._buffer += chunk
        return self._scan(final=False)

    def flush(self) -> list[Message]:
        """Return the messages hidden behind an unfinished one, when nothing more will come of it."""
        return self._scan(final=True)

    def complain(self) -> None:
        """Raise if bytes came that are no message. Raises Malformed: with the first of them."""
        if self.garbage:
            garbage = self.garbage
            self.garbage = b""
            raise Malformed(garbage, "bytes that are no simple message in this byte order")

    def _scan(self, final: bool) -> list[Message]:
        messages: list[Message] = []
        buffer = self._buffer
        position = self._taken
        while len(buffer) - position >= 16:
            size = self._size(position)
            if size is None:
                position = 0 if self._look_back(position) else self._discard(position)
                continue
            if len(buffer) - position < size and not final:
                break
            body = self._body(position, size)
            if body is None:
                position = self._discard(position)
                continue
            _, _, communication, reply = self._header.unpack_from(buffer, position)
            messages.append(Message(body, Communication(communication), reply))
            del buffer[:position]
            self._taken = position = size
        while final and position < len(buffer):
            position = self._discard(position)
        if position != self._taken:
            del buffer[:position]
            self._taken = 0
        return messages

    def _look_back(self, position: int) -> bool:
        """Go back to a message that begins inside the one just taken: that one had lost bytes, and took some of it."""
        places = range(1, position) if position == self._taken else ()
        place = next((place for place in places if self._size(place) is not None), None)
        if place is not None:
            del self._buffer[:place]
            self._taken = 0
        return place is not None

    def _size(self, position: int) -> int | None:
        """Return the size of the message whose header is at this position; None without a header."""
        length, kind, communication, reply = self._header.unpack_from(self._buffer, position)
        size = _SIZES.get(kind)
        right = (
            size is not None and length + 4 == size and 1 <= communication <= 3 and 0 <= reply <= 2
        )
        return size if right else None

    def _discard(self, position: int) -> int:
        if len(self.garbage) < 64:
            self.garbage += self._buffer[position : position + 1]
        self.discarded += 1
        return position + 1

    def _body(self, position: int, size: int) -> Body | None:
        """Return the body of the message here; None when it is not complete, or a value is not finite."""
        if len(self._buffer) - position < size:
            return None
        body = _BODIES[self._header.unpack_from(self._buffer, position)[1]]
        numbers = struct.unpack_from(self._order + body.LAYOUT, self._buffer, position + 16)
        if not all(map(math.isfinite, numbers)):
            return None
        if "f" not in body.LAYOUT:
            return body(*numbers)
        tens = 3 if body.LAYOUT.endswith("30f") else 1
        singles = len(numbers) - tens * JOINTS
        lists = (numbers[singles + i * JOINTS : singles + (i + 1) * JOINTS] for i in range(tens))
        return body(*numbers[:singles], *lists)
