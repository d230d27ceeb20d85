"""A UFACTORY arm as an `Arm`: set-points in servo mode, joints read back, errors in words.

One thread owns the connections and the motion; requests are posted to it. A lost controller, an error, a stop, another
mode, implausible feedback or a stalled motion fails the motion and stays latched until an operator acknowledges it. The
arm is then made ready anew, and nothing resumes by itself.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable

import numpy as np

from pomona.devices.xarm.codec import ERROR, Register, identity, joints, servo_point
from pomona.devices.xarm.options import XArmFile
from pomona.devices.xarm.session import SLOW, XArmSession
from pomona.devices.xarm.stream import PERIOD, ServoStream
from pomona.devices.xarm.words import BY_HAND, READY, SERVO, STOP, error_words, interrupted
from pomona.drivers import (
    ArmLimits,
    DeviceFault,
    DeviceLost,
    Link,
    Malformed,
    Nonsense,
    PathMotion,
    StreamedMotion,
    StreamingArm,
)
from pomona.executive import Clock, Float64

OLDEST = (1, 9, 110)
"""Oldest firmware: the first that returns measured positions and velocities of joints (`xarm-python-sdk` 1.18.4)."""
READIES = 2.0  # the arm must be ready within this time after the command [s]
MOVES = 0.02  # faster joints are moving before this run has commanded anything [rad/s]
ALL = 8  # of MOTION_ENABLE: every joint


class WrongModelError(DeviceFault):
    """The robot at this address is another model than the cell file's."""


class XArm(StreamingArm[XArmSession, ServoStream]):
    """The arm. Joints from the base to the wrist, as in its description."""

    def __init__(
        self,
        open_port: Callable[[str], Link],
        clock: Clock,
        limits: ArmLimits,
        options: XArmFile,
        name: str = "arm",
    ) -> None:
        """`open_port` connects to "command" or "report"."""
        self.options = options
        super().__init__(name, clock, options.robot, limits, options.supervision, PERIOD)
        self._open_port = open_port
        self.lag = options.servo_lag
        self.takes_over = False
        self._next = -np.inf

    # ---------------------------------------------------------------------------------------- connection

    def _open(self, open_link: Callable[[str], Link]) -> XArmSession:
        command = open_link("command")
        report = open_link("report")
        session = XArmSession(self.name, command, report, self._clock, self.options.silence)
        self._require_arm(session)
        self._believe(*self._joints(session))
        return session

    def _require_arm(self, session: XArmSession) -> None:
        try:
            model, version = identity(session.version)
        except Malformed as error:
            raise Nonsense(self.name, error) from error
        if model != self.options.model:
            raise WrongModelError(
                self.name, f"is a {model}, not the {self.options.model} of the cell file"
            )
        if version < OLDEST:
            old, least = (".".join(map(str, each)) for each in (version, OLDEST))
            raise DeviceFault(
                self.name,
                f"has the firmware {old}, which is too old: update it to {least} at least",
            )

    def _make_ready(self, session: XArmSession) -> None:
        """Enable the motors where the options allow it, and switch to servo mode; nothing moves.

        Raises DeviceError: it has an error, or another program moves it, or holds it (not with `takes_over`: a run that
        was killed leaves it so); OSError.
        """
        error = session.error()
        if error:
            raise DeviceFault(self.name, error_words(error))
        if session.report.mode == BY_HAND:
            raise DeviceFault(
                self.name,
                "is in manual mode, in which it is guided by hand; end it in UFACTORY Studio",
            )
        mine = self._starting or self.takes_over
        held = not mine and session.report.mode == SERVO and session.report.state in READY
        moves = self._state is not None and float(np.abs(self._state.qd).max()) > MOVES
        if (
            held
            or moves
            or session.report.state == 1
            or int.from_bytes(session.ask(Register.QUEUED), "big")
        ):
            why = "another program moves it, holds it in servo mode, or has queued motions"
            raise DeviceFault(
                self.name, f"{why}; end that one, or stop the arm in UFACTORY Studio, first"
            )
        if self.options.enable:
            session.ask(Register.MOTION_ENABLE, bytes([ALL, 1]), SLOW)
        session.ask(Register.CLEAN_WARNING)
        session.ask(Register.SET_MODE, bytes([SERVO]), SLOW)
        session.ask(Register.SET_STATE, bytes([0]), SLOW)
        end = self._clock.now() + READIES
        while session.report.mode != SERVO or session.report.state not in READY:
            if self._clock.now() > end:
                idle = "does not become ready; enable it in UFACTORY Studio"
                raise DeviceFault(
                    self.name, error_words(session.error()) if session.flags & ERROR else idle
                )
            session.listen(0.01)

    # ----------------------------------------------------------------------------------------- the wire

    def _serve(self, session: XArmSession) -> None:
        now = self._clock.now()
        session.listen(min(max(self._next - now, 0.0), 0.002))
        silent = self._clock.now() - session.reported_at
        if silent > self.options.silence and not session.listen(
            0.0
        ):  # unless this thread itself was held up
            raise DeviceLost(self.name, f"no report for {1e3 * silent:.0f} ms")
        if self._starting:
            self._start_again(session)
        now = self._clock.now()
        if now >= self._next - 1e-9:
            self._next = max(self._next + PERIOD, now)
            self._exchange(session)
        self._watch_motion()

    def _exchange(self, session: XArmSession) -> None:
        """Send the set-point of now, read the joints, and look whether the controller goes along."""
        try:
            q = None if self._points is None else self._points.next()
        except DeviceFault as error:
            self._condemn(error)
            q = None
        if q is not None:
            session.ask(Register.SERVO_JOINTS, servo_point(q.tolist()))
        found = self._joints(session)
        try:
            self._believe(*found)
        except DeviceLost as error:
            self._doubt(error)
        self._watch_controller(session)

    def _joints(self, session: XArmSession) -> tuple[float, Float64, Float64]:
        """Read the joints: time [s], positions [rad], velocities [rad/s]. Raises as `XArmSession.ask`."""
        try:
            q, qd = joints(session.ask(Register.JOINTS, bytes([2])))
        except Malformed as error:
            raise Nonsense(self.name, error) from error
        dof = len(self.limits.lower)
        return self._clock.now(), q[:dof], qd[:dof]

    def _watch_controller(self, session: XArmSession) -> None:
        if self._problem is not None:
            return
        problem = error_words(session.error()) if session.flags & ERROR else ""
        problem = problem or interrupted(session.report.state, session.report.mode)
        if problem:
            self._condemn(DeviceFault(self.name, problem))

    def _unlock(self, session: XArmSession) -> None:
        session.ask(Register.CLEAN_ERROR, deadline=SLOW)

    # --------------------------------------------------------------------------------------- the motion

    def _begin_stream(self, motion: PathMotion | StreamedMotion, q_arm: Float64) -> None:
        longest = self.options.silence
        command = self._supervisor.command
        self._points = ServoStream(self.name, motion, q_arm, self._clock, longest, command)

    def _halt(self, problem: str) -> None:
        """Let the controller brake at once; it follows no set-point after this."""
        self._abandon(problem)
        if self._session is not None:
            self._session.ask(Register.SET_STATE, bytes([STOP]))

    def _leave(self) -> None:
        """Disconnect; the controller brakes before."""
        if self._session is not None:
            with contextlib.suppress(OSError):
                self._session.send(Register.SET_STATE, bytes([STOP]))
        super()._leave()
