"""A Yaskawa controller with MotoROS that speaks its bytes: servos, queue, interpolation, refusals, pushed state."""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from enum import IntEnum
from functools import partial
from typing import NamedTuple

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
from pomona.drivers import Address, Arm, Cell
from pomona.executive import Float64

ORDERS = {"fs100": ">", "dx100": "<", "dx200": "<", "yrc1000": "<"}
START_TOLERANCE = 5e-4  # the first point must be this near to the arm [rad]
OVERSPEED = 1.05
STATE_PERIOD = 0.025
SERVO_TIME = 0.2  # time until the servos are on [s]; a real controller takes some seconds
NEEDED = 1 | 2 | 4
"""Of the fields that mean something: time, positions, velocities."""
PING, STATUS, POINT, FEEDBACK, CONTROL, REPLY = 1, 13, 14, 15, 2001, 2002
LAYOUTS = {
    PING: "",
    STATUS: "7i",
    POINT: "3if30f",
    FEEDBACK: "2if30f",
    CONTROL: "3i10f",
    REPLY: "5i10f",
}
"""Numbers of the messages of simple_message (ROS-Industrial) by their types."""
TOLD = 1
ANSWERED = 3
"""Role of a message: a topic, a reply."""
JOINTS = 10
"""Places for joints in a message."""


class Command(IntEnum):
    """Of MotoROS: in a CONTROL."""

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
    """Of MotoROS: in a REPLY."""

    SUCCESS = 0
    BUSY = 1
    INVALID = 3
    NOT_READY = 5


class Request(NamedTuple):
    """A CONTROL, whose code is a command, or a POINT, whose code says which numbers mean something."""

    kind: int
    group: int
    sequence: int
    code: int
    numbers: tuple[float, ...]


class FreeJoints:
    """Joints that are where they shall be."""

    def __init__(self, q: Float64) -> None:
        self._q, self._qd = q.copy(), np.zeros_like(q)

    def measured(self) -> tuple[Float64, Float64]:
        return self._q.copy(), self._qd.copy()

    def drive(self, q: Float64, qd: Float64) -> None:
        self._q, self._qd = q.copy(), qd.copy()


@dataclass(frozen=True, slots=True, eq=False)
class _Knot:
    time: float
    q: Float64
    qd: Float64


