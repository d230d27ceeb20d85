"""The two ways to a gripper: Modbus RTU on a serial line of our own, and the text socket of Robotiq's URCap."""

from __future__ import annotations

from typing import Protocol

from pomona.devices.robotiq.codec import (
    ACTIVE,
    SLAVE,
    RobotiqCommand,
    RobotiqStatus,
    answer,
    request,
)
from pomona.drivers import DeviceFault, Link, Malformed
from pomona.executive import Clock

BAUD = 115200  # of the grippers when they are delivered [bit/s]
SPACING = 0.005  # least time between requests [s] (instruction manual: 200 Hz at most)
REPEAT = 0.03  # a request without an answer is sent again after this time [s]; an answer takes 4 ms at 115 200 baud


class RobotiqSession(Protocol):
    """Exchanges commands for the status."""

    def serve(self, command: RobotiqCommand | None, patience: float) -> RobotiqStatus | None:
        """Send the command when the wire is free, and return a status that has come, waiting up to `patience` [s].

        Without a command the gripper is only read.
        Raises OSError: the wire failed; Malformed: no gripper answers; DeviceFault: another program commands it.
        """

    def close(self) -> None: ...


class RtuSession:
    """Modbus RTU: one exchange writes the command and reads the status, about 100 a second."""

    def __init__(self, link: Link, clock: Clock, unit: int = SLAVE) -> None:
        """`unit`: the gripper's Modbus address."""
        self._link = link
        self._clock = clock
        self._unit = unit
        self._buffer = bytearray()
        self._asked_at = -1.0
        self._waiting = False

    def serve(self, command: RobotiqCommand | None, patience: float) -> RobotiqStatus | None:
        now = self._clock.now()
        if now - self._asked_at >= (REPEAT if self._waiting else SPACING):
            self._buffer.clear()
            self._link.send(request(command, self._unit))
            self._asked_at = now
            self._waiting = True
        self._buffer += self._link.receive(patience)
        try:
            status = answer(self._buffer, self._unit)
        except Malformed:
            self._buffer.clear()  # noise on the line: the request is repeated
            raise
        self._waiting = self._waiting and status is None
        return status

    def close(self) -> None:
        self._link.close()


QUESTIONS = {
    "STA": "activation",
    "OBJ": "object",
    "FLT": "fault",
    "PRE": "requested",
    "POS": "position",
    "GTO": "go",
}
"""Questions of the URCap by the field of the status that each answers."""


FOREIGN = "another program commands it: only one may, so stop the other one"


class UrcapSession:
    """The URCap on a UR: lines of text, one question at a time, about 30 statuses a second."""

    def __init__(self, link: Link, clock: Clock, device: str = "gripper") -> None:
        self._link = link
        self._clock = clock
        self._device = device
        # positions that may be requested now: the newest that was (None: any), and those sent since
        self._ours: list[int | None] = [None]
        self._buffer = b""
        self._sent: RobotiqCommand | None = None
        self._told: dict[str, int] = {}
        self._asked = ""
        self._go: bool | None = None  # of the newest command, or as it was read
        self._was_read = False
        self._is_foreign = (
            False  # unless its power was off: that shows with the next activation status
        )

    def serve(self, command: RobotiqCommand | None, patience: float) -> RobotiqStatus | None:
        if not self._asked:
            self._ask(command)
        self._buffer += self._link.receive(patience)
        if self._asked == "SET":
            if b"ack" in self._buffer:
                self._buffer = self._buffer.split(b"ack", 1)[1].lstrip()
                self._asked = ""
            return None
        if b"\n" not in self._buffer:
            return None
        line, self._buffer = self._buffer.split(b"\n", 1)
        name, _, number = line.decode("ascii", "replace").partition(" ")
        if name != self._asked or not number.strip().isdigit():
            raise Malformed(line, f"is no answer to GET {self._asked}")
        self._told[QUESTIONS[name]], self._asked = int(number), ""
        if name == "STA":
            is_foreign = self._is_foreign
            self._is_foreign = False
            if is_foreign and self._told["activation"] == ACTIVE:
                raise DeviceFault(self._device, FOREIGN)
        if name == "PRE" and self._told["activation"] == ACTIVE:
            self._own(int(number))
        if len(self._told) < len(QUESTIONS):
            return None
        status = RobotiqStatus(**self._told)
        self._told = {}
        if status.activation == ACTIVE:
            self._require_go(bool(status.go))
        return status

    def _own(self, position: int) -> None:
        """Look whether a requested position is one of ours."""
        ours = [position, *self._ours[1:]] if self._ours[0] is None else self._ours
        self._ours = ours[ours.index(position) :] if position in ours else [position]
        self._is_foreign |= position not in ours

    def _require_go(self, go: bool) -> None:
        """Send a command again that is not read back; one that was, and is not any more, is another program's."""
        was_read = self._was_read
        self._was_read = True
        expected = self._go
        self._go = go
        if expected is None or go is expected:
            return
        if was_read:
            self._is_foreign = True
            return
        self._sent = None
        self._was_read = False

    def _ask(self, command: RobotiqCommand | None) -> None:
        if command is not None and command != self._sent:
            self._sent = command
            self._asked = "SET"
            self._go = command.go
            self._was_read = False
            self._ours.append(command.position)
            values = {
                "ACT": command.active,
                "POS": command.position,
                "SPE": command.speed,
                "FOR": command.force,
            }
            told = " ".join(
                f"{name} {int(number)}" for name, number in (values | {"GTO": command.go}).items()
            )
            self._link.send(f"SET {told}\n".encode())
        else:
            self._asked = next(name for name, field in QUESTIONS.items() if field not in self._told)
            self._link.send(f"GET {self._asked}\n".encode())

    def close(self) -> None:
        self._link.close()
