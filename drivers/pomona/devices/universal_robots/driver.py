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
from pomona.devices.universal_robots.options import SERVO_LAG, UrFile
from pomona.devices.universal_robots.rtde import RtdeSession
from pomona.devices.universal_robots.stream import PERIOD, KnotStream
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
    DeviceFault,
    DeviceLost,
    Link,
    PathMotion,
    StreamedMotion,
    StreamingArm,
)
from pomona.executive import Clock, Float64

TAKEN, ENDED, ECHO = (f"output_int_register_{i}" for i in (24, 25, 26))
"""Of the script: its newest knot; why it has ended (1: commanded, 2: no knot in time); the newest beat."""
PLAYED = "output_double_register_24"  # time of the motion at which the script is [s]
OUTPUTS = (
    "actual_q",
    "actual_qd",
    "robot_mode",
    "safety_mode",
    "runtime_state",
    "robot_status_bits",
    "target_speed_fraction",
    "speed_scaling",
    TAKEN,
    ENDED,
    ECHO,
    PLAYED,
)
INPUTS = (
    *(f"input_int_register_{i}" for i in (24, 25, 26)),
    *(f"input_double_register_{i}" for i in range(24, 38)),
)
"""For the script: command, number of a knot, beat; its time, six joints, six speeds, the time of the knot before it.
RTDE clients own 24 to 47."""
# commands to the script
FOLLOW = 1
STOP = 2
BEAT = 0.02  # period of the heart beat [s]; without it for 100 ms the controller ends the script
UNHEARD = 4  # beats by which a script that runs may be behind: 80 ms
LATE = "got a knot too late: the computer or the connection was delayed, and the arm has stopped"
REPLACED = (
    "another program has replaced this one on the controller; one of them only can move the arm"
)
SLOW = "answers more than 80 ms late: the connection is too slow, and no motion can begin"
NO_KNOT = [0.0] * 15
STARTS = 2.0  # the script must run within this time after it was sent [s]
POWERED = 30.0  # deadline of powering the arm and releasing its brakes, which is audible [s]
UNLOCKED = 2.0  # deadline of the release of a protective stop [s]


def resident_script() -> str:
    """Return the script, with its lists of zeros written out."""
    text = (Path(__file__).parent / "resident.script").read_text("utf-8")
    return re.sub(r"= @(\d+)", lambda found: f"= [{','.join(['0.0'] * int(found[1]))}]", text)