class MotomanEmulator(EmulatedArm):
    """The controller; `motion`, `state` and `io` serve its three ports.

    Faults: `e_stop`, `teach`, `alarm`, `hold`; `lost` (the cable is pulled); `busy` (accepts no more points, plays the
    queued ones); `no_status` (pushes feedback, but no status); `nonsense` (answers on the motion's connection with
    bytes outside its protocol); those of its joints.

    Attributes:
        drives_on, e_stopped, teach, alarm, hold, remote: as on the pendant; set them to test the driver.
        silent: the cable is pulled.
        buffer: how much motion the queue holds [s].
        gaps: how often the queue ran empty while the arm moved.
        clock: its own time.
    """

    known_faults = (
        *EmulatedArm.known_faults,
        "e_stop",
        "teach",
        "alarm",
        "hold",
        "lost",
        "busy",
        "no_status",
        "nonsense",
    )

    def __init__(
        self,
        joints: Joints,
        velocity: Float64,
        order: str = "<",
        buffer: float = 0.8,
        drives_on: bool = False,
    ) -> None:
        super().__init__(joints)
        self.drives_on = drives_on
        self.trajectory_mode = drives_on
        self.e_stopped = self.teach = self.hold = self.silent = False
        self.remote = True
        self.alarm = 0
        self.buffer, self.gaps, self.clock = buffer, 0, OwnTime()
        self.motion, self.state = _MotionPort(self, order), _StatePort(self, order)
        self._velocity = velocity
        self._dof = len(velocity)
        self._knots: deque[_Knot] = deque()
        self._sequence = -1
        self._played = 0.0
        self._now = 0.0
        self._servo_due: float | None = None
        self._servo_request: tuple[Peer, Request] | None = None
        self._next_state = 0.0

    # ------------------------------------------------------------------------------------------ faults

    def inject_fault(self, kind: str) -> None:
        super().inject_fault(kind)
        match kind:
            case "e_stop":
                self.press_e_stop()
            case "teach":
                self.turn_to_teach()
            case "alarm":
                self.raise_alarm(4107)
            case "hold":
                self.hold = True
                self._halt()
            case "lost":
                self.silent = True

    def clear_fault(self) -> None:
        """Release the button, turn the key back, plug the cable in; an alarm is reset by a command."""
        super().clear_fault()
        self.e_stopped = self.teach = self.hold = self.silent = False

    def press_e_stop(self) -> None:
        """Brakes on, drives off, queue gone."""
        self.e_stopped = True
        self._drop_servos()

    def turn_to_teach(self) -> None:
        """Turn the key to teach, as an operator does: the servos drop."""
        self.teach = True
        self._drop_servos()

    def raise_alarm(self, code: int) -> None:
        """The controller raises an alarm: the servos drop."""
        self.alarm = code
        self._drop_servos()

    def _drop_servos(self) -> None:
        self.drives_on = self.trajectory_mode = False
        self._halt()

    # -------------------------------------------------------------------------------------------- time

    def advance(self, now: float) -> None:
        """Interpolate between the points of the queue, push the state."""
        now = self.clock.at(now)
        elapsed = now - self._now
        self._now = now
        self._play(max(elapsed, 0.0))
        if self._servo_due is not None and now >= self._servo_due:
            self._servos_on()
        if now >= self._next_state:
            self._next_state = max(self._next_state + STATE_PERIOD, now)
            q, qd = self.measured()
            self.state.push(FEEDBACK, 0, NEEDED, now, *_ten(q), *_ten(qd), *_ten(()))
            if self.fault != "no_status":
                self.state.push(STATUS, *self._status(qd))

    def _status(self, qd: Float64) -> tuple[int, ...]:
        moving = int(bool(self._knots) and (len(self._knots) > 1 or bool(np.abs(qd).max() > 1e-3)))
        ready = int(self._not_ready() == 0)
        return (
            int(self.drives_on),
            int(self.e_stopped),
            self.alarm,
            int(self.alarm != 0),
            moving,
            1 if self.teach else 2,
            ready,
        )

    def _play(self, elapsed: float) -> None:
        if len(self._knots) < 2:
            return
        self._played += elapsed
        while len(self._knots) > 1 and self._knots[1].time <= self._played:
            self._knots.popleft()
        if len(self._knots) == 1:
            last = self._knots[0]
            if np.abs(last.qd).max() > 1e-6:
                self.gaps += 1
            self._played = last.time
            self._drive(last.q, np.zeros(self._dof))
            return
        a = self._knots[0]
        b = self._knots[1]
        h = b.time - a.time
        s = (self._played - a.time) / h
        v0 = a.qd * h
        v1 = b.qd * h
        step = b.q - a.q
        cubic = v0 + v1 - 2.0 * step
        square = 3.0 * step - 2.0 * v0 - v1
        self._drive(
            a.q + s * (v0 + s * (square + s * cubic)),
            (v0 + s * (2.0 * square + s * 3.0 * cubic)) / h,
        )

    def _halt(self) -> None:
        self._knots.clear()
        self._sequence = -1
        q, _ = self._joints.measured()
        self._joints.drive(q, np.zeros(self._dof))

    def _servos_on(self) -> None:
        self._servo_due = None
        self.drives_on = self.trajectory_mode = True
        if self._servo_request is not None:
            peer, request = self._servo_request
            self._servo_request = None
            self._answer(peer, request)

    # ---------------------------------------------------------------------------------------- requests

    def _not_ready(self) -> int:
        reasons = (
            (self.e_stopped, 5003),
            (self.alarm != 0, 5001),
            (self.teach, 5004),
            (not self.remote, 5005),
            (self.hold, 5007),
            (not self.drives_on, 5006),
            (not self.trajectory_mode, 5009),
        )
        return next((code for applies, code in reasons if applies), 0)

    def command(self, peer: Peer, request: Request) -> None:
        """A command."""
        match request.code:
            case Command.CHECK_READY:
                self._answer(peer, request, *self._readiness())
            case Command.CHECK_QUEUE:
                self._answer(peer, request, Result.SUCCESS, len(self._knots))
            case Command.STOP:
                self._halt()
                self._answer(peer, request)
            case Command.SERVO_ON | Command.START_TRAJECTORY_MODE:
                reason = self._not_ready()
                if reason in (0, 5006, 5009):
                    self._servo_due = self._now + SERVO_TIME
                    self._servo_request = (peer, request)
                else:
                    self._answer(peer, request, Result.NOT_READY, reason)
            case Command.SERVO_OFF:
                self._drop_servos()
                self._answer(peer, request)
            case Command.STOP_TRAJECTORY_MODE:
                self.trajectory_mode = False
                self._answer(peer, request)
            case Command.RESET_ALARM:
                self.alarm = 0
                self._answer(peer, request)
            case Command.DISCONNECT:
                peer.close()
            case _:
                self._answer(peer, request, Result.INVALID, 3006)

    def point(self, peer: Peer, point: Request) -> None:
        """A point of a trajectory."""
        result, subcode = self._readiness()
        if result is Result.SUCCESS:
            result, subcode = self._judge(point)
        if result is Result.SUCCESS:
            if point.sequence == 0:
                self._knots.clear()
                self._played = point.numbers[0]
            self._sequence = point.sequence
            self._knots.append(self._knot(point))
        self._answer(peer, point, result, subcode)

    def _knot(self, point: Request) -> _Knot:
        time, *joints = point.numbers
        q, qd = np.array(joints[: 2 * JOINTS]).reshape(2, JOINTS)[:, : self._dof]
        return _Knot(time, q, qd)

    def _readiness(self) -> tuple[Result, int]:
        reason = self._not_ready()
        return (Result.NOT_READY, reason) if reason else (Result.SUCCESS, 0)

    def _judge(self, point: Request) -> tuple[Result, int]:
        knot = self._knot(point)
        q = knot.q
        qd = knot.qd
        if point.group != 0:
            return Result.INVALID, 3004
        if point.code & NEEDED != NEEDED:
            return Result.INVALID, 3015
        if np.any(np.abs(qd) > OVERSPEED * self._velocity):
            return Result.INVALID, 3013
        if point.sequence == 0:
            measured, _ = self._joints.measured()
            if np.abs(q - measured).max() > START_TOLERANCE:
                return Result.INVALID, 3011
            return (Result.INVALID, 3013) if np.any(qd != 0.0) else (Result.SUCCESS, 0)
        if not self._knots or point.sequence != self._sequence + 1:
            return Result.INVALID, 3005
        last = self._knots[-1]
        if knot.time <= last.time:
            return Result.INVALID, 3016
        if np.any(np.abs(q - last.q) > OVERSPEED * self._velocity * (knot.time - last.time) + 1e-6):
            return Result.INVALID, 3013
        full = last.time - self._played > self.buffer or self.fault == "busy"
        return (Result.BUSY, 0) if full else (Result.SUCCESS, 0)

    def _answer(
        self, peer: Peer, request: Request, result: Result = Result.SUCCESS, subcode: int = 0
    ) -> None:
        command = request.code if request.kind == CONTROL else POINT
        numbers = (request.group, request.sequence, command, result, subcode, *_ten(()))
        self.motion.say(peer, REPLY, ANSWERED, 1 if result is Result.SUCCESS else 2, *numbers)


