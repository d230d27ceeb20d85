"""A Yaskawa controller with MotoROS that speaks its bytes: servos, queue, interpolation, refusals, pushed state."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import numpy as np

from pomona.devices.emulators.emulated import (
    EmulatedDevice,
    EmulatedWire,
    EmulatorKind,
    OwnTime,
    SimJoints,
    world_of,
)
from pomona.devices.emulators.server import Peer
from pomona.devices.motoman.codec import (
    Body,
    Communication,
    Control,
    JointFeedback,
    Message,
    MessageDecoder,
    MotionControl,
    MotionReply,
    Order,
    Ping,
    Result,
    RobotStatus,
    TrajectoryPoint,
    Valid,
    encode,
)
from pomona.drivers import Address, Arm, Cell, FaultSwitch
from pomona.executive import Float64

ORDERS: dict[str, Order] = {"fs100": ">", "dx100": "<", "dx200": "<", "yrc1000": "<"}
START_TOLERANCE = 5e-4  # the first point must be this near to the arm [rad]
OVERSPEED = 1.05
STATE_PERIOD = 0.025
SERVO_TIME = 0.2  # time until the servos are on [s]; a real controller takes some seconds
NEEDED = Valid.TIME | Valid.POSITION | Valid.VELOCITY


class Joints(Protocol):
    """The arm behind the controller, joints in the wire's order."""

    def measured(self) -> tuple[Float64, Float64]:
        """Return positions [rad] and velocities [rad/s], shape (dof,)."""

    def drive(self, q: Float64, qd: Float64) -> None:
        """The set-point of now."""


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


