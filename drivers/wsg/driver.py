"""The WSG gripper as a `Gripper`: handshake, refusals, streamed speed with its watchdog, loss and recovery.

A thread serves the wire: it takes replies and automatic updates, streams the wanted speed, and notices silence. A lost
gripper stays latched: the wire is opened again and the whole handshake repeated, and nothing moves until somebody has
acknowledged the loss and starts a new motion.
"""

from __future__ import annotations

import contextlib
import math
import threading
from collections.abc import Callable

from drivers.device import Device
from drivers.errors import DeviceError, DeviceFault, DeviceLost, MotionRefused
from drivers.interfaces import Gripper, GripperLimits, GripperState, MotionState
from drivers.wire import Link, ServiceLoop
from drivers.wsg.codec import (
    Command,
    Move,
    Plain,
    Reply,
    Script,
    Status,
    SystemState,
)
from drivers.wsg.handshake import WsgIdentity, WsgOptions, shake_hands
from drivers.wsg.motion import GripperMotion
from drivers.wsg.session import Session
from executive.clock import Clock

RECONNECT = 0.5
"""Pause between attempts to open a lost wire again [s]."""
STREAM_PERIOD = 0.018
"""Set-points of the speed follow each other no faster than this [s]: the finger script manages about 50 Hz."""
GRACE = 0.3
"""After an acknowledgement the gripper has this long to clear its fault [s]."""

FAULTS: dict[SystemState, str] = {
    SystemState.FAST_STOP: "is in fast stop; find out why, then acknowledge",
    SystemState.TEMPERATURE: "is too hot and has switched off",
    SystemState.POWER: "has a supply voltage outside its limits",
    SystemState.CURRENT: "draws too much current",
    SystemState.FINGER_FAULT: "reports a fault of a finger",
    SystemState.SCRIPT_FAILURE: "has a finger script that failed",
}


