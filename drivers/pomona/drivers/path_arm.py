"""Common base of drivers for arms that receive their path a moment ahead.

A controller gets set-points up to a short `lead` before the arm shall pass them. One thread owns the wire and the
motion; requests are posted to it. A problem fails the motion and stays latched until an operator acknowledges it, and
nothing resumes by itself. A driver derives from `PathArm` and implements the controller's protocol; one with a session
that may fail and is opened again derives from `StreamingArm`, and follows set-points of a skill, too.
"""

from __future__ import annotations

import contextlib
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar, Generic, Protocol, TypeVar

import numpy as np

from pomona.drivers.errors import BadTrajectory, DeviceError, DeviceFault, DeviceLost, MotionRefused
from pomona.drivers.interfaces import (
    Arm,
    ArmLimits,
    ArmState,
    Motion,
    MotionState,
    SetPoints,
    StreamedArm,
    Trajectory,
)
from pomona.drivers.motion_supervisor import MotionSupervisor, Supervision
from pomona.drivers.path_motion import PathMotion
from pomona.drivers.streamed_motion import StreamedMotion
from pomona.drivers.trajectory import check_trajectory
from pomona.executive.cell.device import Device
from pomona.executive.cell.owner import Link, Owner
from pomona.executive.clock import Clock
from pomona.executive.values.arrays import Float64

M = TypeVar("M", PathMotion, StreamedMotion)
AT_REST = 5e-3  # no joint moves faster than this when the arm rests [rad/s]
RECONNECT = 0.5  # pause between attempts to open a lost session again [s]


class SetPointStream(Protocol):
    """The set-points of one motion, on their way to the controller."""

    @property
    def played(self) -> bool:
        """Whether the arm must have come to the last set-point that was sent."""

    @property
    def q_last(self) -> Float64:
        """The newest set-point, (dof,) [rad]."""

    @property
    def sent(self) -> int:
        """How many the controller has taken."""


