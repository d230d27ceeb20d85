"""Skills of the runs of `kill_points`: a moving arm, and work in another process."""

from __future__ import annotations

import time

import numpy as np

from pomona.drivers.interfaces import Arm, Trajectory
from pomona.executive.skill import Work
from pomona.skills.shared.following import MOTION_FAILURES, MovingSkill


class Sway(MovingSkill):
    """Turn the last joint to and fro."""

    devices = (Arm,)
    failures = MOTION_FAILURES

    def run(self) -> Work[None]:
        for sign in (1.0, -1.0):
            yield from self.travel(_quintic(self.device(Arm).state().q, 0.3 * sign, 0.7))


class Compute(MovingSkill):
    """Something that takes a while, in a worker."""

    failures = MOTION_FAILURES

    def run(self) -> Work[None]:
        yield from self.compute(time.sleep, 0.3, isolated=True)


def _quintic(q: np.ndarray, angle: float, duration: float) -> Trajectory:
    """A smooth turn of the last joint by an angle [rad]."""
    t = np.linspace(0.0, duration, 36)
    s = t / duration
    way = np.zeros((t.size, q.size))
    way[:, -1] = angle
    return Trajectory(
        t,
        q + way * (10 * s**3 - 15 * s**4 + 6 * s**5)[:, None],
        way * ((30 * s**2 - 60 * s**3 + 30 * s**4) / duration)[:, None],
        way * ((60 * s - 180 * s**2 + 120 * s**3) / duration**2)[:, None],
    )
