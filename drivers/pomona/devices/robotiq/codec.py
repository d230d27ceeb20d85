"""Robotiq's registers, and the Modbus RTU frames that write and read them in one exchange (function 23)."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from functools import lru_cache

from pomona.drivers import Malformed

SLAVE = 9  # the grippers' address on the bus when they are delivered
# first register of commands, of the status; three of each
WRITTEN = 0x03E8
READ = 0x07D0
REGISTERS = 3
BOTH = 23  # function: write and read registers
HEAD = struct.Struct(">BBHHHHB")
ACTIVE = 3  # activation status of a gripper that takes commands
# object detection: stopped by something while it opened, closed; at its position
OPENING = 1
CLOSING = 2
THERE = 3

_ACTIVATE = "look for what blocks the fingers, then activate it at the pendant, or start with 'activate: yes' and --cleared"
FAULTS = {
    5: "waits for its activation to end",
    7: f"is not activated, as after its power was off: {_ACTIVATE}",
    8: "is too hot; let it cool down",
    10: "has too little supply voltage; check its power supply",
    11: "is opening by itself: its automatic release was commanded; wait for its end",
    12: "has an internal fault; switch its power off and on",
    13: f"could not be activated: {_ACTIVATE}",
    14: "drew too much current; look for what blocks the fingers",
    15: f"has opened by itself, by its automatic release: {_ACTIVATE}",
}
"""Faults by their code (instruction manual, gFLT). 9 is the time without communication before the connection."""


@dataclass(frozen=True, slots=True)
class RobotiqCommand:
    """Activation, motion allowed, and position, speed and force in counts of 0 … 255."""

    active: bool = True
    go: bool = False
    position: int = 0
    speed: int = 0
    force: int = 0

    def encode(self) -> bytes:
        """Return the registers."""
        return bytes([self.active | self.go << 3, 0, 0, self.position, self.speed, self.force])


@dataclass(frozen=True, slots=True)
class RobotiqStatus:
    """Activation status, object detection, fault code, position that was requested, and position, in counts.

    Attributes:
        go: whether motion is allowed.
    """

    activation: int
    object: int
    fault: int
    requested: int
    position: int
    go: int

    @property
    def holds(self) -> bool:
        """Whether something has stopped fingers that may still press on it."""
        return bool(self.go) and self.object in (OPENING, CLOSING)

    @property
    def problem(self) -> str:
        """Fault of the gripper in words; empty without one."""
        inactive = "" if self.activation == ACTIVE else FAULTS[7]
        return FAULTS.get(self.fault, inactive)

    @classmethod
    def decode(cls, registers: bytes) -> RobotiqStatus:
        """Return the status in the registers, six bytes."""
        first, _, fault, requested, position, _ = registers
        return cls(first >> 4 & 3, first >> 6, fault & 15, requested, position, first >> 3 & 1)


@lru_cache(64)
def crc(message: bytes) -> bytes:
    """Return Modbus' check sum, low byte first."""
    check = 0xFFFF
    for byte in message:
        check ^= byte
        for _ in range(8):
            check = (check >> 1) ^ 0xA001 if check & 1 else check >> 1
    return check.to_bytes(2, "little")


def request(command: RobotiqCommand | None, slave: int = SLAVE) -> bytes:
    """Return the frame that writes a command and reads the status; without a command it only reads."""
    if command is None:
        frame = struct.pack(">BBHH", slave, 4, READ, REGISTERS)
    else:
        registers = command.encode()
        frame = (
            HEAD.pack(slave, BOTH, READ, REGISTERS, WRITTEN, REGISTERS, len(registers)) + registers
        )
    return frame + crc(frame)


def answer(buffer: bytearray, slave: int = SLAVE) -> RobotiqStatus | None:
    """Take the answer from the beginning of the received bytes, or return None while it is not whole.

    Raises Malformed: it is none, or the gripper refuses the request.
    """
    if len(buffer) < 5:
        return None
    refused = buffer[1] & 0x80
    size = 5 if refused else 5 + buffer[2]
    if (
        buffer[0] != slave
        or buffer[1] & 0x7F not in (4, BOTH)
        or (not refused and buffer[2] != 2 * REGISTERS)
    ):
        raise Malformed(bytes(buffer), f"is no answer of a gripper at the Modbus address {slave}")
    if len(buffer) < size:
        return None
    frame = bytes(buffer[:size])
    del buffer[:size]
    if crc(frame[:-2]) != frame[-2:]:
        raise Malformed(frame, "has a wrong check sum")
    if refused:
        raise Malformed(frame, f"refuses the request with the Modbus exception {frame[2]}")
    return RobotiqStatus.decode(frame[3:-2])