class PathArm(Device, ABC):
    """An arm whose set-points are sent ahead. Joints in the order of the robot's description.

    A driver gives `step`, which serves the wire and ends with `_watch_motion`; `_failed` for its errors; and methods
    that stream, halt and restart a path.
    """

    interfaces: ClassVar[tuple[type, ...]] = (Arm,)
    outlives = True
    stops_when_told: ClassVar[bool] = False
    """Whether the controller has a command that stops the arm at its place. Such an arm is checked and stopped also
    while its joint feedback is implausible; any other brakes on its path then."""

    def __init__(
        self,
        name: str,
        clock: Clock,
        description: Path,
        limits: ArmLimits,
        supervision: Supervision,
        period: float,
    ) -> None:
        """`period`: at which paths are stepped [s]."""
        super().__init__(name)
        self.description = description
        self.limits = limits
        self._clock = clock
        self._period = period
        # guards latched, problem and motion; never held while waiting
        self._lock = threading.Lock()
        self._owner = Owner(name, self.step, self._failed, clock)
        self._supervisor = MotionSupervisor(name, limits, supervision)
        self._state: ArmState | None = None
        self._believed = False  # the newest feedback can be true
        self._doubted = False  # feedback was not, since the last acknowledgement
        self._motion: PathMotion | StreamedMotion | None = None
        self._speed = 1.0
        self._latched: str | None = None
        self._problem = DeviceLost(name, "was never connected")

    # -------------------------------------------------------------------------------- what a driver says of it

    @abstractmethod
    def step(self) -> None:
        """Serve the wire for a moment; the arm's own thread calls this without end."""

    @abstractmethod
    def _failed(self, error: BaseException) -> None:
        """Handle a defect of the driver itself: the arm shall brake, and the motion fails."""

    @property
    @abstractmethod
    def _stream(self) -> SetPointStream | None:
        """Of the present motion."""

    @abstractmethod
    def _begin_stream(self, motion: Any, q_arm: Float64) -> None:
        """Make the stream of a motion that starts where the arm stands, at `q_arm`, shape (dof,) [rad].

        It is a `PathMotion`; of a `StreamingArm` also a `StreamedMotion`, with the same methods.
        """

    @abstractmethod
    def _end_stream(self) -> None:
        """Send nothing more of the motion."""

    @abstractmethod
    def _halt(self, problem: str) -> None:
        """Fail the motion and stop the arm at once: it has left its path, or an encoder is wrong.

        The stop depends on no clock and on no reported joint.
        """

    @abstractmethod
    def _release(self) -> None:
        """Forget the problem as it was acknowledged, and begin anew; called with the lock taken."""

    @abstractmethod
    def _leave(self) -> None:
        """Close the wire."""

    def _not_ready(self) -> str | None:
        """Return why no motion can begin; called with the lock taken."""
        return None if self._problem is None else words(self._problem)

    # ------------------------------------------------------------------------------------- the owner's thread

    def start(self) -> None:
        """Serve the arm in a thread of its own from now on."""
        self._owner.start()

    def _believe(self, stamp: float, q: Float64, qd: Float64 | None) -> None:
        """Accept joint feedback, (dof,) [rad, rad/s]; without velocities those of the positions are taken.

        Raises DeviceLost: it is implausible.
        """
        before = self._state
        if qd is None:
            qd = np.zeros_like(q)
            # longest distance in time between positions for a velocity by difference [s]
            if before is not None and 0.0 < stamp - before.stamp < 0.2:
                qd = (q - before.q) / (stamp - before.stamp)
        self._believed = False
        self._supervisor.on_feedback(stamp, q, qd)
        self._believed = True
        self._state = ArmState(stamp, q, qd, self._motion is not None and not self._motion.at_rest)

    def _doubt(self, error: DeviceLost) -> None:
        """Brake on the path: that needs no feedback."""
        self._believed = False
        self._doubted = True
        self._blame(error)
        if self._motion is not None:
            self._motion.fail(error.message)

    def _blame(self, problem: DeviceError) -> None:
        """Latch a problem until an operator acknowledges it; the first is kept."""
        with self._lock:
            if self._problem is None:
                self._problem = problem

    def _watch_motion(self) -> None:
        """See whether the motion goes on as it must, and whether it has ended."""
        motion = self._motion
        stream = self._stream
        state = self._state
        if motion is None or motion.settled or state is None:
            self._end_stream()
            self._supervisor.end()
            if state is not None and self._believed:
                self._judge(lambda: self._supervisor.look_at_rest(state.q))
            return
        resting = self._rests(state, stream)
        if stream is None:
            # else it has not begun yet
            motion.settled = resting and motion.state in (MotionState.FAILED, MotionState.STOPPED)
            return
        now = self._clock.now()
        if motion.set_point_rests and stream.played:
            motion.look(resting, float(np.abs(state.q - stream.q_last).max()), now)
        judged = self.stops_when_told or not self._doubted
        if judged and not motion.settled and self._supervisor.due(now):
            self._judge(lambda: self._supervisor.look(now, motion, stream.sent))

    def _judge(self, look: Callable[[], None]) -> None:
        """Let the supervisor look; a fault stops the arm at once, and so does missing feedback where a command can."""
        try:
            look()
        except DeviceLost as error:
            self._doubt(error)
            if self.stops_when_told:
                self._halt(error.message)
        except DeviceFault as error:
            self._condemn(error)

    def _condemn(self, fault: DeviceFault) -> None:
        """Latch a fault of the arm, and stop it at once."""
        self._blame(fault)
        self._halt(fault.message)

    def _rests(self, state: ArmState, stream: SetPointStream | None) -> bool:
        """Return True if the arm was measured at rest.

        Implausible feedback is no evidence of rest either: rest is assumed after the last point sent.
        """
        if self._doubted:
            return stream is None or stream.played
        return bool(np.abs(state.qd).max() < AT_REST)

    def _abandon(self, problem: str) -> None:
        """The arm stops by itself, or will not go on: nothing more is sent."""
        self._end_stream()
        self._supervisor.end()
        if self._motion is not None:
            self._motion.abandon(problem)

    # ------------------------------------------------------------------------------------------ the interface

    def follow(self, trajectory: Trajectory) -> Motion:
        def along(q: Float64) -> PathMotion:
            try:
                check_trajectory(trajectory, self.limits, q)
            except BadTrajectory as bad:
                raise MotionRefused(self.name, bad.problem) from bad
            return PathMotion(trajectory, self.limits, self._period, self._speed, q)

        return PostedMotion(self._start_motion(along), self._owner)

    def _start_motion(self, make: Callable[[Float64], M]) -> M:
        """Start the motion that `make` returns for the arm's joints. Raises MotionRefused."""
        with self._lock:
            if self._latched is not None:
                raise MotionRefused(self.name, f"latched in the safe state ({self._latched})")
            problem = self._not_ready()
            if problem is not None or self._state is None:
                raise MotionRefused(self.name, f"not ready: {problem or 'no joints have come'}")
            if self._motion is not None and not self._motion.settled:
                raise MotionRefused(
                    self.name, "still moves; stop the motion and wait until it has settled"
                )
            q = self._state.q
            motion = self._motion = make(q)
        self._owner.post(lambda: self._begin(motion, q))
        return motion

    def _begin(self, motion: PathMotion | StreamedMotion, q_arm: Float64) -> None:
        """Begin a motion, unless the arm was stopped or lost since it was asked for."""
        with self._lock:
            problem = self._latched or self._not_ready()
        if problem is not None:
            motion.abandon(problem)
            motion.settled = True
            return
        self._supervisor.end()
        self._begin_stream(motion, q_arm)

    # --------------------------------------------------------------------------------------------- the device

    def last_seen(self) -> float | None:
        return None if self._state is None else self._state.stamp

    def check(self) -> None:
        super().check()
        self._owner.check()

    def safe_stop(self, reason: str) -> None:
        with self._lock:
            if self._latched is None:
                self._latched = reason
            motion = self._motion
        if motion is not None:
            self._owner.post(motion.stop)

    def acknowledge(self) -> None:
        """Release the latch. Raises DeviceLost: the arm is still lost, or its feedback still implausible."""
        with self._lock:
            if not self._believed:
                raise DeviceLost(self.name, f"is still lost: {words(self._problem)}")
            self._latched = None
            self._release()

    def pause(self) -> None:
        motion = self._motion
        if motion is not None:
            self._owner.post(motion.pause)

    def resume(self) -> None:
        motion = self._motion
        if motion is not None:
            self._owner.post(motion.resume)

    def go_at(self, speed: float) -> None:
        with self._lock:  # or a motion that begins meanwhile would keep the speed that was
            self._speed, motion = speed, self._motion
        if motion is not None:
            self._owner.post(lambda: motion.set_speed(speed))

    def settled(self) -> bool:
        motion = self._motion
        stream = self._stream
        if motion is None or motion.settled:
            return True
        state = self._state
        if state is None or stream is None:
            return False
        return motion.at_rest and stream.played and self._rests(state, stream)

    def close(self) -> None:
        """Come to rest on the path, then leave."""
        self.safe_stop("closed")
        # an arm comes to rest on its path within this time when its driver is closed [s]
        end = self._clock.now() + 2.0
        while not self.settled() and self._clock.now() < end:
            self._clock.advance(0.02)
        self._owner.close()
        self._problem = DeviceLost(self.name, "is closed")
        self._leave()


