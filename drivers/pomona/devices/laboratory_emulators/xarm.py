"""A UFACTORY controller that speaks its bytes: registers at port 502, pushed reports at 30001 to 30003."""

from __future__ import annotations

import math
import struct
from collections import deque
from collections.abc import Callable

import numpy as np

from pomona.devices.emulators.emulated import (
    EmulatedArm,
    EmulatedDevice,
    EmulatedWire,
    EmulatorKind,
    Joints,
    OwnTime,
    SimJoints,
    world_of,
)
from pomona.devices.emulators.server import Peer
from pomona.devices.laboratory_emulators.ports import ControllerPort
from pomona.drivers import Arm, Cell
from pomona.executive import Float64

PORTS = {"command": 502, "normal": 30001, "rich": 30002, "report": 30003}
CYCLE = 0.002
"""Control cycle [s]: plausible, not known."""
SET_POINTS = 0.004
"""Time over which servo mode goes from set-point to set-point [s]: without it the arm shakes with 100 rad/s²."""
FILTER = 0.010
"""Time in which servo mode comes to a set-point [s]: plausible, not measured."""
STRAY_SPEED = 0.35  # of the joints that another client moves [rad/s]: 20°/s, the vendor's client without a speed
MOST = 20.0
"""Acceleration of a joint in a stop and in the queue [rad/s²]: plausible, not measured."""
DEVIATES = 0.1
"""Distance of a joint from its set-point that is the error 31 [rad]: plausible, not measured."""
FAR = 0.2
"""Distance of a set-point in servo mode that is the error 24 [rad]: plausible, not measured."""
MOVE_JOINT = 23  # register of the queue (mode 0)
MOTIONS = (*range(21, 41), *range(81, 100))
"""Registers that move the arm; those that are not here are refused. Others read as `READ_AS_ZERO` bytes."""
READ_AS_ZERO = 40
HEADER = struct.Struct(">HHH")
"""Transaction, protocol, number of bytes that follow."""
PLACES = 7  # joints of each message
INVALID = 0x08  # flag of the answer to a request that is refused


