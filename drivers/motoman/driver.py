"""A Yaskawa arm under MotoROS as an `Arm`: state watched, trajectories streamed, faults in words.

One thread owns both connections and the motion; what others ask is posted to it. A lost controller, an emergency stop,
teach mode, an alarm, feedback that cannot be true or a motion that does not go on fails the motion and stays latched
until somebody acknowledges it; the handshake is then repeated, and nothing goes on by itself.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from drivers.device import Device
from drivers.errors import BadTrajectory, DeviceError, DeviceFault, DeviceLost, MotionRefused
from drivers.interfaces import Arm, ArmLimits, ArmState, Motion, MotionState, Trajectory
from drivers.motion_supervisor import MotionSupervisor, Supervision
from drivers.motoman.codec import Control, Order, Result, Valid
from drivers.motoman.session import ControllerSession
from drivers.motoman.stream import INTERPOLATION, PointStream, RanDryError
from drivers.motoman.words import fault, refusal
from drivers.owner import Owner
from drivers.path_motion import PathMotion
from drivers.posted_motion import PostedMotion
from drivers.trajectory import check_trajectory
from drivers.wire import Link, Nonsense
from executive.clock import Clock
from executive.values.arrays import Float64

RECONNECT = 0.5
"""Pause between attempts to open lost connections again [s]."""
SERVO_ON = 15.0
"""Deadline of switching the servos on: the controller waits up to 5 s in each of its stages [s]."""
FIRST_STATE = 1.0
"""Deadline of the first feedback and status [s]."""
AT_REST = 5e-3
"""No joint moves faster than this when the arm rests [rad/s]."""


@dataclass(frozen=True, slots=True)
class MotomanOptions:
    """What the cell file says of the arm.

    Attributes:
        order: byte order of the controller, "<" or ">".
        group: control group of the arm.
        wire_joints: for every joint of the robot's description its place on the wire (S L E U R B T = 0 … 6).
        servo_on: whether the servos are switched on at the connection; else somebody does it at the pendant.
        point_period: time between points that are sent [s].
        lead: how far ahead of the arm points are sent [s]: a stop takes effect behind them.
        silence: without feedback for so long the arm is lost [s].
        supervision: how far the arm is believed.
    """

    order: Order = "<"
    group: int = 0
    wire_joints: tuple[int, ...] = (0, 1, 2, 3, 4, 5, 6)
    servo_on: bool = True
    point_period: float = 0.02
    lead: float = 0.15
    silence: float = 0.09
    supervision: Supervision = field(default_factory=Supervision)


class MotomanArm(Device):
    """The arm. Joints in the order of the robot's description; the wire's order stays in here."""

    interfaces = (Arm,)
    outlives = True

    def __init__(
        self,
        open_state: Callable[[], Link],
        open_motion: Callable[[], Link],
        clock: Clock,
        description: Path,
        limits: ArmLimits,
        options: MotomanOptions | None = None,
        name: str = "arm",
    ) -> None:
        super().__init__(name)
        self.description, self.limits = description, limits
        self.options = options or MotomanOptions()
        self._open_state, self._open_motion, self._clock = open_state, open_motion, clock
        self._wire = np.array(self.options.wire_joints)
        self._lock = threading.Lock()  # of the four flags latched, enabling, problem and motion; nobody waits with it
        self._owner = Owner(name, self.step, self._lose, clock)
        self._supervisor = MotionSupervisor(name, limits, self.options.supervision)
        self._session: ControllerSession | None = None
        self._retry_at = 0.0
        self._state = ArmState(0.0, np.zeros(len(self._wire)), np.zeros(len(self._wire)), False)
        self._taken_at = -np.inf
        self._believed = False  # the newest feedback can be true
        self._doubted = False  # feedback was not, since the last acknowledgement
        self._limits_on_wire = ArmLimits(*(self._to_wire(rate) for rate in _rates(limits)))
        self._motion: PathMotion | None = None
        self._stream: PointStream | None = None
        self._latched: str | None = None
        self._enabling = False
        self._problem: DeviceError | None = DeviceLost(name, "was never connected")

    # ---------------------------------------------------------------------------------------- connection

    def connect(self) -> None:
        """Open both connections, wait for the state, and make the controller ready (which may switch the servos on).

        Raises:
            DeviceError: no controller there, or it is not ready, in words.
        """
        session = self._open()
        try:
            self._enable(session, self.options.servo_on)
        except OSError as error:
            session.close()
            raise DeviceLost(self.name, str(error)) from error
        except DeviceError:
            session.close()
            raise
        self._session, self._problem = session, None

    def start(self) -> None:
        """Serve the connections in a thread of its own from now on."""
        self._owner.start()

    def _open(self) -> ControllerSession:
        links: list[Link] = []
        try:
            links.append(self._open_state())
            links.append(self._open_motion())
            session = ControllerSession(
                self.name, links[0], links[1], self._clock, self.options.order, self.options.group
            )
            end = self._clock.now() + FIRST_STATE
            while session.feedback is None or session.status is None:
                session.listen(0.02)
                if self._clock.now() > end:
                    raise DeviceLost(self.name, f"the controller pushed no state within {FIRST_STATE:g} s")
        except (OSError, DeviceError) as error:
            for link in links:
                link.close()
            lost = DeviceLost(self.name, f"cannot be reached: {error}")
            raise (error if isinstance(error, DeviceError) else lost) from error
        self._supervisor.forget()
        try:
            self._believe(session)
        except DeviceLost:
            session.close()
            raise
        return session

    def _enable(self, session: ControllerSession, servo_on: bool) -> None:
        """Make the controller ready to move: reset an alarm, servos on, trajectory mode. The arm stands still."""
        status = session.status
        if status is not None and status.e_stopped == 1:
            raise DeviceFault(self.name, fault(status))
        if status is not None and status.in_error == 1:
            session.ask(Control.RESET_ALARM, SERVO_ON)
        ready = session.ask(Control.CHECK_READY)
        if ready.result != Result.SUCCESS:
            if not servo_on:
                raise DeviceFault(self.name, refusal(ready))
            session.demand(Control.START_TRAJECTORY_MODE, SERVO_ON)
            session.demand(Control.CHECK_READY)
        session.forget_status()  # pushed while the servos were still off

    def step(self) -> None:
        """Serve both connections for a moment; the arm's own thread calls this without end."""
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

    def _lose(self, error: BaseException) -> None:
        """The wire is gone, or what answers there is no controller: the motion has failed, the wire is opened again."""
        session, self._session = self._session, None
        if session is not None:
            words = f"the connection failed: {error}" if isinstance(error, OSError) else f"the driver failed: {error!r}"
            self._blame(error if isinstance(error, DeviceError) else DeviceLost(self.name, words))
            self._abandon_motion(_words(self._problem))
            if self._motion is not None:
                self._motion.settled = True  # nobody knows better
            session.close()
        self._retry_at = self._clock.now() + RECONNECT
        self._enabling = False

    def _blame(self, problem: DeviceError) -> None:
        """Latch a problem until somebody acknowledges it; the first is kept."""
        with self._lock:
            if self._problem is None:
                self._problem = problem

    # ----------------------------------------------------------------------------------------- the wire

    def _serve(self, session: ControllerSession) -> None:
        try:
            session.listen(0.001 if self._stream is not None else 0.004)
        except Nonsense as error:
            self._doubt(error)
        if not session.awaiting:
            session.reply()  # a motion connection that breaks while nothing moves is lost now, not with the next motion
        if self._stream is None or not self._doubted:  # else the motion's connection still brakes the arm
            self._watch_silence(session)
        if self._enabling:
            self._enable_again(session)
        try:
            self._believe(session)
            self._watch_status(session)
        except DeviceLost as error:
            self._doubt(error)
        if self._stream is not None:
            self._pump(session, self._stream)
        self._watch_motion(session)

    def _watch_silence(self, session: ControllerSession) -> None:
        silent = self._clock.now() - session.feedback_at
        if silent > self.options.silence and not session.listen(0.0):  # unless this thread itself was held up
            raise DeviceLost(self.name, f"no feedback for {1e3 * silent:.0f} ms")

    def _enable_again(self, session: ControllerSession) -> None:
        """After an acknowledgement; takes seconds, in which motions are refused."""
        try:
            self._supervisor.forget()
            self._doubted = False
            self._enable(session, self.options.servo_on)
        except DeviceFault as error:
            self._blame(error)
        finally:
            self._enabling = False

    def _believe(self, session: ControllerSession) -> None:
        """Take the newest feedback.

        Raises:
            DeviceLost: it cannot be true.
        """
        feedback = session.feedback
        if feedback is None or session.feedback_at == self._taken_at:
            return
        elapsed, self._taken_at = session.feedback_at - self._state.stamp, session.feedback_at
        q = np.array(feedback.position)[self._wire]
        if feedback.valid & Valid.VELOCITY:
            qd = np.array(feedback.velocity)[self._wire]
        else:
            qd = (q - self._state.q) / elapsed if 0.0 < elapsed < 0.2 else np.zeros_like(q)
        self._believed = False
        self._supervisor.on_feedback(session.feedback_at, q, qd)
        self._believed = True
        self._state = ArmState(session.feedback_at, q, qd, self._motion is not None and not self._motion.at_rest)

    def _doubt(self, error: DeviceLost) -> None:
        """Brake on the path: that needs no feedback."""
        self._believed, self._doubted = False, True
        self._blame(error)
        if self._motion is not None:
            self._motion.fail(error.message)

    def _watch_status(self, session: ControllerSession) -> None:
        if session.status is not None:
            self._supervisor.on_status(session.status_at)
            words = fault(session.status)
            if words and self._problem is None:
                self._blame(DeviceFault(self.name, words))
                self._abandon_motion(words)
        self._supervisor.check_status(self._clock.now())

    def _pump(self, session: ControllerSession, stream: PointStream) -> None:
        try:
            stream.pump(session)
        except RanDryError as error:
            self._blame(error)
            self._abandon_motion(error.message)
            session.ask(Control.STOP)
        except DeviceFault as error:
            self._abandon_motion(error.message)
            session.ask(Control.STOP)
            ready = session.ask(Control.CHECK_READY)
            if ready.result == Result.NOT_READY:  # somebody holds it at the pendant: nothing may move when that is over
                self._blame(DeviceFault(self.name, refusal(ready)))

    def _watch_motion(self, session: ControllerSession) -> None:
        motion, stream, state = self._motion, self._stream, self._state
        if motion is None or motion.settled:
            self._stream = None
            self._supervisor.end()
            return
        # Feedback in doubt says nothing about rest either: what was sent is over, then.
        resting = bool(np.abs(state.qd).max() < AT_REST) if not self._doubted else stream is None or stream.played
        if stream is None:
            motion.settled = resting and motion.state is MotionState.FAILED  # else it has not begun yet
            return
        if motion.set_point_rests and stream.played:
            motion.look(resting, float(np.abs(state.q - self._from_wire(stream.q_last)).max()), state.stamp)
        now = self._clock.now()
        if not motion.settled and self._supervisor.due(now):
            try:
                self._supervisor.look(now, motion, stream.sent)
            except DeviceLost as error:
                self._doubt(error)
            except DeviceFault as error:
                self._blame(error)
                self._abandon_motion(error.message)
                session.ask(Control.STOP)

    def _abandon_motion(self, problem: str) -> None:
        """The controller has stopped, will not go on, or shall stop by itself: nothing more is sent."""
        self._stream = None
        self._supervisor.end()
        if self._motion is not None:
            self._motion.abandon(problem)

    def _from_wire(self, q_wire: Float64) -> Float64:
        q: Float64 = q_wire[self._wire]
        return q

    # -------------------------------------------------------------------------------------- the interface

    def state(self) -> ArmState:
        """As the Protocol says.

        Raises:
            DeviceLost: there is no fresh state.
        """
        if self._session is None:
            raise DeviceLost(self.name, _words(self._problem))
        return self._state

    def follow(self, trajectory: Trajectory) -> Motion:
        with self._lock:
            if self._latched is not None:
                raise MotionRefused(self.name, f"latched in the safe state ({self._latched})")
            if self._session is None or self._problem is not None:
                raise MotionRefused(self.name, f"not ready: {_words(self._problem)}")
            if self._enabling:
                raise MotionRefused(self.name, "not ready: the servos are being switched on")
            if self._motion is not None and not self._motion.settled:
                raise MotionRefused(self.name, "still moves; stop the motion and wait until it has settled")
            q = self._state.q
            try:
                check_trajectory(trajectory, self.limits, q)
            except BadTrajectory as bad:
                raise MotionRefused(self.name, bad.problem) from bad
            on_wire = Trajectory(trajectory.t, *map(self._to_wire, (trajectory.q, trajectory.qd, trajectory.qdd)))
            motion = PathMotion(on_wire, self._limits_on_wire, INTERPOLATION)
            self._motion = motion
        self._owner.post(lambda: self._begin(motion, on_wire.q[0], self._to_wire(q)))
        return PostedMotion(motion, self._owner)

    def _begin(self, motion: PathMotion, q_start: Float64, q_arm: Float64) -> None:
        """Stream a motion, unless the arm was stopped or lost since it was asked for."""
        problem = self._latched or (_words(self._problem) if self._problem is not None else None)
        if problem is not None or self._session is None:
            motion.abandon(problem or "lost")
            motion.settled = True
            return
        self._supervisor.end()
        options = self.options
        self._stream = PointStream(
            motion, q_start, q_arm, self._clock, options.group, options.point_period, options.lead, self._commanded
        )

    def _commanded(self, due: float, q_wire: Float64) -> None:
        self._supervisor.command(due, self._from_wire(q_wire))

    def _to_wire(self, values: Float64) -> Float64:
        """Joints of the description, shape (..., dof), on their places of the wire."""
        on_wire = np.empty_like(values)
        on_wire[..., self._wire] = values
        return on_wire

    # ---------------------------------------------------------------------------------------- the device

    def link(self) -> str:
        return "ok" if self._problem is None else self._problem.message

    def check(self) -> None:
        problem = self._problem
        if problem is not None:
            raise problem
        if not self._enabling:  # which takes seconds
            self._owner.check()

    def safe_stop(self, reason: str) -> None:
        with self._lock:
            if self._latched is None:
                self._latched = reason
            motion = self._motion
        if motion is not None:
            self._owner.post(motion.stop)

    def acknowledge(self) -> None:
        """Release the latch; reset an alarm and switch the servos on again where the options allow it.

        Raises:
            DeviceLost: the controller is still lost, or still says what cannot be true.
        """
        with self._lock:
            if self._session is None or not self._believed:
                raise DeviceLost(self.name, f"is still lost: {_words(self._problem)}")
            self._latched = None
            if self._problem is not None:
                self._enabling, self._problem = True, None

    def pause(self) -> None:
        motion = self._motion
        if motion is not None:
            self._owner.post(motion.pause)

    def resume(self) -> None:
        motion = self._motion
        if motion is not None:
            self._owner.post(motion.resume)

    def settled(self) -> bool:
        motion, stream = self._motion, self._stream
        if motion is None or motion.settled:
            return True
        return motion.at_rest and stream is not None and stream.played

    def close(self) -> None:
        """Come to rest on the path, then disconnect."""
        self.safe_stop("closed")
        end = self._clock.now() + 2.0
        while not self.settled() and self._session is not None and self._clock.now() < end:
            self._clock.advance(0.02)
        self._owner.close()
        session, self._session = self._session, None
        if session is not None:
            with contextlib.suppress(OSError):
                session.close()
        self._problem = DeviceLost(self.name, "is closed")


def _rates(limits: ArmLimits) -> Sequence[Float64]:
    return (limits.lower, limits.upper, limits.velocity, limits.acceleration, limits.jerk)


def _words(problem: DeviceError | None) -> str:
    return problem.message if problem is not None else "no problem is known"