class Session(Protocol):
    """A connection to a controller."""

    def close(self) -> None:
        """Disconnect. May raise OSError."""


class TimedStream(SetPointStream, Protocol):
    """Set-points with the times at which the arm shall pass them."""

    @property
    def due(self) -> float:
        """When the arm shall pass the newest set-point, on the cell's clock [s]."""


S = TypeVar("S", bound=Session)
P = TypeVar("P", bound=TimedStream)


class StreamingArm(PathArm, Generic[S, P]):
    """A `PathArm` that is served in sessions `S`, and also follows set-points which a skill streams to it, as `P`.

    Attributes:
        lead, lag: set-points are sent by `lead` before the arm shall pass them, and it passes them later by `lag` [s].
    """

    interfaces = (Arm, StreamedArm)
    stops_when_told = True
    lead = lag = 0.0
    _open_port: Callable[[str], Link]
    _session: S | None = None
    _points: P | None = None
    # made ready after an acknowledgement: takes a moment, in which motions are refused
    _starting = False
    _retry_at = 0.0

    @abstractmethod
    def _open(self, open_link: Callable[[str], Link]) -> S:
        """Open a session on the links that `open_link` opens, and take the first joints. Raises DeviceError, OSError.

        Links are closed by the base if it fails.
        """

    @abstractmethod
    def _make_ready(self, session: S) -> None:
        """Let the arm follow set-points from now on; nothing moves. Raises DeviceError: it may not; OSError."""

    @abstractmethod
    def _serve(self, session: S) -> None:
        """Serve the session for a moment. Raises DeviceError, OSError: it has failed."""

    def _unlock(self, session: S) -> None:
        """Release the controller's own stop after an acknowledgement. Raises as `_make_ready`."""

    def connect(self) -> None:
        """Open a session with the right arm, and make it ready; it stands still. Raises DeviceError: in words."""
        session = self._new_session()
        try:
            self._stand_ready(session)
        except (OSError, DeviceError) as error:
            session.close()
            raise _lost(self.name, error) from error
        self._session = session
        self._problem = None

    def _stand_ready(self, session: S) -> None:
        """Make it ready; from before that on it must stay where it is."""
        if self._state is not None:
            self._supervisor.look_at_rest(self._state.q)
        self._make_ready(session)

    def _new_session(self) -> S:
        links: list[Link] = []

        def open_link(name: str) -> Link:
            links.append(self._open_port(name))
            return links[-1]

        try:
            self._supervisor.forget()
            return self._open(open_link)
        except (OSError, DeviceError) as error:
            for link in links:
                link.close()
            raise _lost(self.name, error, "cannot be reached") from error

    def step(self) -> None:
        now = self._clock.now()
        try:
            if self._session is not None:
                self._serve(self._session)
            elif now < self._retry_at:
                self._clock.advance(min(self._retry_at - now, 0.05))
            else:
                self._session = self._new_session()
        except (OSError, DeviceError) as error:
            self._failed(error)

    def _failed(self, error: BaseException) -> None:
        """Fail the motion and open the session again: it is gone, or the peer is no controller."""
        self._believed = False
        if self._session is not None:
            self._blame(_lost(self.name, error))
            self._abandon(words(self._problem))
            if self._motion is not None:
                self._motion.settled = True  # its state is unknown
        self._leave()
        self._retry_at = self._clock.now() + RECONNECT
        self._starting = False

    def _start_again(self, session: S) -> None:
        """After an acknowledgement; called by `_serve` while `_starting`."""
        try:
            self._supervisor.forget()
            self._doubted = False
            self._unlock(session)
            self._stand_ready(session)
        except DeviceFault as error:
            self._blame(error)
        finally:
            self._starting = False

    def _leave(self) -> None:
        session = self._session
        self._session = None
        if session is not None:
            with contextlib.suppress(OSError):
                session.close()

    @property
    def _stream(self) -> P | None:
        return self._points

    def _end_stream(self) -> None:
        self._points = None

    def stream(self, watchdog: float) -> SetPoints:
        def due() -> float:
            return self.lag + (self._clock.now() if self._points is None else self._points.due)

        def towards(q: Float64) -> StreamedMotion:
            return StreamedMotion(q, self.limits, self._period, watchdog, self._speed, due)

        return PostedSetPoints(self._start_motion(towards), self._owner, self.lead + self.lag)

    def state(self) -> ArmState:
        """See the Protocol. Raises DeviceLost: there is no fresh state."""
        if self._session is None or self._state is None:
            raise DeviceLost(self.name, words(self._problem))
        return self._state

    def check(self) -> None:
        if self._problem is not None or not self._starting:
            super().check()

    def _not_ready(self) -> str | None:
        if self._session is None or self._problem is not None:
            return words(self._problem)
        return "it is being made ready" if self._starting else None

    def _release(self) -> None:
        if self._problem is not None:
            self._starting = True
            self._problem = None


