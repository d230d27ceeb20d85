"""A Universal Robots arm as an `Arm`: registers over RTDE, and a resident script that follows knots.

One thread owns the connection and the motion; requests are posted to it. A lost controller, a protective stop, a
stopped or paused program, reduced mode, freedrive, implausible feedback or a stalled motion fails the motion and stays
latched until an operator acknowledges it. The script is then sent anew, and nothing resumes by itself.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np

from pomona.devices.universal_robots.dashboard import UrDashboard
from pomona.devices.universal_robots.rtde import RtdeSession
from pomona.devices.universal_robots.stream import PERIOD, KnotStream, UrOptions
from pomona.devices.universal_robots.words import (
    IDLE,
    PAUSED,
    PLAYING,
    POWER_OFF,
    PROTECTIVE_STOP,
    RUNNING,
    STOPPED,
    interrupted,
    stopped,
    unfit,
)
from pomona.drivers import (
    ArmLimits,
    ArmState,
    DeviceError,
    DeviceFault,
    DeviceLost,
    Link,
    PathMotion,
    StreamedMotion,
    StreamingArm,
    words,
)
from pomona.executive import Clock, Float64

TAKEN, ENDED, ECHO = (f"output_int_register_{i}" for i in (24, 25, 26))
"""Of the script: its newest knot; why it has ended (1: commanded, 2: out of knots); the newest beat."""
OUTPUTS = (
    *("actual_q", "actual_qd", "robot_mode", "safety_mode", "runtime_state", "robot_status_bits"),
    *("target_speed_fraction", TAKEN, ENDED, ECHO),
)
INPUTS = (*(f"input_int_register_{i}" for i in (24, 25, 26)), *(f"input_double_register_{i}" for i in range(24, 37)))
"""For the script: command, number of a knot, beat; its time, six joints, six speeds. RTDE clients own 24 to 47."""
FOLLOW, STOP = 1, 2  # commands to the script
RECONNECT = 0.5  # pause between attempts to open a lost connection again [s]
BEAT = 0.02  # period of the heart beat [s]; without it for 100 ms the controller ends the script
UNHEARD = 0.06  # a beat that the script has not repeated after this time shows that another program runs [s]
STARTS = 2.0  # the script must run within this time after it was sent [s]
SERVO_LAG = 0.03  # of servoj: its lookahead time in the script [s]
POWERED = 30.0  # deadline of powering the arm and releasing its brakes, which is audible [s]
UNLOCKED = 2.0  # deadline of the release of a protective stop [s]


def resident_script() -> str:
    """Return the script, with its lists of zeros written out."""
    text = (Path(__file__).parent / "resident.script").read_text("utf-8")
    return re.sub(r"= @(\d+)", lambda found: f"= [{','.join(['0.0'] * int(found[1]))}]", text)


class UrArm(StreamingArm):
    """The arm. Joints from the base to the wrist, as in its description."""

    stops_when_told = True

    def __init__(
        self,
        open_port: Callable[[str], Link],
        clock: Clock,
        description: Path,
        limits: ArmLimits,
        options: UrOptions | None = None,
        name: str = "arm",
    ) -> None:
        """`open_port` connects to "rtde", "script" or "dashboard"."""
        self.options = options or UrOptions()
        super().__init__(name, clock, description, limits, self.options.supervision, PERIOD)
        self._open_port = open_port
        self._dashboard = UrDashboard(name, lambda: open_port("dashboard"), clock)
        self._session: RtdeSession | None = None
        self._retry_at = 0.0
        self._knots: KnotStream | None = None
        self._command, self._beat, self._beat_at, self._heard_at = STOP, 0, -np.inf, 0.0
        self._knot: list[float] = [0, *([0.0] * 13)]
        self._starting = False

    # ---------------------------------------------------------------------------------------- connection

    def connect(self) -> None:
        """Open RTDE, see that it is the right arm, and let the script run; the arm stands still.

        Raises:
            DeviceError: no controller there, another arm, or it is not ready, in words.
        """
        session = self._open()
        try:
            self._dashboard.require_arm(self.options.model, session.version)
            self._make_ready(session)
        except OSError as error:
            session.close()
            raise DeviceLost(self.name, str(error)) from error
        except DeviceError:
            session.close()
            raise
        self._session, self._problem = session, None

    def _open(self) -> RtdeSession:
        try:
            link = self._open_port("rtde")
        except OSError as error:
            raise DeviceLost(self.name, f"cannot be reached: {error}") from error
        try:
            session = RtdeSession(self.name, link, self._clock, OUTPUTS, INPUTS, self.options.rate)
            self._supervisor.forget()
            self._take(session)
        except OSError as error:
            link.close()
            raise DeviceLost(self.name, f"cannot be reached: {error}") from error
        except DeviceError:
            link.close()
            raise
        return session

    def _make_ready(self, session: RtdeSession) -> None:
        """Power the arm where the options allow it, and let the script run; nothing moves.

        Raises DeviceError: it may not move, or another program runs; OSError.
        """
        self._end_own_script(session)
        mode = session.whole("robot_mode")
        if self.options.power_on and mode in (POWER_OFF, IDLE) and session.whole("safety_mode") in (1, 2):
            self._dashboard.require_remote_control(session.version)
            self._dashboard.demand("power on", "Powering on")
            self._await(session, lambda: session.whole("robot_mode") >= IDLE, POWERED, "was not powered on")
            self._dashboard.demand("brake release", "Brake releasing")
            self._await(session, lambda: session.whole("robot_mode") == RUNNING, POWERED, "kept its brakes on")
        trouble = self._trouble(session)
        if trouble:
            raise DeviceFault(self.name, trouble)
        self._dashboard.require_remote_control(session.version)
        self._run_script(session)

    def _end_own_script(self, session: RtdeSession) -> None:
        """End a script of ours, here or of a process that has ended. Raises DeviceFault: another program runs."""
        self._command, self._knot = STOP, [0, *([0.0] * 13)]
        other = "another program runs on it, or is paused there; stop that one at the pendant first"
        self._await(session, lambda: session.whole("runtime_state") == STOPPED, UNLOCKED, other)

    def _run_script(self, session: RtdeSession) -> None:
        """Send the script and wait until it runs."""
        self._command = FOLLOW
        self._give_beat(session, at_once=True)  # and no knot, before the script reads the registers
        link = self._open_port("script")
        try:
            link.send(resident_script().encode())
            self._await(session, lambda: self._runs(session), STARTS, "the script does not run; see the pendant's log")
        finally:
            link.close()
        self._heard_at = self._clock.now()

    def _runs(self, session: RtdeSession) -> bool:
        playing, echoed = session.whole("runtime_state") == PLAYING, session.whole(ECHO) == self._beat
        return playing and echoed and session.whole(ENDED) == session.whole(TAKEN) == 0

    def _await(self, session: RtdeSession, until: Callable[[], bool], seconds: float, problem: str) -> None:
        end = self._clock.now() + seconds
        while not until():
            session.receive(0.01)
            self._give_beat(session)
            if self._clock.now() > end:
                raise DeviceFault(self.name, problem)

    @staticmethod
    def _trouble(session: RtdeSession) -> str:
        safety = session.whole("safety_mode")
        slider, status = session.number("target_speed_fraction"), session.whole("robot_status_bits")
        return stopped(safety, session.whole("robot_mode")) or unfit(safety, status, slider)

    # ----------------------------------------------------------------------------------------- the wire

    def step(self) -> None:
        """Serve the connection for a moment; the arm's own thread calls this without end."""
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
        """Fail the motion and reopen the wire; the controller's watchdog ends the script."""
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
        self._starting = False

    _failed = _lose

    def _abandon(self, problem: str) -> None:
        """As the base; a script that still runs, or is resumed at the pendant, ends."""
        super()._abandon(problem)
        self._command, self._beat_at = STOP, -np.inf

    def _serve(self, session: RtdeSession) -> None:
        fresh = session.receive(0.002)
        silent = self._clock.now() - session.heard_at
        if silent > self.options.silence and not session.receive(0.0):  # unless this thread itself was held up
            raise DeviceLost(self.name, f"no package for {1e3 * silent:.0f} ms")
        if self._starting:
            self._start_again(session)
        try:
            if fresh:
                self._take(session)
        except DeviceLost as error:
            self._doubt(error)
        self._watch_controller(session)
        self._give_beat(session)
        if self._knots is not None:
            self._pump(session, self._knots)
        self._watch_motion()

    def _start_again(self, session: RtdeSession) -> None:
        """After an acknowledgement; takes a moment, in which motions are refused."""
        try:
            self._supervisor.forget()
            self._doubted = False
            if session.whole("safety_mode") == PROTECTIVE_STOP:
                self._dashboard.demand("unlock protective stop", "Protective stop releasing")
                locked = "stays in its protective stop"
                self._await(session, lambda: session.whole("safety_mode") != PROTECTIVE_STOP, UNLOCKED, locked)
            if session.whole("runtime_state") == PAUSED:
                self._dashboard.demand("stop", "Stopped")
            self._make_ready(session)
        except DeviceFault as error:
            self._command = STOP
            self._blame(error)
        finally:
            self._starting = False

    def _take(self, session: RtdeSession) -> None:
        """Take the newest joints. Raises DeviceLost: they cannot be true."""
        self._believe(session.heard_at, session.vector("actual_q"), session.vector("actual_qd"))

    def _watch_controller(self, session: RtdeSession) -> None:
        if self._problem is not None:
            return
        now = self._clock.now()
        if session.whole(ECHO) == self._beat:
            self._heard_at = now
        problem = stopped(session.whole("safety_mode"), session.whole("robot_mode"))
        if not problem and session.whole(ENDED) == 2:
            problem = "ran out of knots: the computer or the connection was delayed, and the arm has stopped"
        problem = problem or interrupted(session.whole("runtime_state"))
        if not problem and now - self._heard_at > UNHEARD + BEAT:
            problem = "another program has replaced this one on the controller; one of them only can move the arm"
        if problem:
            self._blame(DeviceFault(self.name, problem))
            self._abandon(problem)
            return
        problem = self._trouble(session)
        if problem:  # it can move still: it brakes on its path
            self._blame(DeviceFault(self.name, problem))
            if self._motion is not None:
                self._motion.fail(problem)

    def _give_beat(self, session: RtdeSession, at_once: bool = False) -> None:
        now = self._clock.now()
        if at_once or now - self._beat_at >= BEAT:
            self._beat_at, self._beat = now, self._beat % 1_000_000 + 1
            self._write(session)

    def _pump(self, session: RtdeSession, stream: KnotStream) -> None:
        knot = stream.pump(session.whole(TAKEN))
        if knot is not None and stream.number != self._knot[0]:
            self._knot = [stream.number, knot.time, *knot.q.tolist(), *knot.qd.tolist()]
            self._write(session)

    def _write(self, session: RtdeSession) -> None:
        number, *point = self._knot
        session.write([self._command, int(number), self._beat, *point])

    @property
    def _stream(self) -> KnotStream | None:
        return self._knots

    @property
    def _ahead(self) -> float:
        return self.options.lead + SERVO_LAG

    @property
    def _due(self) -> float:
        return SERVO_LAG + (self._clock.now() if self._knots is None else self._knots.due)

    def _begin_stream(self, motion: PathMotion | StreamedMotion, q_arm: Float64) -> None:
        taken = self._session.whole(TAKEN) if self._session is not None else 0
        command = self._supervisor.command
        self._knots = KnotStream(motion, q_arm, self._clock, self.options, taken + 1, command)

    def _end_stream(self) -> None:
        self._knots = None

    def _halt(self, problem: str) -> None:
        """Let the script brake at once; it ends then."""
        self._abandon(problem)
        if self._session is not None:
            self._give_beat(self._session, at_once=True)

    # ---------------------------------------------------------------------------------------- the device

    def state(self) -> ArmState:
        """See the Protocol. Raises DeviceLost: there is no fresh state."""
        if self._session is None or self._state is None:
            raise DeviceLost(self.name, words(self._problem))
        return self._state

    def check(self) -> None:
        if self._problem is not None or not self._starting:  # which takes seconds
            super().check()

    def _not_ready(self) -> str | None:
        if self._session is None or self._problem is not None:
            return words(self._problem)
        return "its script is being started" if self._starting else None

    def _release(self) -> None:
        """Unlock and power the arm where the options allow it, and begin the script anew."""
        if self._problem is not None:
            self._starting, self._problem = True, None

    def _leave(self) -> None:
        session, self._session = self._session, None
        if session is not None:
            session.close()