class XArmEmulator(EmulatedArm):
    """The controller; `command`, `normal`, `rich` and `report` serve its ports.

    Faults: `collision`, `e_stop`, `motor` (errors 31, 1, 13); `stopped`, `paused` (in UFACTORY Studio); `replaced`
    (another program sets the queue's mode and moves); `moved` (another client sends set-points); `killed` (all
    connections end), `silent` (no byte at any port), `no_report`; those of its joints; `other_model`, `old`, `by_hand`
    (before a connection: an arm of another type, firmware 1.8, guided by hand).

    Attributes:
        axes, kind, firmware: of the answer to VERSION.
        state, mode, error, warning, enabled, pressed: as in UFACTORY Studio; `pressed` is the emergency stop.
        clock: its own time.
    """

    known_faults = (
        *EmulatedArm.known_faults,
        "collision",
        "e_stop",
        "motor",
        "stopped",
        "paused",
        "replaced",
        "moved",
        "killed",
        "silent",
        "no_report",
        "other_model",
        "old",
        "by_hand",
    )

    def __init__(self, joints: Joints, velocity: Float64, kind: int = 6) -> None:
        super().__init__(joints)
        self.command = _CommandPort(self)
        self.normal, self.rich, self.report = (
            ControllerPort(self),
            ControllerPort(self),
            ControllerPort(self),
        )
        self.axes = len(velocity)
        self.kind = kind
        self.firmware = (2, 5, 0)
        self.state = 4
        self.mode = 0
        self.error = 0
        self.warning = 0
        self.enabled = self.pressed = False
        self.clock = OwnTime()
        self._velocity = velocity
        self._target: Float64 | None = None
        self._way: deque[Float64] = deque()
        self._stray = self._q
        self._queue: deque[tuple[Float64, float]] = deque()
        self._speeds = np.zeros(len(velocity))
        self._speeds_end = math.inf
        self._next: float | None = None
        self._count = 0

    # ------------------------------------------------------------------------------------------ faults

    def inject_fault(self, kind: str) -> None:
        super().inject_fault(kind)
        if kind in ("collision", "motor", "e_stop"):
            self.raise_error({"collision": 31, "motor": 13, "e_stop": 1}[kind])
            self.pressed = kind == "e_stop"
        elif kind in ("stopped", "paused"):
            self.set_state(4 if kind == "stopped" else 3)
        elif kind == "replaced":
            self.set_mode(0)
            self.set_state(0)
            self._queue.append((self._q + 0.3, 0.5))
        elif kind == "moved":
            self._stray = self._q + 0.1
        elif kind == "killed":
            for port in (self.command, self.normal, self.rich, self.report):
                port.hang_up()
        elif kind == "other_model":
            self.kind = 9
        elif kind == "old":
            self.firmware = (1, 8, 0)
        elif kind == "by_hand":
            self.set_mode(2)

    def clear_fault(self) -> None:
        """Release the button, plug the cable in; errors are cleared by a command."""
        super().clear_fault()
        self.pressed = False

    @property
    def deaf(self) -> bool:
        """Whether nothing passes at any port."""
        return self.fault in ("silent", "killed")

    def raise_error(self, code: int) -> None:
        """Stop with an error; an emergency stop takes the power from the motors."""
        self.error = code
        self.enabled = self.enabled and code != 1
        self.set_state(4)

    # ------------------------------------------------------------------------------------------ commands

    def set_state(self, state: int) -> None:
        """Take a command of the state: 0 go on, 3 pause, 4 stop."""
        if state == 0:
            self.state = 2 if self.enabled and not self.error else 4
        elif state in (3, 4):
            self.state = state
        if self.state == 4:
            self._forget()

    def set_mode(self, mode: int) -> None:
        """Take another mode; the arm stops until a state is commanded."""
        self.mode = mode
        self.state = 4
        self._forget()

    def _forget(self) -> None:
        self._queue.clear()
        self._way.clear()
        self._target, self._speeds = None, np.zeros_like(self._qd)

    def _halt(self) -> None:
        super()._halt()
        self._forget()

    def clean_error(self) -> None:
        """Clear the error, unless its cause is still there."""
        self.error = 1 if self.pressed else 0

    @property
    def flags(self) -> int:
        """The flags of each answer."""
        not_ready = self.state == 4 or not self.enabled or self.error
        return (
            (0x40 if self.error else 0) | (0x20 if self.warning else 0) | (0x10 if not_ready else 0)
        )

    def answer(self, register: int, body: bytes) -> bytes:
        """Carry a request out, and return the parameters of its answer. Raises IndexError: it is not emulated."""
        orders: dict[int, Callable[[], None]] = {
            11: lambda: setattr(self, "enabled", bool(body[1]) and not self.pressed),
            12: lambda: self.set_state(body[0]),
            19: lambda: self.set_mode(body[0]),
            16: self.clean_error,
            17: lambda: setattr(self, "warning", 0),
            29: lambda: self._servo(body),
            MOVE_JOINT: lambda: self._move(body),
            81: lambda: self._set_speeds(body),
        }
        if register in orders:
            orders[register]()
            return struct.pack(">H", len(self._queue)) if register == MOVE_JOINT else b""
        told: dict[int, Callable[[], bytes]] = {
            1: self._version,
            13: lambda: bytes([self.state]),
            14: lambda: struct.pack(">H", len(self._queue)),
            15: lambda: bytes([self.error, self.warning]),
            42: lambda: self._told_joints(body[0] & 0x0F if body else 1),
        }
        if register in MOTIONS:
            raise IndexError(f"register {register} is not emulated")
        return told.get(register, lambda: bytes(READ_AS_ZERO))()

    def _version(self) -> bytes:
        letter = {5: "F", 6: "I", 7: "S"}.get(self.axes, "X")
        version = ".".join(map(str, self.firmware))
        return f"{self.axes},{self.kind},X{letter}1304,AC1304,v{version}".encode().ljust(40, b"\0")

    def _told_joints(self, count: int) -> bytes:
        q, qd = self.measured()
        return b"".join(_wire(part) for part in (q, qd, np.zeros_like(q))[:count])

    def _numbers(self, body: bytes, kept: Float64 | None = None) -> Float64:
        """Return a number of each joint; infinite ones keep the joint. Raises IndexError: one is no number."""
        found = np.array(struct.unpack_from(f"<{PLACES}f", body)[: self.axes])
        if kept is not None:
            found = np.where(np.isposinf(found), kept, found)
        if not np.isfinite(found).all():
            raise IndexError("not finite")
        return found

    def _servo(self, body: bytes) -> None:
        q = self._numbers(body)
        if self.mode != 1 or self.state == 4 or self.error:
            return
        if np.abs(q - self._q).max() > FAR:
            self.raise_error(24)
        else:
            self._target = self._q if self._target is None else self._target
            self._way.clear()
            steps = round(SET_POINTS / CYCLE)
            self._way.extend(
                self._target + (q - self._target) * k / steps for k in range(1, steps + 1)
            )

    def _move(self, body: bytes) -> None:
        q, speed = self._numbers(body, self._q), struct.unpack_from("<f", body, 4 * PLACES)[0]
        if self.mode == 0 and self.state != 4 and not self.error:
            self._queue.append((q, max(speed, 0.01)))

    def _set_speeds(self, body: bytes) -> None:
        speeds = self._numbers(body)
        if self.mode == 4 and self.state != 4 and not self.error:
            self._speeds = speeds
            (duration,) = struct.unpack_from("<f", body, 29) if len(body) >= 33 else (-1.0,)
            now = self._next or 0.0
            self._speeds_end = now + duration if duration > 0.0 else math.inf

    # -------------------------------------------------------------------------------------------- time

    def advance(self, now: float) -> None:
        """Make the cycles until now."""
        now = self.clock.at(now)
        self._next = now if self._next is None or now - self._next > 1.0 else self._next
        while self._next <= now + 1e-9:
            self._cycle(self._next)
            self._next += CYCLE

    def _cycle(self, now: float) -> None:
        wanted = np.zeros_like(self._qd)
        most = MOST
        if self.fault == "moved":
            self._target = self._q + np.clip(
                self._stray - self._q, -FILTER * STRAY_SPEED, FILTER * STRAY_SPEED
            )
        if self.state in (1, 2):
            if self.mode == 1 and self._target is not None:
                self._target = self._way.popleft() if self._way else self._target
                wanted = (self._target - self._q) / FILTER
                most = math.inf
            elif self.mode == 0 and self._queue:
                wanted = self._towards(*self._queue[0])
            elif self.mode == 4 and now < self._speeds_end:
                wanted = self._speeds
        quickest = 1.2 * self._velocity
        wanted = np.minimum(np.maximum(wanted, -quickest), quickest)
        change = np.minimum(np.maximum(wanted - self._qd, -most * CYCLE), most * CYCLE)
        self._qd = self._qd + change
        self._qd[np.abs(self._qd) < 1e-9] = 0.0
        self._q = self._q + self._qd * CYCLE
        if self.state in (1, 2):
            self.state = 1 if np.abs(self._qd).max() > 1e-4 or self._queue else 2
        self._drive(self._q, self._qd)
        if self.fault != "stuck" and np.abs(self._joints.measured()[0] - self._q).max() > DEVIATES:
            self.raise_error(31)
            self._halt()
        self._push()

    def _towards(self, q: Float64, speed: float) -> Float64:
        """Return the speeds of a straight line in joint space, with a ramp at its end."""
        way = q - self._q
        far = float(np.abs(way).max())
        if far < 1e-5:
            self._queue.popleft()
            return np.zeros_like(way)
        return way / far * min(speed, math.sqrt(MOST * far), far / CYCLE)

    # ------------------------------------------------------------------------------------------ reports

    def _push(self) -> None:
        self._count += 1
        if self.deaf or self.fault == "no_report":
            return
        if self._count % round(0.01 / CYCLE) == 0:
            self.report.send(_framed(self._body()))
        if self._count % round(0.2 / CYCLE) == 0:
            self.normal.send(_framed(self._body() + self._more()))
            self.rich.send(_framed((self._body() + self._more() + self._robot()).ljust(241, b"\0")))

    def _body(self) -> bytes:
        """State, mode, queue, joints, pose, torques: the whole report of 100 Hz."""
        status = bytes([self.state | self.mode << 4]) + struct.pack(">H", len(self._queue))
        return status + _wire(self.measured()[0]) + bytes(4 * 6) + bytes(4 * PLACES)

    def _more(self) -> bytes:
        """Brakes, motors, error, warning, and settings of the tool."""
        motors = (1 << self.axes) - 1 if self.enabled else 0
        settings = (
            struct.pack("<10f", *([0.0] * 10)) + bytes([3, 3]) + struct.pack("<3f", 0.0, 0.0, -1.0)
        )
        return bytes([motors, motors, self.error, self.warning]) + settings

    def _robot(self) -> bytes:
        version = "v" + ".".join(map(str, self.firmware))
        return (
            bytes([self.kind, self.axes, 1, 1, 1, 1])
            + version.encode().ljust(30, b"\0")
            + bytes(4 * 10)
        )


