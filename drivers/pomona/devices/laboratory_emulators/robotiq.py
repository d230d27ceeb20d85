"""A Robotiq gripper that speaks its bytes: Modbus RTU, and the text socket of the URCap."""

from __future__ import annotations

import struct
from collections.abc import Callable
from functools import partial

from pomona.devices.emulators.emulated import EmulatedDevice, EmulatedWire, EmulatorKind
from pomona.devices.emulators.server import Peer
from pomona.devices.laboratory_emulators.ports import crc
from pomona.devices.robotiq.options import MODELS
from pomona.drivers import Cell, FaultSwitch, Gripper

OPEN = 3
CLOSED = 230
"""Positions of the open and of the closed gripper [counts] (Robotiq's blog: about)."""
WRITTEN = 1000
READ = 2000
"""First register of commands, and of the status."""
OPENING = 1
CLOSING = 2
THERE = 3
"""Values of gOBJ: stopped by an object while opening, while closing; at the wanted position."""
BYTE = 10 / 115200
"""Time of a byte on the line [s]."""
TURN = 0.002
"""Time from a request to its answer [s], beside that of the bytes: plausible, not measured."""
ACTIVATING = 0.3
"""Time of an activation [s]; a real one takes some seconds."""
BEHIND = 1e-3
"""Fingers without a measured force that are so far behind their motor have met something [m]."""