def _ten(joints: Iterable[float]) -> list[float]:
    """Return a number for each place of a message."""
    return [*joints, *([0.0] * JOINTS)][:JOINTS]


class _Port:
    """One of the controller's ports."""

    def __init__(self, controller: MotomanEmulator, order: str) -> None:
        self._controller = controller
        self._order = order
        self._peers: dict[int, tuple[Peer, bytearray]] = {}

    def connected(self, peer: Peer) -> None:
        self._peers[id(peer)] = (peer, bytearray())

    def disconnected(self, peer: Peer) -> None:
        self._peers.pop(id(peer), None)

    def received(self, peer: Peer, chunk: bytes) -> None:
        if self._controller.silent or id(peer) not in self._peers:
            return
        buffer = self._peers[id(peer)][1]
        buffer += chunk
        while len(buffer) >= 16:
            length, kind = struct.unpack_from(self._order + "2i", buffer)
            layout = self._order + LAYOUTS.get(kind, "")
            if length != 12 + struct.calcsize(layout):
                buffer.clear()  # no message: it cannot know where the next one begins
            if len(buffer) < 4 + length:
                return
            numbers = struct.unpack_from(layout, buffer, 16)
            del buffer[: 4 + length]
            if kind == PING:
                self.say(peer, PING, ANSWERED, 1)
            elif kind in (CONTROL, POINT):
                group, sequence, code, *rest = numbers
                self.on_request(peer, Request(kind, group, sequence, code, tuple(rest)))

    def advance(self, now: float) -> None:
        """Time belongs to the controller."""

    def on_request(self, peer: Peer, request: Request) -> None:
        """A request of this port."""

    def say(self, peer: Peer, kind: int, role: int, reply: int, *numbers: float) -> None:
        """Send a message."""
        body = struct.pack(self._order + LAYOUTS[kind], *numbers)
        head = struct.pack(self._order + "4i", 12 + len(body), kind, role, reply)
        if not self._controller.silent:
            peer.send(head + body)


class _MotionPort(_Port):
    def say(self, peer: Peer, kind: int, role: int, reply: int, *numbers: float) -> None:
        if self._controller.fault == "nonsense":
            peer.send(b"HTTP/1.1 400 Bad Request\r\n\r\n")
        else:
            super().say(peer, kind, role, reply, *numbers)

    def on_request(self, peer: Peer, request: Request) -> None:
        if request.kind == POINT:
            self._controller.point(peer, request)
        else:
            self._controller.command(peer, request)


class _StatePort(_Port):
    def push(self, kind: int, *numbers: float) -> None:
        for peer, _ in tuple(self._peers.values()):
            self.say(peer, kind, TOLD, 0, *numbers)


def _addresses(address: str) -> tuple[str, ...]:
    host, port = Address(0).parse(address)
    return f"{host}:{port}", f"{host}:{port + 1}"


def _make(cell: Cell, addresses: tuple[str, ...], order: str) -> EmulatedDevice:
    controller = MotomanEmulator(SimJoints(world_of(cell)), cell.device(Arm).limits.velocity, order)
    wires = (
        EmulatedWire("motion_wire", addresses[0], controller.motion),
        EmulatedWire("state_wire", addresses[1], controller.state, clients=4),
    )
    return EmulatedDevice(wires, controller.advance, {"": controller})


FS100, DX100, DX200, YRC1000 = (
    EmulatorKind(_addresses, partial(_make, order=order)) for order in ORDERS.values()
)
"""Of each controller, which differ by their byte order."""