class UrArm(StreamingArm[RtdeSession, KnotStream]):
    """The arm. Joints from the base to the wrist, as in its description."""

    lag = SERVO_LAG

    def __init__(
        self,
        open_port: Callable[[str], Link],
        clock: Clock,
        limits: ArmLimits,
        options: UrFile,
        name: str = "arm",
    ) -> None:
        """`open_port` connects to "rtde", "script" or "dashboard"."""
        self.options = options
        super().__init__(name, clock, options.robot, limits, options.supervision, PERIOD)
        self._open_port = open_port
        self.lead = options.lead
        self._dashboard = UrDashboard(name, lambda: open_port("dashboard"), clock)
        self._command = STOP
        self._beat = 0
        self._beat_at = -np.inf
        self._echoed = (0, 0)  # the newest beat that came back, and the one that was sent then
        self._knot = NO_KNOT

    # ---------------------------------------------------------------------------------------- connection

    def _open(self, open_link: Callable[[str], Link]) -> RtdeSession:
        session = RtdeSession(
            self.name, open_link("rtde"), self._clock, OUTPUTS, INPUTS, self.options.rate
        )
        self._take(session)
        return session

    def _make_ready(self, session: RtdeSession) -> None:
        """Power the arm where the options allow it, and let the script run; nothing moves.

        Raises DeviceError: it is another arm, may not move, or another program runs; OSError.
        """
        self._dashboard.require_arm(self.options.model, session.version)
        self._end_own_script(session)
        mode = session.whole("robot_mode")
        if (
            self.options.power_on
            and mode in (POWER_OFF, IDLE)
            and session.whole("safety_mode") in (1, 2)
        ):
            self._dashboard.require_remote_control(session.version)
            self._dashboard.demand("power on", "Powering on")
            self._await(
                session, lambda: session.whole("robot_mode") >= IDLE, POWERED, "was not powered on"
            )
            self._dashboard.demand("brake release", "Brake releasing")
            self._await(
                session,
                lambda: session.whole("robot_mode") == RUNNING,
                POWERED,
                "kept its brakes on",
            )
        trouble = self._trouble(session)
        if trouble:
            raise DeviceFault(self.name, trouble)
        self._dashboard.require_remote_control(session.version)
        self._run_script(session)

    def _end_own_script(self, session: RtdeSession) -> None:
        """End a script of ours, here or of a process that has ended. Raises DeviceFault: another program runs."""
        self._command = STOP
        self._knot = [0, *([0.0] * 14)]
        other = "another program runs on it, or is paused there; stop that one at the pendant first"
        self._await(session, lambda: session.whole("runtime_state") == STOPPED, UNLOCKED, other)

    def _run_script(self, session: RtdeSession) -> None:
        """Send the script and wait until it runs."""
        self._command = FOLLOW
        self._give_beat(session, at_once=True)  # and no knot, before the script reads the registers
        first = self._beat
        link = self._open_port("script")
        try:
            link.send(resident_script().encode())
            missing = "the script does not run; see the pendant's log"
            self._await(session, lambda: self._runs(session, first), STARTS, missing)
        except DeviceFault:
            self._command = STOP
            raise
        finally:
            link.close()

    def _runs(self, session: RtdeSession, first: int) -> bool:
        """Return True once the script repeats beats from `first` on."""
        repeats = 0 <= self._behind(session) <= self._beat - first
        fresh = session.whole(ENDED) == session.whole(TAKEN) == 0
        return repeats and fresh and session.whole("runtime_state") == PLAYING

    def _behind(self, session: RtdeSession) -> int:
        """Return by how many beats the script is behind."""
        return self._beat - session.whole(ECHO)

    def _await(
        self, session: RtdeSession, until: Callable[[], bool], seconds: float, problem: str
    ) -> None:
        end = self._clock.now() + seconds
        while not until():
            session.receive(0.01)
            self._give_beat(session)
            if self._clock.now() > end:
                raise DeviceFault(self.name, problem)

    @staticmethod
    def _trouble(session: RtdeSession) -> str:
        safety = session.whole("safety_mode")
        slider = session.number("target_speed_fraction")
        status = session.whole("robot_status_bits")
        return stopped(safety, session.whole("robot_mode")) or unfit(safety, status, slider)

    # ----------------------------------------------------------------------------------------- the wire

    def _abandon(self, problem: str) -> None:
        """As the base; a script that still runs, or is resumed at the pendant, ends."""
        super()._abandon(problem)
        self._command = STOP
        self._beat_at = -np.inf

    def _serve(self, session: RtdeSession) -> None:
        fresh = session.receive(0.002)
        silent = self._clock.now() - session.heard_at
        if silent > self.options.silence and not session.receive(
            0.0
        ):  # unless this thread itself was held up
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
        if self._points is not None:
            self._pump(session, self._points)
        self._watch_motion()

    def _unlock(self, session: RtdeSession) -> None:
        if session.whole("safety_mode") == PROTECTIVE_STOP:
            self._dashboard.demand("unlock protective stop", "Protective stop releasing")
            locked = "stays in its protective stop"
            self._await(
                session, lambda: session.whole("safety_mode") != PROTECTIVE_STOP, UNLOCKED, locked
            )
        if session.whole("runtime_state") == PAUSED:
            self._dashboard.demand("stop", "Stopped")

    def _take(self, session: RtdeSession) -> None:
        """Take the newest joints. Raises DeviceLost: they cannot be true."""
        self._believe(session.heard_at, session.vector("actual_q"), session.vector("actual_qd"))

    def _watch_controller(self, session: RtdeSession) -> None:
        if self._problem is not None:
            return
        echo = session.whole(ECHO)
        if echo != self._echoed[0]:
            self._echoed = echo, self._beat
        problem = (
            stopped(session.whole("safety_mode"), session.whole("robot_mode"))
            or LATE * (session.whole(ENDED) == 2)
            or interrupted(session.whole("runtime_state"))
            or REPLACED * (self._beat - self._echoed[1] > UNHEARD)
            or SLOW * (self._behind(session) > UNHEARD)
        )
        if problem:
            self._blame(DeviceFault(self.name, problem))
            self._abandon(problem)
        elif problem := self._trouble(session):  # it can move still: it brakes on its path
            self._blame(DeviceFault(self.name, problem))
            if self._motion is not None:
                self._motion.fail(problem)

    def _give_beat(self, session: RtdeSession, at_once: bool = False) -> None:
        now = self._clock.now()
        if at_once or now - self._beat_at >= BEAT:
            self._beat_at = now
            self._beat += 1
            self._write(session)

    def _pump(self, session: RtdeSession, stream: KnotStream) -> None:
        playing = session.number(PLAYED) + self._clock.now() - session.heard_at
        knot = stream.pump(session.whole(TAKEN), playing)
        if knot is not None and stream.number != self._knot[0]:
            self._knot = [stream.number, knot.time, *knot.q.tolist(), *knot.qd.tolist(), knot.after]
            self._write(session)

    def _write(self, session: RtdeSession) -> None:
        number, *point = self._knot
        session.write([self._command, int(number), self._beat, *point])

    def _begin_stream(self, motion: PathMotion | StreamedMotion, q_arm: Float64) -> None:
        taken = self._session.whole(TAKEN) if self._session is not None else 0
        command = self._supervisor.command
        self._points = KnotStream(motion, q_arm, self._clock, self.options, taken + 1, command)

    def _condemn(self, fault: DeviceFault) -> None:
        share = 1.0 if self._session is None else self._session.number("speed_scaling")
        why = (
            "" if share > 0.995 else f"; its controller goes at {100.0 * share:.0f} % of its speed"
        )
        super()._condemn(DeviceFault(self.name, fault.message + why))

    def _halt(self, problem: str) -> None:
        """Let the script brake at once; it ends then."""
        self._abandon(problem)
        if self._session is not None:
            self._give_beat(self._session, at_once=True)
