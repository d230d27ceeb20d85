"""The WSG gripper as a `Gripper`.

It takes replies and automatic updates, streams the commanded speed, confirms each stop, and detects silence. After a
loss it reconnects and repeats the whole handshake, with a stop before anything that could move the fingers.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable

from pomona.devices.wsg.codec import (
    Command,
    Move,
    Plain,
    Reply,
    Request,
    Script,
    SetValue,
    Status,
    SystemState,
)
from pomona.devices.wsg.handshake import WsgIdentity, WsgOptions, shake_hands
from pomona.devices.wsg.session import GripperSession
from pomona.drivers import (
    DeviceFault,
    DeviceLost,
    GripperLimits,
    GripperMotion,
    GripperState,
    GripperSupervisor,
    Link,
    MotionState,
    ParallelGripper,
    SpeedOrder,
    Stop,
    Wanted,
    WidthOrder,
)
from pomona.executive import Clock

# shortest period of the speed set-points [s]: the finger script manages about 50 Hz
STREAM_PERIOD = 0.018
PATIENCE = 0.002  # receive timeout [s]: posted calls wait meanwhile

ARRIVED = 2e-3
ARRIVAL = 0.1  # tolerance at the end of a move [m], and deadline for measuring it [s]

UPDATES = (Command.WIDTH, Command.SPEED, Command.SYSTEM_STATE)
"""Automatic updates of the gripper; their absence is a fault."""

FAULTS: dict[SystemState, str] = {
    SystemState.FAST_STOP: "is in fast stop; find out why, then acknowledge",
    SystemState.TEMPERATURE: "is too hot and has switched off",
    SystemState.POWER: "has a supply voltage outside its limits",
    SystemState.CURRENT: "draws too much current",
    SystemState.FINGER_FAULT: "reports a fault of a finger",
    SystemState.SCRIPT_FAILURE: "has a finger script that failed",
}


class WsgGripper(ParallelGripper[SystemState, Request]):
    """A WSG gripper on any link.

    Attributes:
        identity: reported by the gripper in the last handshake.
        limits: the narrower of the hardware's and the cell file's.
    """

    outlives = True
    stopping = 0.2  # braking from 0.2 m/s at 2 m/s² takes 0.1 s
    repeat = 0.0  # its answers show what it has taken

    def __init__(
        self,
        open_link: Callable[[], Link],
        clock: Clock,
        options: WsgOptions | None = None,
        name: str = "gripper",
    ) -> None:
        self.options = options or WsgOptions()
        # the handshake reports the limits and the acceleration
        super().__init__(
            name,
            clock,
            GripperLimits(0.0, 0.0, 0.0, 0.0),
            acceleration=1.0,
            watchdog=self.options.watchdog,
        )
        self.identity: WsgIdentity | None = None
        self._problem = DeviceLost(name, "was never connected")
        self._open_link = open_link
        self._session: GripperSession | None = None  # None while the gripper is lost
        self._bits = SystemState(0)  # newest that the gripper has reported
        self._rate = 0.0
        self._updated: dict[Command, float] = {}
        self._streamed_at = -math.inf
        self._streamed = 0.0  # newest speed set-point
        self._ordered: GripperMotion | None = None  # its MOVE was sent, and no STOP since
        # which stop is sent: a gripper that does not obey it gets a fast stop; and whether that was answered
        self._halt = Command.STOP
        self._answered = True
        self._force = math.nan  # limit of the force that the gripper has [N]
        # the gripper reports arrival; deadline for its width to confirm it
        self._arriving: float | None = None
        self._grace_until = -math.inf

    # ---------------------------------------------------------------------------------------- connection

    def connect(self) -> None:
        """Open the wire and shake hands. Raises DeviceError: no such gripper there, or it refuses the handshake."""
        self._reopen()
        self._problem = None

    def _open(self) -> None:
        """Connect and shake hands. Raises DeviceLost: no gripper answers. DeviceError: it refuses the handshake."""
        try:
            session = GripperSession(self.name, self._open_link(), self._clock)
        except OSError as error:
            raise DeviceLost(self.name, f"cannot be reached: {error}") from error
        try:
            identity = shake_hands(session, self.options, self._take, first=self.identity is None)
        except OSError as error:
            session.close()
            raise DeviceLost(self.name, f"the wire failed in the handshake: {error}") from error
        except BaseException:
            session.close()
            raise
        now = self._clock.now()
        options = self.options
        self.identity = identity
        self.limits = identity.limits(options)
        self._supervisor = GripperSupervisor(
            identity.reach(options), identity.acceleration, options.supervision
        )
        self._supervisor.rest(now)
        self._updated = dict.fromkeys(UPDATES, now)
        self._force = identity.force_limit
        self._streamed = 0.0
        self._ordered = None
        self._sent = Stop()
        self._answered = True  # by the handshake
        self._stop_by = now + self.stopping
        self._session = session
        self._lost = False

    def _leave(self) -> None:
        """Close the session: a gripper that loses its client makes a fast stop."""
        session = self._session
        self._session = None
        if session is not None:
            with contextlib.suppress(OSError):
                if not self._lost:
                    session.send(Plain(Command.DISCONNECT))
            session.close()

    # -------------------------------------------------------------------------------------------- commands

    def set_speed(self, speed: float) -> None:
        """See the Protocol; while latched the fingers may close and hold but not open.

        Raises:
            DeviceLost: the gripper is lost, or an earlier loss is not acknowledged.
            DeviceFault: it has no finger script for streamed speeds, or is in fast stop.
        """
        if not self._lost and not self._unacknowledged:
            if self.identity is None or not self.identity.has_script:
                raise DeviceFault(
                    self.name,
                    "has no finger script for streamed speeds: load drivers/pomona/devices/wsg/velocity.lua",
                )
            if self._bits & SystemState.FAST_STOP:
                raise DeviceFault(self.name, FAULTS[SystemState.FAST_STOP])
        super().set_speed(speed)

    def _refusal(self) -> str:
        if self._bits & SystemState.REFERENCED:
            return ""
        return (
            "has no reference: check that it holds nothing, then start with --cleared and 'home: true' in the cell "
            "file, or home it by hand"
        )

    def next_command(self, wanted: Wanted, status: SystemState) -> Request | None:
        """Return the next request; none while an answer is missing that it depends on."""
        session = self._session
        if session is None or any(map(session.awaits, (Command.STOP, Command.SET_FORCE_LIMIT))):
            return None
        match wanted:
            case Stop():
                if self._streamed:
                    return Script(Command.SCRIPT_SPEED)
                return None if self._answered else Plain(self._halt)
            case SpeedOrder(speed):
                if self._ordered is not None:
                    return Plain(Command.STOP)
                return Script(Command.SCRIPT_SPEED, 0.0, speed) if self._is_due(speed) else None
            case WidthOrder(width, speed, force):
                if self._ordered is not None and self._ordered is self._move:
                    return None
                halted = isinstance(self._sent, Stop | WidthOrder) and self._answered
                if self._ordered is not None or not halted:
                    return Plain(Command.STOP)
                if force != self._force:
                    return SetValue(Command.SET_FORCE_LIMIT, force)
                return Move(width - self.options.finger_offset, speed)

    def _is_due(self, speed: float) -> bool:
        """Return True if a speed is to be sent: no sooner than the finger script takes it, and to feed its watchdog."""
        if speed == 0.0:
            return self._streamed != 0.0
        return self._clock.now() - self._streamed_at >= STREAM_PERIOD

    def shows(self, wanted: Wanted, status: SystemState) -> bool:
        return isinstance(wanted, Stop) and self._answered and self._still()

    def _send(self, command: Request) -> None:
        """Send a request; it is dropped while disconnected, and a connection that fails is lost."""
        session = self._session
        if session is None:
            return
        match command:
            case Script(_, _, speed):
                self._streamed = speed
                self._streamed_at = self._clock.now()
                self._supervisor.stream(self._streamed_at, speed, self.options.watchdog)
            case Move():
                self._ordered = self._move
                self._arriving = None
            case SetValue(_, value):
                self._force = value
            case Plain(Command.STOP | Command.FAST_STOP):
                self._ordered = None
                self._answered = False
                self._streamed = 0.0
        try:
            session.send(command)
        except OSError as error:
            self._failed(error)

    def _rest(self) -> None:
        """As the base; a stop is sent in any reported state."""
        if not isinstance(self._wanted, Stop):
            self._answered = False
        super()._rest()

    def _set_stream(self, speed: float) -> None:
        """As the base; the supervisor knows a speed when it is sent."""
        self._wanted = SpeedOrder(speed)

    def _release(self) -> None:
        """Release the latch, and a fast stop of the gripper. Raises DeviceLost: the gripper is still lost."""
        super()._release()
        if self._bits & SystemState.FAST_STOP:
            self._send(Plain(Command.ACKNOWLEDGE))
        # time that the gripper has to clear its fault after an acknowledgement [s]
        self._grace_until = self._clock.now() + 0.3
        self._halt = Command.STOP

    # -------------------------------------------------------------------------------------------- the wire

    def _serve(self) -> None:
        """Serve the connection for a few milliseconds."""
        session = self._session
        if session is None:
            return  # a request found the wire broken
        replies = session.receive(self._patience())
        if not replies and self._clock.now() - session.last_heard > self.options.silence:
            replies = session.receive(0.0)  # this thread itself may have stalled
        for reply in replies:
            self._take(reply)
        now = self._clock.now()
        if not replies and now - session.last_heard > self.options.silence:
            raise DeviceLost(self.name, f"no answer for {1e3 * (now - session.last_heard):.0f} ms")
        command, came_at = min(self._updated.items(), key=lambda item: item[1])
        if now - came_at > 2.0 * self.options.silence:
            raise DeviceLost(
                self.name, f"has not sent its {command.name} for {1e3 * (now - came_at):.0f} ms"
            )

    def _patience(self) -> float:
        """Receive timeout [s]: at most until the next set-point is due."""
        if self._speed == self._streamed == 0.0:
            return PATIENCE
        return min(max(self._streamed_at + STREAM_PERIOD - self._clock.now(), 0.0), PATIENCE)

    def _watch(self, state: GripperState) -> None:
        """See whether the move that was sent has arrived."""
        if self._ordered is not None:
            self._arrive(self._ordered)

    def _arrive(self, move: GripperMotion) -> None:
        """A move is done once the measured width confirms it."""
        if self._arriving is None or move.state is not MotionState.RUNNING:
            return
        if abs(move.measured - move.width) < ARRIVED:
            move.measured = move.width
            self._end_order(MotionState.DONE)
        elif self._clock.now() > self._arriving:
            here = 1e3 * move.measured
            there = 1e3 * move.width
            self._fail(f"measures {here:.1f} mm at the end of a move to {there:.1f} mm")

    def _end_order(self, state: MotionState, problem: str = "") -> None:
        """The gripper has ended the move by itself."""
        if self._move is not None:
            self._move.end(state, problem)
        self._wanted = self._ordered = None

    def _still(self) -> bool:
        if self._streamed:
            return self._supervisor.follows
        return self._supervisor.at_rest and not self._bits & SystemState.MOVING

    def _disobeyed(self, words: str) -> None:
        """Report a failed stop, and try the fast stop."""
        super()._disobeyed(words)
        self._halt = Command.FAST_STOP
        self._answered = False

    def _take(self, reply: Reply) -> None:
        good = reply.status is Status.SUCCESS
        if good and reply.command in UPDATES:
            self._updated[reply.command] = self._clock.now()
        match reply.command:
            case Command.SYSTEM_STATE if good:
                self._take_bits(SystemState(int(reply.values[0])))
            case Command.WIDTH if good:
                self._take_width(reply.values[0])
            case Command.SPEED if good:
                self._rate = reply.values[0]
            case Command.SCRIPT_SPEED if good:
                self._rate = reply.values[1]
                self._take_width(reply.values[0])
            case Command.SCRIPT_SPEED:
                self._blame(
                    DeviceFault(self.name, f"refused a streamed speed: {reply.status.name}")
                )
            case Command.STOP | Command.FAST_STOP:
                self._take_stop(reply)
            case Command.SET_FORCE_LIMIT if not good:
                self._force = math.nan
                words = f"{self.name}: refused a limit of the force: {reply.status.name}"
                self._end_move(MotionState.FAILED, words)
            case Command.MOVE:
                self._take_outcome(reply.status)

    def _take_bits(self, bits: SystemState) -> None:
        self._bits = self._status = bits
        fault = next((words for bit, words in FAULTS.items() if bits & bit), None)
        if fault is None or self._problem is not None or self._clock.now() <= self._grace_until:
            return
        if self._move is not None and not self._move.ended:
            self._fail(fault)
        else:  # the safe stop decides whether force control may go on
            self._blame(DeviceFault(self.name, fault))

    def _take_width(self, jaw: float) -> None:
        """Note the width; `_supervise` looks at it, since the speed to it comes after it."""
        width = jaw + self.options.finger_offset
        moving = bool(self._bits & SystemState.MOVING) or abs(self._rate) > 5e-4
        referenced = bool(self._bits & SystemState.REFERENCED)
        self._state = GripperState(
            self._clock.now(), width, self._rate, moving, referenced=referenced, aim=self._aim
        )  # fmt: skip
        if self._move is not None:
            self._move.measured = width

    def _take_stop(self, reply: Reply) -> None:
        self._answered = True
        if reply.status is Status.SUCCESS:
            return
        words = f"refused {reply.command.name}: {reply.status.name}"
        if reply.command is Command.FAST_STOP:
            super()._disobeyed(words)
        elif not self._bits & SystemState.FAST_STOP:
            self._end_move(MotionState.FAILED, f"{self.name}: {words}")
            self._disobeyed(words)

    def _take_outcome(self, status: Status) -> None:
        """The end of a MOVE. One that we ended answers CMD_ABORTED, which is no news."""
        move = self._ordered
        if move is None or status is Status.CMD_PENDING or move.state is not MotionState.RUNNING:
            return
        self._supervisor.rest(self._clock.now())
        if status is Status.SUCCESS:
            self._arriving = self._clock.now() + ARRIVAL
            self._arrive(move)
        elif status is Status.AXIS_BLOCKED:
            width = 1e3 * move.measured
            self._end_order(MotionState.FAILED, f"the fingers are blocked at {width:.1f} mm")
        else:
            self._end_order(MotionState.FAILED, f"the gripper ended the move: {status.name}")
