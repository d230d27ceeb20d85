"""An arm that follows trajectories exactly, with injected faults."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from pomona.drivers.errors import DeviceError, DeviceLost
from pomona.drivers.interfaces import (
    Arm,
    ArmLimits,
    ArmState,
    Motion,
    SetPoints,
    StreamedArm,
    Trajectory,
)
from pomona.drivers.motion_supervisor import Supervision
from pomona.drivers.path_arm import PathArm, PostedSetPoints, SetPointStream
from pomona.drivers.streamed_motion import StreamedMotion
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


class MockArm(PathArm):
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
    outlives = False
    played = True  # of a `SetPointStream`: it is where its set-point is

    def __init__(
        self,
        clock: MockClock,
        q: Float64 | None = None,
        limits: ArmLimits = SIA5F_LIMITS,
        description: Path = ROBOT,
        supervision: Supervision | None = None,
    ) -> None:
        super().__init__("arm", clock, description, limits, supervision or Supervision(), PERIOD)
        self.q: Float64 = np.zeros(limits.lower.size) if q is None else np.array(q, np.float64)
        self._qd = np.zeros_like(self.q)
        self.followed: list[Trajectory] = []
        self.says: Callable[[Float64], Float64] = lambda q: q
        self.sent = 0
        self._refusal: str | None = None
        self._failure: tuple[float, str] | None = None
        self._problem = None
        self._believe(clock.now(), self.q, self._qd)
        clock.each_step.append(self.step)

    # ---------------------------------------------------------------------------------------------- script

    def refuse_next(self, why: str) -> None:
        """Refuse the next trajectory."""
        self._refusal = why

    def fail_at(self, progress: float, problem: str) -> None:
        """Let the running or next motion fail once it has come this far (0 to 1)."""
        self._failure = (progress, problem)

    def fail_check(self, error: DeviceError | None) -> None:
        """Raise this from every `check` from now on; None ends it."""
        self._problem = error

    # ----------------------------------------------------------------------------------------------- device

    def state(self) -> ArmState:
        return ArmState(self._clock.now(), self.q.copy(), self._qd.copy(), not self.settled())

    def follow(self, trajectory: Trajectory) -> Motion:
        motion = super().follow(trajectory)
        self.followed.append(trajectory)
        return motion

    def stream(self, watchdog: float) -> SetPoints:
        def towards(q: Float64) -> StreamedMotion:
            now = self._clock.now
            return StreamedMotion(q, self.limits, PERIOD, watchdog, self._speed, now)

        return PostedSetPoints(self._start_motion(towards), self._owner, 0.0)

    def _not_ready(self) -> str | None:
        self._state = MockArm.state(self)  # it may have been moved by hand
        refusal, self._refusal = self._refusal, None
        return refusal or super()._not_ready()

    def step(self) -> None:
        """Move the arm for one period of the clock."""
        motion, now = self._motion, self._clock.now()
        if motion is not None and not motion.settled:
            if self._failure is not None and motion.progress >= self._failure[0]:
                motion.fail(self._failure[1])
                self._failure = None
            if not motion.at_rest:
                self.q, self._qd = motion.step()
                self.sent += 1
            self._supervisor.command(now, self.q)
        try:
            self._believe(now, np.array(self.says(self.q)), self._qd)
        except DeviceLost as error:
            self._doubt(error)
        self._watch_motion()

    @property
    def q_last(self) -> Float64:
        """The newest set-point, (dof,) [rad]."""
        return self.q

    @property
    def _stream(self) -> SetPointStream:
        return self

    def _begin_stream(self, motion: Any, q_arm: Float64) -> None: ...

    def _end_stream(self) -> None: ...

    def _failed(self, error: BaseException) -> None:
        raise error

    def _halt(self, problem: str) -> None:
        if self._motion is not None:
            self._motion.fail(problem)
        if self._supervisor.has_come_free and self._state is not None:
            self.q = self._state.q

    def _release(self) -> None:
        self._problem, self._doubted = None, False
        self._supervisor.forget()

    def _leave(self) -> None: ...

    def close(self) -> None: ...
