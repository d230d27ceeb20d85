"""An arm that follows trajectories exactly, with injected faults."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from pomona.drivers.errors import BadTrajectory, DeviceError, MotionRefused
from pomona.drivers.interfaces import (
    Arm,
    ArmLimits,
    ArmState,
    Motion,
    SetPoints,
    StreamedArm,
    Trajectory,
)
from pomona.drivers.motion_supervisor import MotionSupervisor, Supervision
from pomona.drivers.path_motion import PathMotion
from pomona.drivers.streamed_motion import StreamedMotion
from pomona.drivers.trajectory import check_trajectory
from pomona.executive.cell.device import Device
from pomona.executive.values.arrays import Float64
from pomona.executive.values.installation import installed_trees
from pomona.tools.mock.hand import PERIOD, MockClock

ROBOT = installed_trees() / "robots" / "sia5f_wsg32.xml"

SIA5F_LIMITS = ArmLimits(
    lower=np.radians([-180.0, -110.0, -170.0, -90.0, -180.0, -110.0, -180.0]),
    upper=np.radians([180.0, 110.0, 170.0, 115.0, 180.0, 110.0, 180.0]),
    velocity=np.radians([200.0, 200.0, 200.0, 200.0, 200.0, 230.0, 350.0]),
    acceleration=np.array([8.0, 8.0, 10.0, 10.0, 12.0, 14.0, 20.0]),
    jerk=np.array([80.0, 80.0, 100.0, 100.0, 150.0, 180.0, 250.0]),
)


class MockArm(Device):
    """A kinematic arm.

    Args:
        clock: that moves it.
        q: initial joints, shape (dof,) [rad]; zeros by default.
        limits, description: of the robot; the shipped one by default.
        supervision: how closely the arm must follow its commands.

    Attributes:
        followed: every trajectory that was started.
        q: present joints; write it to move the arm by hand.
        says: maps the true joint positions to the reported ones; replace it to inject false feedback.
    """

    interfaces = (Arm, StreamedArm)

    def __init__(
        self,
        clock: MockClock,
        q: Float64 | None = None,
        limits: ArmLimits = SIA5F_LIMITS,
        description: Path = ROBOT,
        supervision: Supervision | None = None,
    ) -> None:
        super().__init__("arm")
        self._clock = clock
        self.description, self.limits = description, limits
        self.q: Float64 = np.zeros(limits.lower.size) if q is None else np.array(q, np.float64)
        self._qd = np.zeros_like(self.q)
        self.followed: list[Trajectory] = []
        self._motion: PathMotion | StreamedMotion | None = None
        self._speed = 1.0
        self.says: Callable[[Float64], Float64] = lambda q: q
        self._supervisor = MotionSupervisor(self.name, limits, supervision or Supervision())
        self._steps = 0
        self._latched: str | None = None
        self._refusal: str | None = None
        self._failure: tuple[float, str] | None = None
        self._error: DeviceError | None = None
        clock.each_step.append(self._step)

    # ---------------------------------------------------------------------------------------------- script

    def refuse_next(self, why: str) -> None:
        """Refuse the next trajectory."""
        self._refusal = why

    def fail_at(self, progress: float, problem: str) -> None:
        """Let the running or next motion fail once it has come this far (0 to 1)."""
        self._failure = (progress, problem)

    def fail_check(self, error: DeviceError | None) -> None:
        """Raise this from every `check` from now on; None ends it."""
        self._error = error

    # ----------------------------------------------------------------------------------------------- device

    def state(self) -> ArmState:
        return ArmState(self._clock.now(), self.q.copy(), self._qd.copy(), not self.settled())

    def follow(self, trajectory: Trajectory) -> Motion:
        self._need_ready()
        try:
            check_trajectory(trajectory, self.limits, self.q)
        except BadTrajectory as bad:
            raise MotionRefused(self.name, bad.problem) from bad
        self.followed.append(trajectory)
        self._supervisor.end()
        self._motion = PathMotion(trajectory, self.limits, PERIOD, self._speed)
        return self._motion

    def stream(self, watchdog: float) -> SetPoints:
        self._need_ready()
        self._supervisor.end()
        motion = self._motion = StreamedMotion(
            self.q, self.limits, PERIOD, watchdog, self._speed, self._clock.now
        )
        return motion

    def _need_ready(self) -> None:
        refusal, self._refusal = self._refusal, None
        if self._latched is not None:
            refusal = f"latched in the safe state ({self._latched})"
        elif self._motion is not None and not self._motion.settled:
            refusal = "still moves; stop the motion and wait until it has settled"
        if refusal:
            raise MotionRefused(self.name, refusal)

    def check(self) -> None:
        if self._error is not None:
            raise self._error

    def link(self) -> str:
        return "ok" if self._error is None else self._error.message

    def safe_stop(self, reason: str) -> None:
        self._latched = reason
        if self._motion is not None:
            self._motion.stop()

    def acknowledge(self) -> None:
        self._supervisor.forget()
        self._latched = None

    def pause(self) -> None:
        if self._motion is not None:
            self._motion.pause()

    def resume(self) -> None:
        if self._motion is not None:
            self._motion.resume()

    def go_at(self, speed: float) -> None:
        self._speed = speed
        if self._motion is not None:
            self._motion.set_speed(speed)

    def settled(self) -> bool:
        return self._motion is None or self._motion.at_rest

    def _step(self) -> None:
        motion = self._motion
        self._supervise(motion)
        if motion is None or motion.settled:
            return
        if self._failure is not None and motion.progress >= self._failure[0]:
            motion.fail(self._failure[1])
            self._failure = None
        if not motion.at_rest:
            self.q, self._qd = motion.step()
            self._steps += 1
        motion.look(resting=True, beside=0.0, now=self._clock.now())

    def _supervise(self, motion: PathMotion | StreamedMotion | None) -> None:
        now = self._clock.now()
        if not self._supervisor.due(now):
            return
        try:
            if motion is not None and not motion.settled:
                self._supervisor.command(now, self.q)
            self._supervisor.on_feedback(now, np.array(self.says(self.q)), self._qd)
            if motion is not None and not motion.settled:
                self._supervisor.look(now, motion, self._steps)
            elif self._error is None:
                self._supervisor.look_at_rest(np.array(self.says(self.q)))
        except DeviceError as error:
            self._error = self._error or error
            if motion is not None:
                motion.fail(error.message)
