"""The gripper behind its connection, as seen by the one thread that owns it.

It takes replies and automatic updates, streams the commanded speed, compares measured with commanded motion, and
detects silence. After a loss it reconnects and repeats the whole handshake, with a stop before anything that could move
the fingers.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from pomona.devices.wsg.codec import Command, Move, Plain, Reply, Script, Status, SystemState
from pomona.devices.wsg.handshake import WsgIdentity, WsgOptions, shake_hands
from pomona.devices.wsg.session import GripperSession
from pomona.drivers import (
    Device,
    DeviceError,
    DeviceFault,
    DeviceLost,
    GripperLimits,
    GripperMotion,
    GripperState,
    GripperSupervisor,
    Link,
    MotionState,
    StopFailed,
    Watchdog,
    allowed_speed,
)
from pomona.executive import Clock

RECONNECT = 0.5  # pause between attempts to reconnect [s]
STREAM_PERIOD = 0.018  # shortest period of the speed set-points [s]: the finger script manages about 50 Hz
PATIENCE = 0.002  # receive timeout [s]: posted calls wait meanwhile
STOPPING = 0.2  # deadline for coming to rest after a stop [s]: braking from 0.2 m/s at 2 m/s² takes 0.1 s

ARRIVED, ARRIVAL = 2e-3, 0.1  # tolerance at the end of a move [m], and deadline for measuring it [s]

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


class Jaws:
    """The owner's side of a gripper. Only the owner calls its methods; others read the attributes.

    Attributes:
        identity: reported by the gripper in the last handshake.
        session: None while the gripper is lost.
        limits: the narrower of the hardware's and the cell file's.
        state: newest measurement.
        bits: newest system state that the gripper has reported.
        supervisor: compares the fingers' motion with their commands.
        problem: a fault, until it is acknowledged.
        lost_since_ack: lost since the last acknowledgement: nothing may move.
        latched: reason of a safe stop, until it is acknowledged.
    """

    def __init__(self, device: Device, open_link: Callable[[], Link], clock: Clock, options: WsgOptions) -> None:
        self.options = options
        self.identity: WsgIdentity | None = None
        self.session: GripperSession | None = None
        self.limits = GripperLimits(0.0, 0.0, 0.0, 0.0)
        self.state = GripperState(0.0, 0.0, 0.0, False)
        self.bits = SystemState(0)
        self.supervisor = GripperSupervisor(self.limits, 1.0)
        self.problem: DeviceError | None = DeviceLost(device.name, "was never connected")
        self.lost_since_ack = False
        self.latched: str | None = None
        self._device, self._open_link, self._clock = device, open_link, clock
        self._retry_at = 0.0
        self._rate = 0.0
        self._aim: float | None = None
        self._updated: dict[Command, float] = {}
        self._motion: GripperMotion | None = None
        self._waiting: GripperMotion | None = None  # to be started when the stop before it is answered
        self._wanted, self._sent_at, self._sent = 0.0, -math.inf, 0.0
        self._watchdog = Watchdog(options.watchdog)
        self._arriving: float | None = None  # the gripper reports arrival; deadline for its width to confirm it
        self._grace_until = -math.inf
        self._obey_by: float | None = None  # deadline for coming to rest after a stop

    @property
    def name(self) -> str:
        """The device's, as its cell calls it."""
        return self._device.name

    def step(self) -> None:
        """Serve the connection for a few milliseconds."""
        try:
            if self.session is None:
                self._reconnect()
            else:
                self._serve(self.session)
        except (OSError, DeviceError) as error:
            self.lose(error)

    def _reconnect(self) -> None:
        now = self._clock.now()
        if self._motion is not None and now > self.supervisor.rest_by:
            self._motion.settled = True
        if now < self._retry_at:
            self._clock.advance(min(self._retry_at - now, 0.02))
            return
        self.session = self.open()

    def open(self) -> GripperSession:
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
        now, options = self._clock.now(), self.options
        self.identity, self.limits = identity, identity.limits(options)
        self.supervisor = GripperSupervisor(identity.reach(options), identity.acceleration, options.supervision)
        self.supervisor.rest(now)
        self._updated = dict.fromkeys(UPDATES, now)
        self._wanted = self._sent = 0.0
        return session

    def lose(self, error: BaseException) -> None:
        """Close the connection after an error; the next steps try to reconnect."""
        session, self.session = self.session, None
        if session is not None or self.problem is None:
            said = str(error) if isinstance(error, OSError) else f"the driver failed: {error!r}"
            lost = error if isinstance(error, DeviceError) else DeviceLost(self.name, said)
            lost.__cause__ = None if lost is error else error
            self.problem, self.lost_since_ack = lost, True
        self._wanted = self._sent = 0.0
        self._waiting = self._obey_by = None
        if self._motion is not None:
            self._motion.end(MotionState.FAILED, f"the gripper was lost: {words(self.problem)}")
        self._retry_at = self._clock.now() + RECONNECT
        if session is not None:
            session.close()

    # -------------------------------------------------------------------------------------------- commands

    def unready(self) -> str:
        """Why no move may be started now; empty when it may."""
        if self.latched is not None:
            return f"latched in the safe state ({self.latched})"
        if self.session is None or self.problem is not None:
            return f"not ready: {words(self.problem)}"
        if not self.bits & SystemState.REFERENCED:
            return (
                "has no reference: check that it holds nothing, then start with --cleared and 'home: true' in the cell "
                "file, or home it by hand"
            )
        return ""

    def begin(self, motion: GripperMotion) -> None:
        """Stop the fingers, then start a motion."""
        refusal = self.unready()
        if refusal:  # a safe stop or a loss came first
            motion.end(MotionState.FAILED, f"{self.name}: {refusal}")
            motion.settled = motion is not self._motion or motion.settled
            return
        if self._motion is not None and self._motion is not motion:
            self._motion.end(MotionState.STOPPED)
            self._motion.settled = True
        self._motion, self._aim = motion, motion.width
        self._wanted = self._sent = 0.0
        self._waiting, self._arriving = motion, None
        self.supervisor.move(self._clock.now(), self.state.width, motion.width, motion.speed)
        self.send(Plain(Command.STOP), Command.STOP)

    def stop_motion(self, motion: GripperMotion) -> None:
        """Stop a motion that has not ended."""
        if motion.ended:
            return
        motion.end(MotionState.STOPPED)
        if motion is self._motion:
            self._halt()

    def stream(self, speed: float) -> None:
        """Set the streamed speed [m/s]; while latched the fingers do not open."""
        if self.session is None or self.lost_since_ack:
            return
        wanted = allowed_speed(speed, self.limits, self.latched is not None)
        if self._motion is not None and not self._motion.ended:
            self.stop_motion(self._motion)
        now = self._clock.now()
        self._wanted, self._aim = wanted, None
        self._watchdog.renew(now)
        if now - self._sent_at >= STREAM_PERIOD or (wanted == 0.0 and self._sent != 0.0):
            self._send_speed(wanted)

    def stop_safely(self, reason: str) -> None:
        """Latch and stop, in any state."""
        if self.latched is None:
            self.latched = reason
        if self._motion is not None:
            self._motion.end(MotionState.STOPPED)
        self._halt()

    def release(self) -> None:
        """Release the latch and clear the problem. Raises DeviceLost: the gripper is still lost."""
        if self.session is None:
            raise DeviceLost(self.name, f"is still lost: {words(self.problem)}")
        now = self._clock.now()
        if self.bits & SystemState.FAST_STOP:
            self.send(Plain(Command.ACKNOWLEDGE), Command.ACKNOWLEDGE)
        self._grace_until = now + 0.3  # time that the gripper has to clear its fault after an acknowledgement [s]
        self.supervisor.rest(now)
        self._obey_by = None
        self.latched, self.problem, self.lost_since_ack = None, None, False

    def pause(self) -> None:
        """Stop a motion so that it can be resumed."""
        motion = self._motion
        if motion is not None and motion.state is MotionState.RUNNING:
            motion.state = MotionState.PAUSED
            self._halt()

    def resume(self) -> None:
        """Resume a paused motion."""
        if self._motion is not None and self._motion.state is MotionState.PAUSED:
            self._motion.state = MotionState.RUNNING
            self.begin(self._motion)

    def obeys(self) -> bool:
        """Return True if no stop is pending, and the fingers are at rest or follow the streamed speed."""
        return self._obey_by is None and self._resting()

    # -------------------------------------------------------------------------------------------- the wire

    def send(self, request: Plain | Move | Script, command: Command) -> None:
        """Send a request; it is dropped while disconnected, and a connection that fails is lost."""
        session = self.session
        if session is None:
            return
        try:
            session.send(request, command)
        except OSError as error:
            self.lose(error)

    def _halt(self) -> None:
        self._waiting, self._wanted = None, 0.0
        if self.session is None:
            return
        now = self._clock.now()
        self.supervisor.rest(now)
        if self._obey_by is None:
            self._obey_by = now + STOPPING
        if self._sent != 0.0:
            self._send_speed(0.0)
        self.send(Plain(Command.STOP), Command.STOP)

    def _send_speed(self, speed: float) -> None:
        self._sent, self._sent_at = speed, self._clock.now()
        self.supervisor.stream(self._sent_at, speed, self.options.watchdog)
        self.send(Script(Command.SCRIPT_SPEED, 0.0, speed), Command.SCRIPT_SPEED)

    def _serve(self, session: GripperSession) -> None:
        replies = session.receive(self._patience())
        if not replies and self._clock.now() - session.last_heard > self.options.silence:
            replies = session.receive(0.0)  # this thread itself may have stalled
        for reply in replies:
            self._take(reply)
        now = self._clock.now()
        if self.session is not session:
            return
        self._keep_streaming(now)
        self._supervise(session, now)
        if not replies and now - session.last_heard > self.options.silence:
            raise DeviceLost(self.name, f"no answer for {1e3 * (now - session.last_heard):.0f} ms")
        command, came_at = min(self._updated.items(), key=lambda item: item[1])
        if now - came_at > 2.0 * self.options.silence:
            raise DeviceLost(self.name, f"has not sent its {command.name} for {1e3 * (now - came_at):.0f} ms")

    def _patience(self) -> float:
        """Receive timeout [s]: at most until the next set-point is due."""
        if self._wanted == self._sent == 0.0:
            return PATIENCE
        return min(max(self._sent_at + STREAM_PERIOD - self._clock.now(), 0.0), PATIENCE)

    def _keep_streaming(self, now: float) -> None:
        if self._watchdog.has_expired(now):
            self._wanted = 0.0
        changed = self._wanted != self._sent and (self._wanted == 0.0 or now - self._sent_at >= STREAM_PERIOD)
        # Renewing feeds the finger script's own watchdog.
        if changed or (self._wanted != 0.0 and now - self._sent_at >= 2.0 * STREAM_PERIOD):
            self._send_speed(self._wanted)

    def _supervise(self, session: GripperSession, now: float) -> None:
        """Compare measured with commanded motion, and enforce stops."""
        wrong = self.supervisor.look(now, self.state)
        if wrong and (self.problem is None or self._obey_by is None):
            self._fail(wrong)
        if self._obey_by is not None and not session.awaits(Command.STOP):
            if self._resting():
                self._obey_by = None
            elif self.state.stamp > self._obey_by:  # not the clock: this thread may have stalled
                width = 1e3 * self.state.width
                self._disobeyed(f"was not measured at rest {1e3 * STOPPING:.0f} ms after a stop, at {width:.1f} mm")
        motion = self._motion
        if motion is not None:
            self._arrive(motion)
        if motion is not None and motion.ended and self._obey_by is None and self._resting():
            motion.settled = True

    def _arrive(self, motion: GripperMotion) -> None:
        """A move is done once the measured width confirms it."""
        if self._arriving is None or motion.state is not MotionState.RUNNING:
            return
        if abs(motion.measured - motion.width) < ARRIVED:
            motion.measured = motion.width
            motion.end(MotionState.DONE)
        elif self._clock.now() > self._arriving:
            here, there = 1e3 * motion.measured, 1e3 * motion.width
            self._fail(f"measures {here:.1f} mm at the end of a move to {there:.1f} mm")

    def _resting(self) -> bool:
        """Return True if the fingers are at rest, or follow the streamed speed."""
        if self._sent != 0.0:
            return self.supervisor.follows
        return self.supervisor.at_rest and not self.bits & SystemState.MOVING

    def _disobeyed(self, words: str) -> None:
        """Report a failed stop before any other problem, and try the fast stop."""
        self.problem = StopFailed(self.name, words, self.problem)
        self._obey_by = self._clock.now() + STOPPING
        self.send(Plain(Command.FAST_STOP), Command.FAST_STOP)

    def _fail(self, words: str) -> None:
        """Handle a fault of the gripper: fail its move, and stop it."""
        if self.problem is None:
            self.problem = DeviceFault(self.name, words)
        if self._motion is not None:
            self._motion.end(MotionState.FAILED, f"{self.name}: {words}")
        self._halt()

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
                self.problem = self.problem or DeviceFault(self.name, f"refused a streamed speed: {reply.status.name}")
            case Command.STOP | Command.FAST_STOP:
                self._take_stop(reply)
            case Command.MOVE:
                self._take_outcome(reply.status)

    def _take_bits(self, bits: SystemState) -> None:
        self.bits = bits
        fault = next((words for bit, words in FAULTS.items() if bits & bit), None)
        if fault is None or self.problem is not None or self._clock.now() <= self._grace_until:
            return
        if self._motion is not None and not self._motion.ended:
            self._fail(fault)
        else:  # the safe stop decides whether force control may go on
            self.problem = DeviceFault(self.name, fault)

    def _take_width(self, jaw: float) -> None:
        width = jaw + self.options.finger_offset
        moving = bool(self.bits & SystemState.MOVING) or abs(self._rate) > 5e-4
        referenced = bool(self.bits & SystemState.REFERENCED)
        now = self._clock.now()
        self.state = GripperState(now, width, self._rate, moving, referenced=referenced, aim=self._aim)
        if self._motion is not None:
            self._motion.measured = width

    def _take_stop(self, reply: Reply) -> None:
        motion, self._waiting = self._waiting, None
        if reply.status is Status.SUCCESS:
            if motion is not None:
                self.send(Move(motion.width - self.options.finger_offset, motion.speed), Command.MOVE)
            return
        words = f"refused {reply.command.name}: {reply.status.name}"
        if motion is not None:
            motion.end(MotionState.FAILED, f"{self.name}: {words}")
        if reply.command is Command.STOP and not self.bits & SystemState.FAST_STOP:
            self._disobeyed(words)
        elif reply.command is Command.FAST_STOP:
            self.problem = StopFailed(self.name, words, self.problem)

    def _take_outcome(self, status: Status) -> None:
        """The end of a MOVE. One that we ended answers CMD_ABORTED, which is no news."""
        motion = self._motion
        if motion is None or status is Status.CMD_PENDING or motion.state is not MotionState.RUNNING:
            return
        if self._waiting is motion:  # the reply belongs to the previous move
            return
        self.supervisor.rest(self._clock.now())
        if status is Status.SUCCESS:
            self._arriving = self._clock.now() + ARRIVAL
            self._arrive(motion)
        elif status is Status.AXIS_BLOCKED:
            motion.end(MotionState.FAILED, f"the fingers are blocked at {1e3 * motion.measured:.1f} mm")
        else:
            motion.end(MotionState.FAILED, f"the gripper ended the move: {status.name}")


def words(problem: DeviceError | None) -> str:
    """Return a problem as a sentence."""
    return problem.message if problem is not None else "no problem is known"