class RobotiqEmulator(FaultSwitch):
    """The gripper on top of any `Gripper` that moves its fingers; `rtu` and `urcap` serve its two wires.

    Faults: `silent` (no byte), `noise` (every answer has a wrong check sum), `hot` (its fault 8), `inactive` (it has
    lost its activation), `frozen` (the position does not change), `stuck` (the fingers stand still).

    Attributes:
        activation: 0, 1 while it activates, 3.
        written: registers of the newest command.
        peak: largest force of a finger while it closed [N].
        units: Modbus addresses at which it answers: all, as the only gripper of a line whose cell file may name any.
    """

    known_faults = ("silent", "noise", "hot", "inactive", "frozen", "stuck")

    def __init__(self, fingers: Gripper, model: str = "hand-e", activated: bool = True) -> None:
        super().__init__()
        self.rtu, self.urcap, self.units = _RtuPort(self), _UrcapPort(self), range(1, 248)
        self.activation = 3 if activated else 0
        self.written = bytearray([int(activated), 0, 0, 0, 0, 0])
        self.object = THERE
        self.peak = 0.0
        self.now = 0.0
        self._fingers = fingers
        self._model = MODELS[model]
        self._active_at: float | None = None
        self._then: float | None = None
        # of the motor
        self._set_point = fingers.state().width
        self._speed = 0.0
        self._frozen = self._position()

    def inject_fault(self, kind: str) -> None:
        super().inject_fault(kind)
        self._frozen = self._position()
        if kind == "inactive":
            self.activation = 0

    def clear_fault(self) -> None:
        if self.fault == "inactive":  # somebody has activated it
            self.written[0] &= 1
        super().clear_fault()
        self.activation = 3 if self.written[0] & 1 else 0

    # -------------------------------------------------------------------------------------------- time

    def advance(self, now: float) -> None:
        """Move the fingers towards the commanded position."""
        elapsed = now - (now if self._then is None else self._then)
        self._then = now
        self.now = now
        if self._active_at is not None and now >= self._active_at:
            self.activation = 3
            self._active_at = None
        state = self._fingers.state()
        goal = self._width(min(max(self.written[3], OPEN), CLOSED))
        self._set_point += self._speed * elapsed
        slowest, fastest = self._model.speeds
        speed = slowest + self.written[4] / 255.0 * (fastest - slowest)
        moves = self.activation == 3 and bool(self.written[0] & 8) and self.fault != "stuck"
        self.peak = max(self.peak, 0.5 * (state.motor_force or 0.0))
        if not moves or self._has_met(goal < self._set_point, state.motor_force, state.width):
            self._speed = 0.0
        else:
            self.object = THERE if abs(goal - self._set_point) < 0.5 * self._step else 0
            self._speed = min(max((goal - self._set_point) / max(elapsed, 1e-3), -speed), speed)
        self._fingers.set_speed(self._speed)
        self.rtu.flush()
        self.urcap.flush()

    def _has_met(self, closes: bool, motor_force: float | None, width: float) -> bool:
        """Whether the fingers have met something: its force is at the limit; without a force they do not follow."""
        least, most = self._model.forces
        limit = least + self.written[5] / 255.0 * (most - least)
        if self.object == CLOSING and motor_force == 0.0:
            self.object = 0  # what it held is gone
        if self.object in (OPENING, CLOSING):
            return True  # until another position is commanded: the screw locks itself
        behind = motor_force is None and abs(self._set_point - width) > BEHIND
        if behind or (closes and motor_force is not None and 0.5 * motor_force >= limit):
            self._set_point = width if behind else self._set_point
            self.object = CLOSING if closes else OPENING
        return self.object in (OPENING, CLOSING)

    @property
    def _step(self) -> float:
        return self._model.stroke / (CLOSED - OPEN)

    def _width(self, position: float) -> float:
        return self._fingers.limits.width_max - (position - OPEN) * self._step

    def _position(self) -> int:
        position = (
            OPEN + (self._fingers.limits.width_max - self._fingers.state().width) / self._step
        )
        return min(max(round(position), 0), 255)

    # ------------------------------------------------------------------------------------------ registers

    def write(self, at: int, data: bytes) -> None:
        """Write registers, from the byte `at` of the command on."""
        if self.fault == "inactive":
            return
        before = bytes(self.written)
        self.written[at : at + len(data)] = data
        if not self.written[0] & 1:
            self.activation = self.object = 0
            self._active_at = None
        elif not before[0] & 1:
            self.activation, self._active_at = 1, self.now + ACTIVATING
        if self.written[3] != before[3] or self.written[0] & 8 != before[0] & 8:
            self.object = 0

    def status(self) -> bytes:
        """Return the six bytes of the status."""
        first = self.written[0] & 9 | self.activation << 4 | self.object << 6
        fault = 8 if self.fault == "hot" else 7 if self.activation != 3 else 0
        position = self._frozen if self.fault == "frozen" else self._position()
        force = max(self._fingers.state().motor_force or 0.0, 0.0)
        current = 5 if self.object == 0 else min(round(force / 4.0), 255)
        return bytes([first, 0, fault, self.written[3], position, current])


class _LinePort:
    """A wire whose answers take their time."""

    def __init__(self, gripper: RobotiqEmulator) -> None:
        self._gripper = gripper
        self._buffers: dict[int, bytearray] = {}
        self._due: list[tuple[float, Peer, bytes]] = []

    def connected(self, peer: Peer) -> None:
        self._buffers[id(peer)] = bytearray()

    def disconnected(self, peer: Peer) -> None:
        self._buffers.pop(id(peer), None)
        self._due = [answer for answer in self._due if answer[1] is not peer]

    def received(self, peer: Peer, chunk: bytes) -> None:
        buffer = self._buffers[id(peer)]
        buffer += chunk
        for answer, seconds in self.answers(buffer):
            if self._gripper.fault != "silent":
                self._due.append((self._gripper.now + seconds, peer, answer))

    def answers(self, buffer: bytearray) -> list[tuple[bytes, float]]:
        """Take the whole requests; their answers, and the time of each [s]."""
        return []

    def flush(self) -> None:
        """Send the answers whose time has come."""
        for answer in tuple(self._due):
            if answer[0] <= self._gripper.now + 1e-9:
                self._due.remove(answer)
                answer[1].send(answer[2])

    def advance(self, now: float) -> None:
        """Time belongs to the gripper."""