def _wire(values: Float64) -> bytes:
    return struct.pack(f"<{len(values)}f", *values).ljust(4 * PLACES, b"\0")


def _framed(body: bytes) -> bytes:
    return struct.pack(">I", 4 + len(body)) + body


class _CommandPort(ControllerPort):
    def on_bytes(self, peer: Peer, buffer: bytearray) -> None:
        while len(buffer) >= HEADER.size:
            transaction, protocol, size = HEADER.unpack_from(buffer)
            if len(buffer) < HEADER.size + size:
                return
            body = bytes(buffer[HEADER.size : HEADER.size + size])
            del buffer[: HEADER.size + size]
            if protocol not in (2, 3) or not body:
                continue  # a heart beat of the vendor's client, or standard Modbus
            try:
                answer = self._robot.answer(body[0], body[1:])
                refused = 0
            except (struct.error, IndexError):
                answer = b""
                refused = INVALID
            head = bytes([body[0], self._robot.flags | refused])
            peer.send(HEADER.pack(transaction, protocol, 2 + len(answer)) + head + answer)


def _addresses(address: str) -> tuple[str, ...]:
    return tuple(f"{address}:{port}" for port in PORTS.values())


def _make(cell: Cell, addresses: tuple[str, ...]) -> EmulatedDevice:
    controller = XArmEmulator(SimJoints(world_of(cell)), cell.device(Arm).limits.velocity)
    wires = (
        EmulatedWire(f"{name}_wire", address, getattr(controller, name), clients=4)
        for name, address in zip(PORTS, addresses, strict=True)
    )
    return EmulatedDevice(tuple(wires), controller.advance, {"": controller})


XARM = EmulatorKind(_addresses, _make)