class MotomanEmulator(FaultSwitch):
    """The controller; `motion`, `state` and `io` serve its three ports.

    Faults: `e_stop`, `teach`, `alarm`, `hold`; `lost` (the cable is pulled); `busy` (accepts no more points, plays the
    queued ones); `stuck` (the joints stand still while its model moves); `frozen` (pushes the same feedback for ever);
    `nan`, `wild` (implausible feedback); `no_status` (pushes feedback, but no status); `nonsense` (answers on the
    motion's connection with bytes outside its protocol).

    Attributes:
        drives_on, e_stopped, teach, alarm, hold, remote: as on the pendant; set them to test the driver.
        silent: the cable is pulled.
        buffer: how much motion the queue holds [s].
        gaps: how often the queue ran empty while the arm moved.
        clock: its own time.
    """

    known_faults = (
        "e_stop",
        "teach",
        "alarm",
        "hold",
        "lost",
        "busy",
        "stuck",
        "frozen",
        "nan",
        "wild",
        "no_status",
        "nonsense",
    )

    def __init__(
        self,
        joints: Joints,
        velocity: Float64,
        order: Order = "<",
        buffer: float = 0.8,
        drives_on: bool = False,
    ) -> None:
        super().__init__()
        self.drives_on = drives_on
        self.trajectory_mode = drives_on
        self.e_stopped = self.teach = self.hold = self.silent = False
        self.remote = True
        self.alarm = 0
        self.buffer, self.gaps, self.clock = buffer, 0, OwnTime()
        self.motion, self.state = _MotionPort(self, order), _StatePort(self, order)
        self._joints = joints
        self._velocity = velocity
        self._dof = len(velocity)
        self._knots: deque[_Knot] = deque()
        self._sequence = -1
        self._played = 0.0
        self._now = 0.0
        self._servo_due: float | None = None
        self._servo_request: tuple[Peer, MotionControl] | None = None
        self._next_state = 0.0
        self._frozen = joints.measured()

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
        self._frozen = self._joints.measured()

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
            valid = Valid.TIME | Valid.POSITION | Valid.VELOCITY
            self.state.push(JointFeedback(0, valid, now, tuple(q.tolist()), tuple(qd.tolist())))
            if self.fault != "no_status":
                self.state.push(self._status(qd))

    def measured(self) -> tuple[Float64, Float64]:
        """Return the reported state of its joints."""
        q, qd = self._joints.measured()
        match self.fault:
            case "frozen":
                return self._frozen
            case "nan":
                return np.full_like(q, np.nan), qd
            case "wild":
                return np.full_like(q, 1e30), qd
        return q, qd

    def _drive(self, q: Float64, qd: Float64) -> None:
        if self.fault != "stuck":
            self._joints.drive(q, qd)

    def _status(self, qd: Float64) -> RobotStatus:
        moving = int(bool(self._knots) and (len(self._knots) > 1 or bool(np.abs(qd).max() > 1e-3)))
        ready = int(self._not_ready() == 0)
        return RobotStatus(
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

    def command(self, peer: Peer, request: MotionControl) -> None:
        """A MotionControl."""
        match request.command:
            case Control.CHECK_READY:
                self._answer(peer, request, *self._readiness())
            case Control.CHECK_QUEUE:
                self._answer(peer, request, Result.SUCCESS, len(self._knots))
            case Control.STOP:
                self._halt()
                self._answer(peer, request)
            case Control.SERVO_ON | Control.START_TRAJECTORY_MODE:
                reason = self._not_ready()
                if reason in (0, 5006, 5009):
                    self._servo_due = self._now + SERVO_TIME
                    self._servo_request = (peer, request)
                else:
                    self._answer(peer, request, Result.NOT_READY, reason)
            case Control.SERVO_OFF:
                self._drop_servos()
                self._answer(peer, request)
            case Control.STOP_TRAJECTORY_MODE:
                self.trajectory_mode = False
                self._answer(peer, request)
            case Control.RESET_ALARM:
                self.alarm = 0
                self._answer(peer, request)
            case Control.DISCONNECT:
                peer.close()
            case _:
                self._answer(peer, request, Result.INVALID, 3006)

    def point(self, peer: Peer, point: TrajectoryPoint) -> None:
        """A point of a trajectory."""
        result, subcode = self._readiness()
        if result is Result.SUCCESS:
            result, subcode = self._judge(point)
        if result is Result.SUCCESS:
            if point.sequence == 0:
                self._knots.clear()
                self._played = point.time
            self._sequence = point.sequence
            dof = self._dof
            self._knots.append(
                _Knot(point.time, np.array(point.position[:dof]), np.array(point.velocity[:dof]))
            )
        self._answer(peer, point, result, subcode)

    def _readiness(self) -> tuple[Result, int]:
        reason = self._not_ready()
        return (Result.NOT_READY, reason) if reason else (Result.SUCCESS, 0)

    def _judge(self, point: TrajectoryPoint) -> tuple[Result, int]:
        q = np.array(point.position[: self._dof])
        qd = np.array(point.velocity[: self._dof])
        if point.group != 0:
            return Result.INVALID, 3004
        if point.valid & NEEDED != NEEDED:
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
        if point.time <= last.time:
            return Result.INVALID, 3016
        if np.any(
            np.abs(q - last.q) > OVERSPEED * self._velocity * (point.time - last.time) + 1e-6
        ):
            return Result.INVALID, 3013
        full = last.time - self._played > self.buffer or self.fault == "busy"
        return (Result.BUSY, 0) if full else (Result.SUCCESS, 0)

    def _answer(
        self,
        peer: Peer,
        request: MotionControl | TrajectoryPoint,
        result: Result = Result.SUCCESS,
        subcode: int = 0,
    ) -> None:
        command = request.command if isinstance(request, MotionControl) else TrajectoryPoint.TYPE
        reply = MotionReply(request.group, request.sequence, command, int(result), subcode)
        self.motion.say(
            peer, Message(reply, Communication.REPLY, 1 if result is Result.SUCCESS else 2)
        )


class _Port:
    """One of the controller's ports."""

    def __init__(self, controller: MotomanEmulator, order: Order) -> None:
        self._controller = controller
        self._order: Order = order
        self._peers: dict[int, tuple[Peer, MessageDecoder]] = {}

    def connected(self, peer: Peer) -> None:
        self._peers[id(peer)] = (peer, MessageDecoder(self._order))

    def disconnected(self, peer: Peer) -> None:
        self._peers.pop(id(peer), None)

    def received(self, peer: Peer, chunk: bytes) -> None:
        if not self._controller.silent and id(peer) in self._peers:
            for message in self._peers[id(peer)][1].decode(chunk):
                if isinstance(message.body, Ping):
                    self.say(peer, Message(Ping(), Communication.REPLY, 1))
                else:
                    self.on_message(peer, message.body)

    def advance(self, now: float) -> None:
        """Time belongs to the controller."""

    def on_message(self, peer: Peer, body: Body) -> None:
        """A message of this port."""

    def say(self, peer: Peer, message: Message) -> None:
        if not self._controller.silent:
            peer.send(encode(message, self._order))


class _MotionPort(_Port):
    def say(self, peer: Peer, message: Message) -> None:
        if self._controller.fault == "nonsense":
            peer.send(b"HTTP/1.1 400 Bad Request\r\n\r\n")
        else:
            super().say(peer, message)

    def on_message(self, peer: Peer, body: Body) -> None:
        if isinstance(body, TrajectoryPoint):
            self._controller.point(peer, body)
        elif isinstance(body, MotionControl):
            self._controller.command(peer, body)


class _StatePort(_Port):
    def push(self, body: Body) -> None:
        for peer, _ in tuple(self._peers.values()):
            self.say(peer, Message(body, Communication.TOPIC))


def _addresses(address: str) -> tuple[str, ...]:
    host, port = Address(0).parse(address)
    return f"{host}:{port}", f"{host}:{port + 1}"


def _make(cell: Cell, addresses: tuple[str, ...], order: Order) -> EmulatedDevice:
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
