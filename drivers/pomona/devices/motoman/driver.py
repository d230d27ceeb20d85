"""A Yaskawa arm under MotoROS as an `Arm`: state watched, trajectories streamed, faults in words.

One thread owns both connections and the motion; requests are posted to it. A lost controller, an emergency stop, teach
mode, an alarm, implausible feedback or a stalled motion fails the motion and stays latched until an operator
acknowledges it. The handshake is then repeated, and nothing resumes by itself.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from pathlib import Path

import numpy as np

from pomona.devices.motoman.codec import Control, Result, Valid
from pomona.devices.motoman.session import ControllerSession
from pomona.devices.motoman.stream import INTERPOLATION, MotomanOptions, PointStream, RanDryError
from pomona.devices.motoman.words import fault, refusal
from pomona.drivers import (
    ArmLimits,
    ArmState,
    DeviceError,
    DeviceFault,
    DeviceLost,
    Link,
    Nonsense,
    PathMotion,
    StreamedMotion,
    StreamingArm,
    words,
)
from pomona.executive import Clock, Float64

RECONNECT = 0.5  # pause between attempts to open lost connections again [s]
SERVO_ON = 15.0  # deadline of switching the servos on: the controller waits up to 5 s in each of its stages [s]
FIRST_STATE = 1.0  # deadline of the first feedback and status [s]


class MotomanArm(StreamingArm):
    """The arm. Joints in the order of the robot's description; the wire's order stays in here."""

    stops_when_told = True

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
        self.options = options or MotomanOptions()
        super().__init__(name, clock, description, limits, self.options.supervision, INTERPOLATION)
        self._open_state, self._open_motion = open_state, open_motion
        self._wire = np.array(self.options.wire_joints)
        self._session: ControllerSession | None = None
        self._retry_at = 0.0
        self._taken_at = -np.inf
        self._points: PointStream | None = None
        self._enabling = False

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
            self._take(session)
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
        """Fail the motion and reopen the wire: it is gone, or the peer is no controller."""
        session, self._session = self._session, None
        self._believed = False
        if session is not None:
            told = f"the connection failed: {error}" if isinstance(error, OSError) else f"the driver failed: {error!r}"
            self._blame(error if isinstance(error, DeviceError) else DeviceLost(self.name, told))
            self._abandon(words(self._problem))
            if self._motion is not None:
                self._motion.settled = True  # its state is unknown
            session.close()
        self._retry_at = self._clock.now() + RECONNECT
        self._enabling = False

    _failed = _lose

    # ----------------------------------------------------------------------------------------- the wire

    def _serve(self, session: ControllerSession) -> None:
        try:
            session.listen(0.001 if self._points is not None else 0.004)
        except Nonsense as error:
            self._doubt(error)
        if not session.awaiting:
            session.reply()  # a motion connection that breaks while nothing moves is lost now, not with the next motion
        if self._points is None or not self._doubted:  # else the motion's connection still brakes the arm
            self._watch_silence(session)
        if self._enabling:
            self._enable_again(session)
        try:
            self._take(session)
            self._watch_status(session)
        except DeviceLost as error:
            self._doubt(error)
        if self._points is not None:
            self._pump(session, self._points)
        self._watch_motion()

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

    def _take(self, session: ControllerSession) -> None:
        """Take the newest feedback. Raises DeviceLost: it cannot be true."""
        feedback = session.feedback
        if feedback is None or session.feedback_at == self._taken_at:
            return
        self._taken_at = session.feedback_at
        told = feedback.valid & Valid.VELOCITY
        qd = np.array(feedback.velocity)[self._wire] if told else None
        self._believe(session.feedback_at, np.array(feedback.position)[self._wire], qd)

    def _watch_status(self, session: ControllerSession) -> None:
        if session.status is not None:
            self._supervisor.on_status(session.status_at)
            trouble = fault(session.status)
            if trouble and self._problem is None:
                self._blame(DeviceFault(self.name, trouble))
                self._abandon(trouble)
        self._supervisor.check_status(self._clock.now())

    def _pump(self, session: ControllerSession, stream: PointStream) -> None:
        try:
            stream.pump(session)
        except RanDryError as error:
            self._blame(error)
            self._abandon(error.message)
            session.ask(Control.STOP)
        except DeviceFault as error:
            self._abandon(error.message)
            session.ask(Control.STOP)
            ready = session.ask(Control.CHECK_READY)
            if ready.result == Result.NOT_READY:  # an operator holds it at the pendant: nothing may move after that
                self._blame(DeviceFault(self.name, refusal(ready)))

    @property
    def _stream(self) -> PointStream | None:
        return self._points

    @property
    def _ahead(self) -> float:
        return self.options.lead

    @property
    def _due(self) -> float:
        return self._clock.now() if self._points is None else self._points.due

    def _begin_stream(self, motion: PathMotion | StreamedMotion, q_arm: Float64) -> None:
        self._points = PointStream(motion, q_arm, self._clock, self.options, self._supervisor.command)

    def _end_stream(self) -> None:
        self._points = None

    def _halt(self, problem: str) -> None:
        """Send the controller's own stop command."""
        self._abandon(problem)
        if self._session is not None:
            self._session.ask(Control.STOP)

    # ---------------------------------------------------------------------------------------- the device

    def state(self) -> ArmState:
        """See the Protocol. Raises DeviceLost: there is no fresh state."""
        if self._session is None or self._state is None:
            raise DeviceLost(self.name, words(self._problem))
        return self._state

    def check(self) -> None:
        if self._problem is not None or not self._enabling:  # which takes seconds
            super().check()

    def _not_ready(self) -> str | None:
        if self._session is None or self._problem is not None:
            return words(self._problem)
        return "the servos are being switched on" if self._enabling else None

    def _release(self) -> None:
        """An alarm is reset and the servos are switched on again where the options allow it."""
        if self._problem is not None:
            self._enabling, self._problem = True, None

    def _leave(self) -> None:
        session, self._session = self._session, None
        if session is not None:
            with contextlib.suppress(OSError):
                session.close()
