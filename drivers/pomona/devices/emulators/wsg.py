"""A WSG gripper emulated at the level of bytes: refusals, fast stop, blocked axis, automatic updates, finger script."""

from __future__ import annotations

from pomona.devices.emulators.server import Peer
from pomona.devices.wsg.codec import (
    Command,
    Homing,
    Move,
    Observe,
    Plain,
    Reply,
    Request,
    Script,
    SetSoftLimits,
    SetValue,
    Status,
    SystemState,
    decode_request,
    encode_reply,
)
from pomona.devices.wsg.frame import FrameDecoder, encode_frame
from pomona.drivers import Gripper, Malformed, Motion, MotionRefused, MotionState

FORCE_MIN = 5.0
"""Least limit of the force of one finger [N] (data sheet of the WSG 32)."""


class WsgEmulator:
    """The gripper's controller on top of any `Gripper` that moves its fingers.

    Attributes:
        referenced: whether homing was done; moves are refused before.
        has_script: whether the finger script is loaded.
        silent: the cable is pulled: nothing comes in and nothing goes out.
        faults: fault bits that the gripper reports in addition to its own state.
        refusing: commands that are answered with ACCESS_DENIED and not carried out.
        deaf: commands that are neither answered nor carried out, and updates that do not come.
        busy: a move is accepted (PENDING), but never begins or ends.
        runaway: speed at which the fingers move regardless of commands, until a fast stop [m/s].
        frozen: width and speed are reported as they were when this was set.
        reported_width: width that is reported instead of the true one [m].
    """

    def __init__(
        self,
        fingers: Gripper,
        finger_offset: float = 0.0,
        referenced: bool = True,
        has_script: bool = True,
    ) -> None:
        self.referenced = referenced
        self.has_script = has_script
        self.silent = False
        self.faults = SystemState(0)
        self.refusing: set[Command] = set()
        self.deaf: set[Command] = set()
        self.busy = False
        self.runaway = 0.0
        self.frozen = False
        self.reported_width: float | None = None
        self._frozen_values: dict[Command, tuple[float, ...]] = {}
        self._fingers = fingers
        self._offset = finger_offset
        self._peer: Peer | None = None
        self._decoder = FrameDecoder()
        self._now = 0.0
        self._bits = SystemState(0)
        self._motion: tuple[Command, Motion] | None = None
        self._speed = 0.0
        self._speed_until = 0.0
        self._updates: dict[Command, tuple[float, float]] = {}
        self._settings = {Command.SET_ACCELERATION: 2.0, Command.SET_FORCE_LIMIT: 40.0}
        self._soft_limits: tuple[float, float] | None = None
        self._said_goodbye = False

    # ------------------------------------------------------------------------------------------ faults

    def fast_stop(self) -> None:
        """Stop at once and refuse motion until it is acknowledged."""
        self.runaway = 0.0
        self._end_motion(Status.CMD_ABORTED)
        self._bits |= SystemState.FAST_STOP

    # -------------------------------------------------------------------------------------------- wire

    def connected(self, peer: Peer) -> None:
        self._peer, self._decoder, self._said_goodbye = peer, FrameDecoder(), False
        self._updates.clear()

    def disconnected(self, peer: Peer) -> None:
        if peer is self._peer:
            self._peer = None
            if not self._said_goodbye:
                self.fast_stop()

    def received(self, peer: Peer, chunk: bytes) -> None:
        if self.silent:
            return
        for frame in self._decoder.decode(chunk):
            try:
                request = decode_request(frame)
            except Malformed:
                known = frame.command in list(Command)
                status = Status.CMD_FORMAT_ERROR if known else Status.CMD_UNKNOWN
                self._send(encode_frame(type(frame)(frame.command, status.to_bytes(2, "little"))))
                continue
            self._answer(request)

    def advance(self, now: float) -> None:
        self._now = now
        self._fingers.state()  # lets kinematic fingers move on
        if self.runaway:
            self._fingers.set_speed(self.runaway)
        elif self._motion is not None:
            command, motion = self._motion
            if motion.state is MotionState.DONE:
                self._motion = None
                self._bits |= SystemState.TARGET_REACHED
                if command is Command.HOMING:
                    self.referenced = True
                self._reply(command)
            elif motion.state in (MotionState.FAILED, MotionState.STOPPED):
                self._motion = None
                self._bits |= SystemState.BLOCKED_MINUS
                self._reply(command, Status.AXIS_BLOCKED)
        elif self._speed != 0.0:
            if now > self._speed_until:
                self._speed = 0.0
            self._fingers.set_speed(self._limited(self._speed))
        for observed, (period, due) in self._updates.items():
            if now >= due and observed not in self.deaf:
                self._updates[observed] = (period, max(due + period, now))
                self._reply(observed, values=self._observe(observed))

    # ----------------------------------------------------------------------------------------- commands

    def _answer(self, request: Request) -> None:
        command = request.command
        if command in self.deaf:
            return
        if command in self.refusing:
            self._reply(command, Status.ACCESS_DENIED)
            return
        match request:
            case Plain(Command.DISCONNECT):
                self._said_goodbye = True
                self._reply(Command.DISCONNECT)
            case Plain(Command.STOP):
                self._end_motion(Status.CMD_ABORTED)
                self._bits |= SystemState.AXIS_STOPPED
                self._reply(Command.STOP)
            case Plain(Command.FAST_STOP):
                self.fast_stop()
                self._reply(Command.FAST_STOP)
            case Plain(Command.ACKNOWLEDGE):
                self._bits &= ~SystemState.FAST_STOP
                self._reply(Command.ACKNOWLEDGE)
            case Plain(Command.GET_ACCELERATION):
                self._reply(
                    Command.GET_ACCELERATION, values=(self._settings[Command.SET_ACCELERATION],)
                )
            case Plain(Command.GET_FORCE_LIMIT):
                self._reply(
                    Command.GET_FORCE_LIMIT, values=(self._settings[Command.SET_FORCE_LIMIT],)
                )
            case Plain(Command.CLEAR_SOFT_LIMITS):
                self._soft_limits = None
                self._reply(Command.CLEAR_SOFT_LIMITS)
            case Plain(Command.INFO):
                self._reply(Command.INFO, values=(2, 1, 0x2710, 32001))
            case Plain(Command.LIMITS):
                hardware = self._fingers.limits
                stroke = hardware.width_max - hardware.width_min
                force = hardware.force_max
                values = (stroke, 0.005, hardware.speed_max, 0.1, 5.0, FORCE_MIN, force, force)
                self._reply(Command.LIMITS, values=values)
            case SetValue(command, value):
                of_force = FORCE_MIN, self._fingers.limits.force_max
                least, most = of_force if command is Command.SET_FORCE_LIMIT else (1e-3, 10.0)
                fits = least <= value <= most
                if fits:
                    self._settings[command] = value
                self._reply(command, Status.SUCCESS if fits else Status.RANGE_ERROR)
            case SetSoftLimits(minus, plus):
                fits = minus < plus
                if fits:
                    self._soft_limits = (minus, plus)
                self._reply(Command.SET_SOFT_LIMITS, Status.SUCCESS if fits else Status.RANGE_ERROR)
            case Observe(command, auto, period):
                if auto:
                    self._updates[command] = (period, self._now + period)
                else:
                    self._updates.pop(command, None)
                self._reply(command, values=self._observe(command))
            case Homing():
                self._begin(Command.HOMING, self._fingers.limits.width_max - self._offset, 0.1)
            case Move(width, speed):
                self._begin(Command.MOVE, width, speed)
            case Script(command, _, speed):
                self._run_script(command, speed)

    def _begin(self, command: Command, width: float, speed: float) -> None:
        refusal = self._refusal(command)
        low, high = self._soft_limits or (-1.0, 1.0)
        if refusal is None and command is not Command.HOMING and not low <= width <= high:
            refusal = Status.RANGE_ERROR
        if refusal is None and not self.busy:
            try:
                force = min(self._settings[Command.SET_FORCE_LIMIT], self._fingers.limits.force_max)
                motion = self._fingers.move(width + self._offset, speed, force)
            except MotionRefused:
                refusal = Status.RANGE_ERROR
            else:
                self._speed = 0.0
                self._motion = (command, motion)
                self._bits &= ~(
                    SystemState.AXIS_STOPPED
                    | SystemState.TARGET_REACHED
                    | SystemState.BLOCKED_MINUS
                )
        self._reply(command, Status.CMD_PENDING if refusal is None else refusal)

    def _refusal(self, command: Command) -> Status | None:
        if self._bits & SystemState.FAST_STOP:
            return Status.ACCESS_DENIED
        if not self.referenced and command is not Command.HOMING:
            return Status.NOT_INITIALIZED
        return Status.ALREADY_RUNNING if self._motion is not None else None

    def _run_script(self, command: Command, speed: float) -> None:
        if not self.has_script:
            self._reply(command, Status.CMD_UNKNOWN)
            return
        if command is Command.SCRIPT_SPEED:
            if self._bits & SystemState.FAST_STOP or not self.referenced:
                self._reply(command, Status.ACCESS_DENIED)
                return
            self._end_motion(Status.CMD_ABORTED)
            # the finger script stops the fingers when the speed is not renewed within this time [s]
            self._speed = speed
            self._speed_until = self._now + 0.1
            self._fingers.set_speed(self.runaway or self._limited(speed))
        self._reply(command, values=(*self._observe(Command.WIDTH), *self._observe(Command.SPEED)))

    def _end_motion(self, status: Status) -> None:
        self._speed = 0.0
        if self._motion is not None:
            (command, _), self._motion = self._motion, None
            self._reply(command, status)
        self._fingers.set_speed(self.runaway)

    def _limited(self, speed: float) -> float:
        """Soft limits and the limit of the force hold for streamed speeds too."""
        pressing = self._fingers.state().motor_force or 0.0
        if speed < 0.0 and pressing >= 2.0 * self._settings[Command.SET_FORCE_LIMIT]:
            return 0.0
        low, high = self._soft_limits or (-1.0, 1.0)
        self._bits &= ~(SystemState.SOFT_LIMIT_MINUS | SystemState.SOFT_LIMIT_PLUS)
        if speed < 0.0 and self._jaw() <= low:
            self._bits |= SystemState.SOFT_LIMIT_MINUS
            return 0.0
        if speed > 0.0 and self._jaw() >= high:
            self._bits |= SystemState.SOFT_LIMIT_PLUS
            return 0.0
        return speed

    def _jaw(self) -> float:
        return self._fingers.state().width - self._offset

    def _observe(self, command: Command) -> tuple[float, ...]:
        if command is Command.SYSTEM_STATE:
            return (int(self._system_state()),)
        if not (self.frozen and command in self._frozen_values):
            self._frozen_values[command] = self._measure(command)
        return self._frozen_values[command]

    def _measure(self, command: Command) -> tuple[float, ...]:
        if command is Command.WIDTH:
            return (self._jaw() if self.reported_width is None else self.reported_width,)
        if command is Command.SPEED:
            return (self._fingers.state().speed,)
        return (0.0,)

    def _system_state(self) -> SystemState:
        bits = self._bits | self.faults
        bits |= SystemState.REFERENCED if self.referenced else SystemState(0)
        bits |= SystemState.MOVING if self._fingers.state().moving else SystemState(0)
        bits |= SystemState.SCRIPT_RUNNING if self.has_script else SystemState(0)
        return bits

    def _reply(
        self, command: Command, status: Status = Status.SUCCESS, values: tuple[float, ...] = ()
    ) -> None:
        self._send(encode_reply(Reply(command, status, values)))

    def _send(self, chunk: bytes) -> None:
        if self._peer is not None and not self.silent:
            self._peer.send(chunk)
