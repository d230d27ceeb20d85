"""The driver `reacher` of a cell file: an arm that gets its path a moment ahead."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from pomona.drivers import (
    POINT_PERIOD,
    Address,
    ArmLimits,
    ArmState,
    ConnectContext,
    DeviceError,
    DeviceFault,
    DeviceLost,
    Link,
    Malformed,
    Nonsense,
    OutOfSetPointsError,
    PathArm,
    PathMotion,
    RollingPath,
    Settings,
    Supervision,
    UnusableRobotFile,
    driver,
    read_limits,
    tcp_opener,
    words,
)
from pomona.executive import TIME, Clock, Float64, Measure, PathTo, Problem, Whole, value

ASK = 0.01  # between questions for the joints [s]
TELL = 0.03  # between paths [s]
SILENCE = 0.1  # without an answer for this long it is lost [s]


@dataclass(frozen=True, slots=True, kw_only=True)
class ReacherOptions:
    """An arm on TCP; without an address an emulated one in this process."""

    tcp: tuple[str, int] | None = value(
        Address(4002), None, "HOST or HOST:PORT; default: an emulated arm"
    )
    robot: Path = value(
        PathTo("file"), help="the robot's description (MJCF or URDF), with its limits"
    )
    joints: int = value(Whole(1, 12), 7, "joints of the description")
    lead: float = value(
        Measure(TIME, "40 ms", "700 ms"),
        "150 ms",
        "how far ahead in time points are sent to the arm",
    )

    @property
    def wires(self) -> tuple[str, ...]:
        return () if self.tcp is None else (f"{self.tcp[0]}:{self.tcp[1]}",)

    def problems(self) -> Iterator[Problem]:
        try:
            read_limits(self.robot, self.joints)
        except UnusableRobotFile as error:
            yield Problem("robot", str(error))


class Reacher(PathArm):
    """The arm. Its lines: `joints?`, and `path SECONDS Q… SECONDS Q…`, which replaces the last and ends at rest."""

    declared: ClassVar[Mapping[str, str]] = {
        "a_gap_ends_without_a_jump": "page 12: it goes to where a new path is at its time"
    }

    def __init__(
        self,
        wire: Link,
        clock: Clock,
        robot: Path,
        limits: ArmLimits,
        lead: float,
        name: str = "arm",
    ) -> None:
        super().__init__(name, clock, robot, limits, Supervision(), POINT_PERIOD)
        self._wire = wire
        self._begun = b""
        self._lead = lead
        self._asked_at = self._heard_at = clock.now()
        self._told_at = -np.inf
        self._path: RollingPath | None = None

    def connect(self) -> None:
        """Wait for the first joints; nothing moves. Raises DeviceLost: none come, or they are implausible."""
        while self._state is None:
            self._read()
        self._problem = None

    def step(self) -> None:
        try:
            self._read()
        except DeviceLost as error:
            self._doubt(error)  # it brakes on its path
        if self._path is not None:
            self._tell(self._path)
        self._watch_motion()

    def _read(self) -> None:
        now = self._clock.now()
        if now - self._asked_at >= ASK:
            self._asked_at = now
            self._wire.send(b"joints?\n")
        *lines, self._begun = (self._begun + self._wire.receive(0.004)).split(b"\n")
        for line in lines:
            try:
                q = np.array([float(word) for word in line.split()]).reshape(len(self.limits.lower))
            except ValueError:
                raise Nonsense(self.name, Malformed(line, "no joints")) from None
            self._heard_at = self._clock.now()
            self._believe(self._heard_at, q, None)
        silent = self._clock.now() - self._heard_at
        if silent > SILENCE:
            raise DeviceLost(self.name, f"no answer for {1e3 * silent:.0f} ms")

    def _tell(self, path: RollingPath) -> None:
        try:
            path.go_on()
        except OutOfSetPointsError as error:  # the last path brings it to rest
            self._blame(error)
            self._abandon(error.message)
            return
        now = self._clock.now()
        if now - self._told_at < TELL:
            return
        self._told_at = now
        points = [(point.due - now, *point.q) for point in path.window() if point.due > now]
        if points:
            numbers = " ".join(f"{n:.6f}" for point in points for n in point)
            self._wire.send(f"path {numbers}\n".encode())

    @property
    def _stream(self) -> RollingPath | None:
        return self._path

    def _begin_stream(self, motion: PathMotion, q_arm: Float64) -> None:
        self._told_at = -np.inf
        commanded = self._supervisor.command
        self._path = RollingPath(self.name, motion, q_arm, self._clock, self._lead, commanded)

    def _end_stream(self) -> None:
        self._path = None

    def _halt(self, problem: str) -> None:
        self._doubted = True
        if self._motion is not None:
            self._motion.fail(problem)
        if self._path is not None and not self._path.braking_now:
            self._path.brake()
            self._told_at = -np.inf
        elif self._state is not None and self._supervisor.has_come_free:
            here = " ".join(f"{angle:.6f}" for angle in self._state.q)
            self._wire.send(f"path {ASK} {here}\n".encode())

    def _failed(self, error: BaseException) -> None:
        if not isinstance(error, DeviceError):
            error = DeviceFault(self.name, f"the driver failed: {error!r}")
        self._blame(error)
        self._abandon(error.message)

    def _release(self) -> None:
        self._problem = None
        self._owner.post(self._begin_anew)

    def _begin_anew(self) -> None:
        self._doubted = False
        if self._motion is None or self._motion.settled:
            self._supervisor.forget()

    def _leave(self) -> None:
        self._wire.close()

    def state(self) -> ArmState:
        if not self._believed or self._state is None:
            raise DeviceLost(self.name, words(self._problem))
        return self._state


class EmulatedReacher:
    """The other end of the wire: joints that follow the newest path exactly."""

    def __init__(self, clock: Clock, joints: int) -> None:
        self.says: Callable[[Float64], Float64] = lambda q: q
        self._clock = clock
        self._answers = b""
        self._times, self._path = np.zeros(1), np.zeros((1, joints))

    @property
    def q(self) -> Float64:
        """Joints now, (dof,) [rad]."""
        now = self._clock.now()
        return np.array([np.interp(now, self._times, column) for column in self._path.T])

    def send(self, chunk: bytes) -> None:
        for line in chunk.decode().splitlines():
            word, *numbers = line.split()
            if word == "path":
                rows = np.array(numbers, float).reshape(-1, 1 + self._path.shape[1])
                now = self._clock.now()
                self._path = np.vstack([self.q, rows[:, 1:]])
                self._times = np.concatenate([[now], now + rows[:, 0]])
            else:
                said = self.says(self.q)
                self._answers += " ".join(f"{angle:.6f}" for angle in said).encode() + b"\n"

    def receive(self, timeout: float) -> bytes:
        self._clock.advance(timeout)
        answers = self._answers
        self._answers = b""
        return answers

    def close(self) -> None:
        """Nothing: the newest path ends at rest."""


@driver(Reacher, ReacherOptions)
def connect(settings: Settings[ReacherOptions], context: ConnectContext) -> Reacher:
    """`driver: reacher`"""
    options = settings.values
    clock = context.clock
    limits = read_limits(options.robot, options.joints)
    try:
        emulated = EmulatedReacher(clock, options.joints)
        wire = emulated if options.tcp is None else tcp_opener(*options.tcp, context.wires)()
        arm = Reacher(wire, clock, options.robot, limits, options.lead)
        arm.connect()
    except (OSError, DeviceError) as error:
        raise settings.error(
            str(error), "tcp", "is the controller switched on, and on this network?"
        ) from error
    arm.start()
    return arm
