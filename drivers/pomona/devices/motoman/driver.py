"""A Yaskawa arm under MotoROS as an `Arm`: state watched, trajectories streamed, faults in words.

One thread owns both connections and the motion; requests are posted to it. A lost controller, an emergency stop, teach
mode, an alarm, implausible feedback or a stalled motion fails the motion and stays latched until an operator
acknowledges it. The handshake is then repeated, and nothing resumes by itself.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pomona.devices.motoman.codec import Control, Result, Valid
from pomona.devices.motoman.options import MotomanFile
from pomona.devices.motoman.session import ControllerSession
from pomona.devices.motoman.stream import INTERPOLATION, PointStream, RanDryError
from pomona.devices.motoman.words import fault, refusal
from pomona.drivers import (
    ArmLimits,
    DeviceFault,
    DeviceLost,
    Link,
    Nonsense,
    PathMotion,
    StreamedMotion,
    StreamingArm,
)
from pomona.executive import Clock, Float64

SERVO_ON = 15.0  # deadline of switching the servos on: the controller waits up to 5 s in each of its stages [s]
FIRST_STATE = 1.0  # deadline of the first feedback and status [s]


class MotomanArm(StreamingArm[ControllerSession, PointStream]):
    """The arm. Joints in the order of the robot's description; the wire's order stays in here."""

    def __init__(
        self,
        open_port: Callable[[str], Link],
        clock: Clock,
        limits: ArmLimits,
        options: MotomanFile,
        name: str = "arm",
    ) -> None:
        """`open_port` connects to "state" or "motion"."""
        self.options = options
        super().__init__(name, clock, options.robot, limits, options.supervision, INTERPOLATION)
        self._open_port = open_port
        self.lead = options.lead
        self._wire = np.array(options.wire_joints)
        self._taken_at = -np.inf

    # ---------------------------------------------------------------------------------------- connection

    def _open(self, open_link: Callable[[str], Link]) -> ControllerSession:
        state = open_link("state")
        motion = open_link("motion")
        session = ControllerSession(
            self.name, state, motion, self._clock, self.options.order, self.options.group
        )
        end = self._clock.now() + FIRST_STATE
        while session.feedback is None or session.status is None:
            session.listen(0.02)
            if self._clock.now() > end:
                raise DeviceLost(
                    self.name, f"the controller pushed no state within {FIRST_STATE:g} s"
                )
        self._take(session)
        return session

    def _make_ready(self, session: ControllerSession) -> None:
        """Make the controller ready to move: reset an alarm, servos on, trajectory mode. The arm stands still."""
        status = session.status
        if status is not None and status.e_stopped == 1:
            raise DeviceFault(self.name, fault(status))
        if status is not None and status.in_error == 1:
            session.ask(Control.RESET_ALARM, SERVO_ON)
        ready = session.ask(Control.CHECK_READY)
        if ready.result != Result.SUCCESS:
            if not self.options.servo_on:
                raise DeviceFault(self.name, refusal(ready))
            session.demand(Control.START_TRAJECTORY_MODE, SERVO_ON)
            session.demand(Control.CHECK_READY)
        self._await_ready(session)

    def _await_ready(self, session: ControllerSession) -> None:
        """Wait for a status of servos that are on: those pushed before may still be on their way.

        Raises DeviceFault: none came, in the words of the newest one.
        """
        session.forget_status()
        end = self._clock.now() + FIRST_STATE
        trouble = "the controller pushed no status"
        while trouble:
            session.listen(0.005)
            if session.status is not None:
                trouble = fault(session.status)
            if trouble and self._clock.now() > end:
                raise DeviceFault(self.name, trouble)

    # ----------------------------------------------------------------------------------------- the wire

    def _serve(self, session: ControllerSession) -> None:
        try:
            session.listen(0.001 if self._points is not None else 0.004)
        except Nonsense as error:
            self._doubt(error)
        if not session.awaiting:
            session.reply()  # a motion connection that breaks while nothing moves is lost now, not with the next motion
        if (
            self._points is None or not self._doubted
        ):  # else the motion's connection still brakes the arm
            self._watch_silence(session)
        if self._starting:
            self._start_again(session)
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
        if silent > self.options.silence and not session.listen(
            0.0
        ):  # unless this thread itself was held up
            raise DeviceLost(self.name, f"no feedback for {1e3 * silent:.0f} ms")

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
                if self._points is not None:  # what the status says may be false: the arm may go on
                    self._halt(trouble)
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
            if (
                ready.result == Result.NOT_READY
            ):  # an operator holds it at the pendant: nothing may move after that
                self._blame(DeviceFault(self.name, refusal(ready)))

    def _begin_stream(self, motion: PathMotion | StreamedMotion, q_arm: Float64) -> None:
        self._points = PointStream(
            motion, q_arm, self._clock, self.options, self._supervisor.command
        )

    def _halt(self, problem: str) -> None:
        """Send the controller's own stop command."""
        self._abandon(problem)
        if self._session is not None:
            self._session.ask(Control.STOP)
