"""Universal Robots' real-time data exchange (RTDE, version 2): a codec, and a connection that exchanges registers."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from enum import IntEnum
from itertools import accumulate, pairwise, starmap

import numpy as np

from pomona.drivers import DeviceFault, DeviceLost, Link, Malformed, Nonsense
from pomona.executive import Clock, Float64

ANSWER = 1.0  # deadline of an answer in the handshake [s]
LARGEST = 4096  # longest message of a controller [bytes]
HEADER = struct.Struct(">HB")
"""Size of the message with this header [bytes], and its kind."""
FORMATS = {
    "DOUBLE": "d",
    "INT32": "i",
    "UINT32": "I",
    "UINT64": "Q",
    "BOOL": "?",
    "UINT8": "B",
    "VECTOR6D": "6d",
}


class RtdeKind(IntEnum):
    """Kinds of messages."""

    VERSION = 86
    CONTROLLER = 118
    TEXT = 77
    DATA = 85
    OUTPUTS = 79
    INPUTS = 73
    START = 83
    PAUSE = 80


class RegisterTakenError(DeviceFault):
    """Fields that the controller does not have, or that another client or a field bus writes."""


def encode(kind: int, body: bytes) -> bytes:
    """Return a message."""
    return HEADER.pack(HEADER.size + len(body), kind) + body


def decode(buffer: bytearray) -> list[tuple[RtdeKind, bytes]]:
    """Take the whole messages from the beginning of a stream. Raises Malformed: it is no RTDE."""
    found = []
    while len(buffer) >= HEADER.size:
        size, kind = HEADER.unpack_from(buffer)
        if not HEADER.size <= size <= LARGEST or kind not in iter(RtdeKind):
            raise Malformed(bytes(buffer), "is no RTDE message")
        if len(buffer) < size:
            break
        found.append((RtdeKind(kind), bytes(buffer[HEADER.size : size])))
        del buffer[:size]
    return found


class RtdeRecipe:
    """The fields of a package, in their order. Raises Malformed: types that no controller has."""

    def __init__(self, names: Sequence[str], kinds: Sequence[str]) -> None:
        formats = [FORMATS[kind] for kind in kinds]
        self._layout = struct.Struct(">B" + "".join(formats))
        ends = accumulate((6 if form == "6d" else 1 for form in formats), initial=1)
        self._parts = dict(zip(names, starmap(slice, pairwise(ends)), strict=True))

    def pack(self, number: int, values: Sequence[float]) -> bytes:
        """Return the body of a package; one value for each field."""
        return self._layout.pack(number, *values)

    def unpack(self, body: bytes) -> dict[str, tuple[float, ...]]:
        """Return the values of each field. Raises Malformed: the body has another length."""
        if len(body) != self._layout.size:
            raise Malformed(body, f"is no package of {self._layout.size} bytes")
        values = self._layout.unpack(body)
        return {name: values[part] for name, part in self._parts.items()}


class RtdeSession:
    """Subscribes to output fields and writes input fields, until something fails. It belongs to one thread.

    Attributes:
        heard_at: when the newest package came, on the cell's clock [s].
        version: of the controller's software: major, minor, bugfix, build.
    """

    def __init__(
        self,
        device: str,
        link: Link,
        clock: Clock,
        outputs: Sequence[str],
        inputs: Sequence[str],
        rate: float,
    ) -> None:
        """Shake hands, start, and wait for the first package; `rate` is of packages [1/s].

        Raises:
            DeviceLost, OSError: no controller answers.
            DeviceFault: it is too old, or fields are missing or taken.
        """
        self._device = device
        self._link = link
        self._clock = clock
        self._buffer = bytearray()
        self._fields: dict[str, tuple[float, ...]] = {}
        self._outputs: RtdeRecipe | None = None
        self.heard_at = clock.now()
        if self._ask(RtdeKind.VERSION, struct.pack(">H", 2)) != b"\x01":
            raise DeviceFault(
                device, "its RTDE has no version 2: update PolyScope to 3.12 or 5.6 at least"
            )
        self.version = struct.unpack(">4I", self._ask(RtdeKind.CONTROLLER, b"").ljust(16)[:16])
        _, self._outputs = self._agree(RtdeKind.OUTPUTS, struct.pack(">d", rate), outputs)
        self._number, self._inputs = (
            self._agree(RtdeKind.INPUTS, b"", inputs) if inputs else (0, RtdeRecipe((), ()))
        )
        if self._ask(RtdeKind.START, b"") != b"\x01":
            raise DeviceFault(device, "its RTDE refuses to start")
        end = clock.now() + ANSWER
        while not self._fields:
            self.receive(0.01)
            if clock.now() > end:
                raise DeviceLost(device, f"sent no package within {ANSWER:g} s")

    def receive(self, patience: float) -> bool:
        """Take in packages, waiting up to `patience` [s]; whether one came.

        Raises OSError: the connection failed; Nonsense: bytes that are no package.
        """
        fresh = False
        for kind, body in self._messages(patience):
            if kind is RtdeKind.DATA and self._outputs is not None:
                try:
                    self._fields = self._outputs.unpack(body)
                except Malformed as error:
                    raise Nonsense(self._device, error) from error
                self.heard_at = self._clock.now()
                fresh = True
        return fresh

    def write(self, values: Sequence[float]) -> None:
        """Set all input fields; they take effect together. Raises OSError: the connection failed."""
        self._link.send(encode(RtdeKind.DATA, self._inputs.pack(self._number, values)))

    def whole(self, name: str) -> int:
        """Return the newest value of an integer field."""
        return int(self._fields[name][0])

    def number(self, name: str) -> float:
        """Return the newest value of a field."""
        return float(self._fields[name][0])

    def vector(self, name: str) -> Float64:
        """Return the newest value of a field of six, (6,)."""
        return np.array(self._fields[name], dtype=np.float64)

    def close(self) -> None:
        """Disconnect; the controller's script ends without the heart beat."""
        self._link.close()

    def _agree(self, kind: RtdeKind, head: bytes, names: Sequence[str]) -> tuple[int, RtdeRecipe]:
        answer = self._ask(kind, head + ",".join(names).encode())
        kinds = answer[1:].decode("ascii", "replace").split(",")
        if len(kinds) != len(names):
            raise Nonsense(self._device, Malformed(answer, f"has no types for {len(names)} fields"))
        wrong = [
            f"{name} ({kind})"
            for name, kind in zip(names, kinds, strict=True)
            if kind not in FORMATS
        ]
        if wrong:
            other = "another run, another RTDE client or a field bus writes them"
            who = other if "IN_USE" in kinds else "this controller lacks them"
            raise RegisterTakenError(
                self._device, f"RTDE refuses {len(wrong)} fields, such as {wrong[0]}: {who}"
            )
        return answer[0], RtdeRecipe(names, kinds)

    def _ask(self, kind: RtdeKind, body: bytes) -> bytes:
        self._link.send(encode(kind, body))
        end = self._clock.now() + ANSWER
        while self._clock.now() < end:
            for came, answer in self._messages(0.01):
                if came is kind and answer:
                    return answer
        raise DeviceLost(self._device, f"RTDE did not answer within {ANSWER:g} s")

    def _messages(self, patience: float) -> list[tuple[RtdeKind, bytes]]:
        self._buffer += self._link.receive(patience)
        try:
            return decode(self._buffer)
        except Malformed as error:
            raise Nonsense(self._device, error) from error
