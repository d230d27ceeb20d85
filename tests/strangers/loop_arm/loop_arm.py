"""The driver `loop-arm`: an arm on a controller that reports as joints the set-points that it was sent; and a skill."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pomona.drivers import (
    Arm,
    ArmState,
    ConnectContext,
    DeviceFault,
    DeviceLost,
    PathArm,
    PathMotion,
    Settings,
    StreamedMotion,
    Supervision,
    Trajectory,
    driver,
    read_limits,
)
from pomona.executive import ANGLE, TIME, Angle, Clock, Float64, Outputs, PathTo, Time, Work, value
from pomona.skills import MovingSkill

PERIOD = 0.01  # time between two set-points [s]
LEAD = 0.1  # time by which set-points precede the arm [s]


class LoopController:
    """A controller: it passes each set-point at its time, and stands at the last one."""

    def __init__(self, q: Float64) -> None:  # joints, shape (dof,) [rad]
        self.q_last, self.due, self.sent = q, 0.0, 0
        self._q, self._coming = q, deque[tuple[float, Float64]]()

    def send(self, due: float, q: Float64) -> None:
        self._coming.append((due, q))
        self.q_last, self.due, self.sent = q, due, self.sent + 1

    def joints(self, now: float) -> Float64:
        while self._coming and self._coming[0][0] <= now:
            _, self._q = self._coming.popleft()
        return self._q

    def stop(self) -> None:
        self._coming.clear()

    @property
    def played(self) -> bool:
        return not self._coming


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopArmOptions:
    """An arm that follows at once."""

    robot: Path = value(PathTo("file"), help="the robot's description, with its limits")


class LoopArm(PathArm):
    """The arm. Its controller stops it on a command."""

    stops_when_told = True

    def __init__(self, name: str, clock: Clock, robot: Path) -> None:
        limits = read_limits(robot)
        super().__init__(name, clock, robot, limits, Supervision(), PERIOD)
        self._controller, self._streaming = (
            LoopController(0.5 * (limits.lower + limits.upper)),
            False,
        )
        self._problem = None

    def step(self) -> None:
        now = self._clock.now()
        try:
            self._believe(now, self._controller.joints(now), None)
        except DeviceLost as error:
            self._doubt(error)
        if self._streaming and self._motion is not None:
            self._send(self._motion, now)
        self._watch_motion()
        self._clock.advance(0.002)

    def _send(self, motion: PathMotion | StreamedMotion, now: float) -> None:
        due = max(self._controller.due, now)
        while due < now + LEAD and not motion.set_point_rests:
            due += PERIOD
            q, _ = motion.step()
            self._controller.send(due, q)
            self._supervisor.command(due, q)

    @property
    def _stream(self) -> LoopController | None:
        return self._controller if self._streaming else None

    def _begin_stream(self, motion: PathMotion, q_arm: Float64) -> None:
        self._streaming = True

    def _end_stream(self) -> None:
        self._streaming = False

    def _halt(self, problem: str) -> None:
        self._controller.stop()
        self._abandon(problem)

    def _failed(self, error: BaseException) -> None:
        self._blame(DeviceFault(self.name, f"the driver failed: {error!r}"))
        self._halt(f"the driver failed: {error!r}")

    def _release(self) -> None:
        self._problem, self._doubted = None, False

    def _leave(self) -> None:
        self._controller.stop()

    def state(self) -> ArmState:
        if self._state is None:
            raise DeviceLost(self.name, "no joints have come")
        return self._state


@driver(LoopArm, LoopArmOptions)
def connect(settings: Settings[LoopArmOptions], context: ConnectContext) -> LoopArm:
    """`driver: loop-arm`"""
    arm = LoopArm(settings.name, context.clock, settings.values.robot)
    arm.step()
    arm.start()
    return arm


class Nod(MovingSkill):
    """Turn the last joint to and fro."""

    devices = (Arm,)

    def run(self, turn: Angle = ANGLE("10 deg"), duration: Time = TIME("2 s")) -> Work[Outputs]:
        t = np.linspace(0.0, duration, 101)
        phase, rate = (
            2.0 * np.pi * t / duration,
            2.0 * np.pi / duration,
        )  # (1 - cos)² begins and ends without a jerk
        one, sin, cos = 1.0 - np.cos(phase), np.sin(phase), np.cos(phase)
        q = self.device(Arm).state().q
        last = np.eye(len(q))[-1]
        way = (0.25 * turn * one**2)[:, None] * last
        qd = (0.5 * rate * turn * one * sin)[:, None] * last
        qdd = (0.5 * rate**2 * turn * (sin**2 + one * cos))[:, None] * last
        yield from self.travel(Trajectory(t, q + way, qd, qdd))
        return Outputs()