class WsgGripper(Device):
    """A WSG gripper on any link."""

    interfaces = (Gripper,)

    def __init__(
        self, open_link: Callable[[], Link], clock: Clock, options: WsgOptions | None = None, name: str = "gripper"
    ) -> None:
        super().__init__(name)
        self.options = options or WsgOptions()
        self.identity: WsgIdentity | None = None
        """What the gripper said of itself in the last handshake."""
        self._open_link, self._clock = open_link, clock
        self._lock = threading.RLock()
        self._loop = ServiceLoop(f"{name} wire", self.step, self._lose, clock)
        self._session: Session | None = None
        self._retry_at = 0.0
        self._limits = GripperLimits(0.0, 0.0, 0.0, 0.0)
        self._bits = SystemState(0)
        self._jaw, self._rate, self._stamp = 0.0, 0.0, 0.0
        self._motion: GripperMotion | None = None
        self._waiting: GripperMotion | None = None  # to be started when the stop before it is answered
        self._wanted, self._wanted_at, self._sent_at, self._sent = 0.0, -math.inf, -math.inf, 0.0
        self._latched: str | None = None
        self._latched_width = math.inf
        self._problem: DeviceError | None = DeviceLost(name, "was never connected")
        self._grace_until = -math.inf

    # ---------------------------------------------------------------------------------------- connection

    def connect(self) -> None:
        """Open the wire and shake hands.

        Raises:
            DeviceError: no such gripper there, or it refuses the handshake.
        """
        self._session = self._open()
        self._problem = None

    def start(self) -> None:
        """Serve the wire in a thread of its own from now on."""
        self._loop.start()

    def step(self) -> None:
        """Serve the wire for a few milliseconds; the gripper's own thread calls this without end."""
        try:
            if self._session is None:
                self._reconnect()
            else:
                self._serve(self._session)
        except (OSError, DeviceError) as error:
            self._lose(error)

    def _reconnect(self) -> None:
        if self._clock.now() < self._retry_at:
            self._clock.advance(min(self._retry_at - self._clock.now(), 0.05))
            return
        self._session = self._open()

    def _open(self) -> Session:
        try:
            session = Session(self.name, self._open_link(), self._clock)
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
        with self._lock:
            self.identity, self._limits = identity, identity.limits(self.options)
            self._wanted = self._sent = 0.0
        return session

    def _lose(self, error: Exception) -> None:
        with self._lock:
            session, self._session = self._session, None
            if session is not None or self._problem is None:
                words = str(error) if isinstance(error, OSError) else f"the driver failed: {error!r}"
                self._problem = error if isinstance(error, DeviceError) else DeviceLost(self.name, words)
            self._wanted = self._sent = 0.0
            self._waiting = None
            if self._motion is not None:
                self._motion.end(MotionState.FAILED, f"the gripper was lost: {_words(self._problem)}")
                self._motion.settled = True
            self._retry_at = self._clock.now() + RECONNECT
        if session is not None:
            session.close()

    # --------------------------------------------------------------------------------------- the interface

    @property
    def limits(self) -> GripperLimits:
        return self._limits

    def state(self) -> GripperState:
        """As the Protocol says.

        Raises:
            DeviceLost: there is no fresh state.
        """
        with self._lock:
            self._need_link()
            moving = bool(self._bits & SystemState.MOVING) or abs(self._rate) > 5e-4
            return GripperState(self._stamp, self._jaw + self.options.finger_offset, self._rate, moving)

    def move(self, width: float, speed: float) -> GripperMotion:
        limits = self._limits
        with self._lock:
            self._need_readiness()
            if not limits.width_min - 1e-6 <= width <= limits.width_max + 1e-6:
                span = f"{1e3 * limits.width_min:.1f} … {1e3 * limits.width_max:.1f} mm"
                raise MotionRefused(self.name, f"an opening of {1e3 * width:.1f} mm lies outside {span}")
            if not 0.0 < speed <= limits.speed_max * (1.0 + 1e-6):
                raise MotionRefused(self.name, f"a speed of {speed:g} m/s lies outside 0 … {limits.speed_max:g} m/s")
            start = self._jaw + self.options.finger_offset
            motion = GripperMotion(width, min(speed, limits.speed_max), start, self._stop_motion)
            self._begin(motion)
            self._motion = motion
            return motion

    def set_speed(self, speed: float) -> None:
        """As the Protocol says; while latched the fingers may close and hold but not open.

        Raises:
            DeviceLost: the gripper is lost.
            DeviceFault: it has no finger script for streamed speeds, or is in fast stop.
        """
        with self._lock:
            self._need_link()
            if self.identity is None or not self.identity.has_script:
                raise DeviceFault(self.name, "has no finger script for streamed speeds: load drivers/wsg/velocity.lua")
            if self._bits & SystemState.FAST_STOP:
                raise DeviceFault(self.name, FAULTS[SystemState.FAST_STOP])
            limit = self._limits.speed_max
            wanted = min(max(speed, -limit), limit) if math.isfinite(speed) else 0.0
            if self._latched is not None and wanted > 0.0:
                wanted = 0.0
            if self._motion is not None and not self._motion.ended:
                self._stop_motion(self._motion)
            now = self._clock.now()
            self._wanted, self._wanted_at = wanted, now
            if now - self._sent_at >= STREAM_PERIOD or (wanted == 0.0 and self._sent != 0.0):
                self._send_speed(wanted)

    def tare(self) -> None:
        """Tare the gripper's own force sensor; nothing must touch the fingers."""
        with self._lock:
            self._need_link()
            self._send(Plain(Command.TARE), Command.TARE)

    # ------------------------------------------------------------------------------------------ the device

    def link(self) -> str:
        with self._lock:
            return "ok" if self._problem is None else self._problem.message

    def check(self) -> None:
        if self._problem is not None:
            raise self._problem

    def safe_stop(self, reason: str) -> None:
        with self._lock, contextlib.suppress(DeviceError):
            if self._latched is None:
                self._latched = reason
            if self._motion is not None and not self._motion.ended:
                self._stop_motion(self._motion)
            self._wanted = 0.0
            if self._sent != 0.0:
                self._send_speed(0.0)

    def acknowledge(self) -> None:
        """Release the latch, and a fast stop of the gripper.

        Raises:
            DeviceLost: it is still lost.
        """
        with self._lock:
            if self._session is None:
                raise DeviceLost(self.name, f"is still lost: {_words(self._problem)}")
            if self._bits & SystemState.FAST_STOP:
                self._send(Plain(Command.ACKNOWLEDGE), Command.ACKNOWLEDGE)
            self._grace_until = self._clock.now() + GRACE
            self._latched, self._problem = None, None

    def pause(self) -> None:
        with self._lock:
            motion = self._motion
            if motion is not None and motion.state is MotionState.RUNNING:
                motion.state = MotionState.PAUSED
                self._waiting = None
                with contextlib.suppress(DeviceError):
                    self._send(Plain(Command.STOP), Command.STOP)

    def resume(self) -> None:
        with self._lock:
            motion = self._motion
            if motion is not None and motion.state is MotionState.PAUSED:
                self._need_readiness()
                motion.state = MotionState.RUNNING
                self._begin(motion)

    def settled(self) -> bool:
        """Streamed speeds do not count as motion: force control may go on for hours."""
        motion = self._motion
        paused = motion is not None and motion.state is MotionState.PAUSED and not self._bits & SystemState.MOVING
        return motion is None or motion.settled or paused

    def close(self) -> None:
        """Stop the fingers where they are and say goodbye: a gripper that is left without it makes a fast stop."""
        self.safe_stop("closed")
        self._loop.close()
        session, self._session = self._session, None
        if session is not None:
            with contextlib.suppress(OSError):
                session.send(Plain(Command.DISCONNECT), Command.DISCONNECT)
            session.close()
        self._problem = DeviceLost(self.name, "is closed")

    # ------------------------------------------------------------------------------- requests and replies

    def _need_link(self) -> None:
        if self._session is None:
            raise DeviceLost(self.name, _words(self._problem))

    def _need_readiness(self) -> None:
        if self._latched is not None:
            raise MotionRefused(self.name, f"latched in the safe state ({self._latched})")
        if self._session is None or self._problem is not None:
            raise MotionRefused(self.name, f"not ready: {_words(self._problem)}")
        if not self._bits & SystemState.REFERENCED:
            raise MotionRefused(self.name, "has no reference yet; set 'home: true' in the cell file or home it by hand")

    def _send(self, request: Plain | Move | Script, command: Command) -> None:
        session = self._session
        if session is None:
            raise DeviceLost(self.name, _words(self._problem))
        try:
            session.send(request, command)
        except OSError as error:
            self._lose(error)
            raise DeviceLost(self.name, str(error)) from error

    def _begin(self, motion: GripperMotion) -> None:
        """Start a motion once nothing else moves the fingers any more."""
        if self._motion is not None and self._motion is not motion:
            self._motion.end(MotionState.STOPPED)
            self._motion.settled = True
        self._wanted = self._sent = 0.0
        self._waiting = motion
        self._send(Plain(Command.STOP), Command.STOP)

    def _stop_motion(self, motion: GripperMotion) -> None:
        with self._lock:
            if motion.ended or motion is not self._motion:
                return
            self._waiting = None
            motion.end(MotionState.STOPPED)
            self._send(Plain(Command.STOP), Command.STOP)

    def _send_speed(self, speed: float) -> None:
        self._sent, self._sent_at = speed, self._clock.now()
        self._send(Script(Command.SCRIPT_SPEED, 0.0, speed), Command.SCRIPT_SPEED)

    def _serve(self, session: Session) -> None:
        replies = session.receive(self._patience())
        if not replies and self._clock.now() - session.last_heard > self.options.silence:
            replies = session.receive(0.0)  # this thread itself may have been held up
        with self._lock:
            for reply in replies:
                self._take(reply)
            now = self._clock.now()
            if now - self._wanted_at > self.options.watchdog:
                self._wanted = 0.0
            if self._session is session and self._wanted != self._sent and now - self._sent_at >= STREAM_PERIOD:
                self._send_speed(self._wanted)
            elif self._wanted != 0.0 and now - self._sent_at >= 2.0 * STREAM_PERIOD:
                self._send_speed(self._wanted)  # keeps the finger script's own watchdog calm
        if not replies and now - session.last_heard > self.options.silence:
            raise DeviceLost(self.name, f"no answer for {1e3 * (now - session.last_heard):.0f} ms")

    def _patience(self) -> float:
        """How long the wire may be waited for: until the next set-point at most."""
        streaming = self._wanted != self._sent or self._wanted != 0.0
        return min(max(self._sent_at + STREAM_PERIOD - self._clock.now(), 0.0), 0.005) if streaming else 0.005

    def _take(self, reply: Reply) -> None:
        """Take in one reply or update, outside or inside the handshake."""
        with self._lock:
            good = reply.status is Status.SUCCESS
            match reply.command:
                case Command.SYSTEM_STATE if good:
                    self._take_bits(SystemState(int(reply.values[0])))
                case Command.WIDTH if good:
                    self._take_width(reply.values[0])
                case Command.SPEED if good:
                    self._rate = reply.values[0]
                case Command.SCRIPT_SPEED if good:
                    self._take_width(reply.values[0])
                    self._rate = reply.values[1]
                case Command.SCRIPT_SPEED:
                    self._problem = DeviceFault(self.name, f"refused a streamed speed: {reply.status.name}")
                case Command.STOP if good and self._waiting is not None:
                    motion, self._waiting = self._waiting, None
                    jaw = motion.width - self.options.finger_offset
                    self._send(Move(jaw, motion.speed), Command.MOVE)
                case Command.MOVE:
                    self._take_outcome(reply.status)

    def _take_bits(self, bits: SystemState) -> None:
        now = self._clock.now()
        self._bits = bits
        fault = next((words for bit, words in FAULTS.items() if bits & bit), None)
        if fault is not None and self._problem is None and now > self._grace_until:
            self._problem = DeviceFault(self.name, fault)
            if self._motion is not None:
                self._motion.end(MotionState.FAILED, f"{self.name}: {fault}")
        motion = self._motion
        if motion is not None and motion.ended and not bits & SystemState.MOVING:
            motion.settled = True

    def _take_width(self, jaw: float) -> None:
        self._jaw, self._stamp = jaw, self._clock.now()
        if self._motion is not None:
            self._motion.measured = jaw + self.options.finger_offset

    def _take_outcome(self, status: Status) -> None:
        """The end of a MOVE. One that was ended from here answers CMD_ABORTED, which says nothing new."""
        motion = self._motion
        if motion is None or status is Status.CMD_PENDING or motion.state is not MotionState.RUNNING:
            return
        if self._waiting is motion:  # the answer of the move before
            return
        if status is Status.SUCCESS:
            motion.measured = motion.width
            motion.end(MotionState.DONE)
            motion.settled = True
        elif status is Status.AXIS_BLOCKED:
            motion.end(MotionState.FAILED, f"the fingers are blocked at {1e3 * motion.measured:.1f} mm")
        else:
            motion.end(MotionState.FAILED, f"the gripper ended the move: {status.name}")


def _words(problem: DeviceError | None) -> str:
    return problem.message if problem is not None else "no problem is known"