class _RtuPort(_LinePort):
    def answers(self, buffer: bytearray) -> list[tuple[bytes, float]]:
        found = []
        while len(buffer) >= 8:
            size = {16: 9 + buffer[6], 23: 13 + buffer[10] if len(buffer) > 10 else 99}.get(
                buffer[1], 8
            )
            if buffer[0] not in self._gripper.units or buffer[1] not in (3, 4, 6, 16, 23):
                del buffer[0]
                continue
            if len(buffer) < size:
                break
            frame = bytes(buffer[:size])
            del buffer[:size]
            if crc(frame[:-2]) == frame[-2:]:
                answer = self._answer(frame)
                check = b"\0\0" if self._gripper.fault == "noise" else crc(answer)
                found.append((answer + check, (len(frame) + len(answer) + 2) * BYTE + TURN))
        return found

    def _answer(self, frame: bytes) -> bytes:
        robot = self._gripper
        function = frame[1]
        first, count = struct.unpack_from(">HH", frame, 2)
        if function in (3, 4):
            return frame[:2] + bytes([2 * count]) + self._registers(first, count)
        if function in (6, 16):
            robot.write(2 * (first - WRITTEN), frame[4:6] if function == 6 else frame[7:-2])
            return frame[:6]
        robot.write(2 * (struct.unpack_from(">H", frame, 6)[0] - WRITTEN), frame[11:-2])
        return frame[:2] + bytes([2 * count]) + self._registers(first, count)

    def _registers(self, first: int, count: int) -> bytes:
        stored = self._gripper.status() if first >= READ else bytes(self._gripper.written)
        at = 2 * (first - (READ if first >= READ else WRITTEN))
        return (stored + bytes(260))[at : at + 2 * count]


_PLACES = {"POS": 3, "SPE": 4, "FOR": 5}


class _UrcapPort(_LinePort):
    def answers(self, buffer: bytearray) -> list[tuple[bytes, float]]:
        found = []
        while b"\n" in buffer:
            end = buffer.index(b"\n")
            words = bytes(buffer[:end]).decode("ascii", "replace").split()
            del buffer[: end + 1]
            found.append((self._answer(words), 0.004))
        return found

    def _answer(self, words: list[str]) -> bytes:
        gripper = self._gripper
        if words[:1] == ["SET"]:
            registers = bytearray(gripper.written)
            for name, number in zip(words[1::2], map(int, words[2::2]), strict=False):
                if name in _PLACES:
                    registers[_PLACES[name]] = number
                else:
                    bit = {"ACT": 1, "GTO": 8}.get(name, 0)
                    registers[0] = registers[0] & ~bit | (bit if number else 0)
            gripper.write(0, bytes(registers))
            return b"ack"
        status = gripper.status()
        told: dict[str, Callable[[], int]] = {
            "POS": lambda: status[4],
            "PRE": lambda: status[3],
            "OBJ": lambda: status[0] >> 6,
            "STA": lambda: status[0] >> 4 & 3,
            "FLT": lambda: status[2],
            "ACT": lambda: status[0] & 1,
            "GTO": lambda: status[0] >> 3 & 1,
            "COU": lambda: status[5],
            "SID": lambda: 9,
        }
        name = words[1] if len(words) > 1 else ""
        return f"{name} {told[name]()}\n".encode() if name in told else b"?\n"


def _make(cell: Cell, addresses: tuple[str, ...], model: str) -> EmulatedDevice:
    gripper = RobotiqEmulator(cell.device(Gripper), model)
    port = gripper.rtu if "/" in addresses[0] else gripper.urcap
    return EmulatedDevice(
        (EmulatedWire("wire", addresses[0], port),), gripper.advance, {"controller": gripper}
    )


HAND_E, ROBOTIQ_2F_85, ROBOTIQ_2F_140 = (
    EmulatorKind(lambda address: (address,), partial(_make, model=model)) for model in MODELS
)
"""Of each model: on a serial line where the address is a path, else the URCap's socket."""