def _lost(device: str, error: BaseException, what: str = "the connection failed") -> DeviceError:
    """Return an error of a wire or of a driver as one of the device."""
    if isinstance(error, DeviceError):
        return error
    is_wire = isinstance(error, OSError)
    return DeviceLost(device, f"{what}: {error}" if is_wire else f"the driver failed: {error!r}")


def words(problem: DeviceError | None) -> str:
    """Return the problem as part of a sentence."""
    return "no problem is known" if problem is None else problem.message


class PostedMotion:
    """A `Motion` whose stop is posted to the device's owner thread; every attribute read is a single value."""

    def __init__(self, motion: Motion, owner: Owner) -> None:
        self._motion = motion
        self._owner = owner

    @property
    def state(self) -> MotionState:
        return self._motion.state

    @property
    def progress(self) -> float:
        return self._motion.progress

    @property
    def settled(self) -> bool:
        return self._motion.settled

    @property
    def problem(self) -> str:
        return self._motion.problem

    def stop(self) -> None:
        self._owner.post(self._motion.stop)


class PostedSetPoints(PostedMotion):
    """A `SetPoints` whose calls are posted to the device's owner thread, and whose delay is the whole arm's."""

    def __init__(self, motion: StreamedMotion, owner: Owner, ahead: float) -> None:
        super().__init__(motion, owner)
        self._set_points = motion
        self.delay = motion.delay + ahead

    @property
    def speed(self) -> float:
        return self._set_points.speed

    def aim(self, q: Float64, qd: Float64 | None = None, at: float = 0.0) -> None:
        target = self._set_points.checked(q, qd, at)
        self._owner.post(lambda: self._set_points.take(target))
