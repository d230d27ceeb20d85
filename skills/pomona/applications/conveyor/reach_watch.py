"""Watch of the hand's way to a fruit on the belt: the camera's frames against the postures that are planned."""

from __future__ import annotations

import numpy as np

from pomona.applications.conveyor.conveyor import Conveyor
from pomona.applications.conveyor.intercepting import InterceptPlan
from pomona.drivers import Arm, Motion, MotionState, Trajectory
from pomona.executive import Clock, Skill
from pomona.skills import KnownAround, LiveWatch


class PlannedMotion:
    """A streamed motion whose progress is that of a plan; the belt stops with it."""

    def __init__(self, motion: Motion, clock: Clock, pick: InterceptPlan, conveyor: Conveyor) -> None:
        self._motion, self._clock, self._pick, self._conveyor = motion, clock, pick, conveyor

    @property
    def state(self) -> MotionState:
        """As of the streamed motion."""
        return self._motion.state

    @property
    def progress(self) -> float:
        """Share of the plan's time that has passed, 0 to 1."""
        times = self._pick.times
        return float(np.clip((self._clock.now() - times[0]) / (times[-1] - times[0]), 0.0, 1.0))

    @property
    def settled(self) -> bool:
        """As of the streamed motion."""
        return self._motion.settled

    @property
    def problem(self) -> str:
        """As of the streamed motion."""
        return self._motion.problem

    def stop(self) -> None:
        """Bring arm and belt to rest at once. A person who reaches in may be above the hand, so it does not rise.

        Raises StopFailed: the belt may run on.
        """
        self._motion.stop()
        self._conveyor.stop()


def watch_reach(skill: Skill, arm: Arm, motion: Motion, clock: Clock, pick: InterceptPlan) -> LiveWatch | None:
    """Return the watch of a pick that begins now; None in a cell whose file requests none.

    A camera on the hand sees nothing behind itself. Things in the `passing` volumes of the cell count as goods.
    """
    t, q = pick.times - pick.times[0], pick.postures
    qd = np.gradient(q, t, axis=0)
    eyes = LiveWatch.of(skill, arm, Trajectory(t, q, qd, np.gradient(qd, t, axis=0)), KnownAround())
    if eyes is not None:
        eyes.begin(PlannedMotion(motion, clock, pick, skill.device(Conveyor)))
    return eyes
