"""Set-points of a motion for a trajectory controller: a moment ahead of the arm, then a stopping path.

Each message is whole by itself and ends at rest, so an arm that receives no further message comes to rest on its path.
The next message replaces the previous one after `lead`. A motion that fails brakes from the present set-point instead.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pomona.drivers.errors import DeviceFault
from pomona.drivers.path_motion import PathFollower, PathMotion
from pomona.executive.clock import Clock
from pomona.executive.values.arrays import Float64

POINT_PERIOD = 0.01  # time between the points of a message, which a controller joins by cubics [s]


class OutOfSetPointsError(DeviceFault):
    """The set-points that were promised have run out, and the arm has begun to come to rest."""


@dataclass(frozen=True, slots=True, eq=False)
class SetPoint:
    """Positions [rad] and velocities [rad/s], shape (dof,), at the time `due` of the cell's clock."""

    due: float
    q: Float64
    qd: Float64


@dataclass(frozen=True, slots=True, eq=False)
class _Promised:
    """A fixed set-point, and how the motion would brake from there."""

    point: SetPoint
    stop: PathFollower


class RollingPath:
    """The set-points of one motion. All times are the cell's.

    Attributes:
        sent: number of fixed set-points.
        braking_now: the motion brakes from the present set-point, not after the lead.
    """

    def __init__(
        self,
        device: str,
        motion: PathMotion,
        q_arm: Float64,
        clock: Clock,
        lead: float,
        commanded: Callable[[float, Float64], None],
    ) -> None:
        """Begin at the arm's own position `q_arm`, shape (dof,) [rad].

        Args:
            lead: time by which set-points precede the arm [s]; a stop takes effect after it.
            commanded: called with every set-point, in the order of their times.
        """
        self.motion = motion
        self.sent = 0
        self.braking_now = False
        self._device = device
        self._clock = clock
        self._lead = lead
        self._commanded = commanded
        self._last = SetPoint(clock.now(), q_arm, np.zeros_like(q_arm))
        self._promised = deque([_Promised(self._last, motion.braking())])

    @property
    def played(self) -> bool:
        """Whether the set-point rests and the arm must have come to it."""
        return self.motion.set_point_rests and self._clock.now() >= self._last.due

    @property
    def q_last(self) -> Float64:
        """The newest set-point, (n,) [rad]."""
        return self._last.q

    def go_on(self) -> None:
        """Fix the arm's set-points until `lead` from now.

        Raises OutOfSetPointsError: the fixed set-points have ended, and the arm was moving.
        """
        now = self._clock.now()
        if now > self._last.due:
            if self._last.qd.any():
                late = f"for {1e3 * (now - self._last.due):.0f} ms"
                why = "the computer was delayed, and the arm comes to rest"
                raise OutOfSetPointsError(self._device, f"ran out of set-points {late}: {why}")
            self._promise(
                SetPoint(now, self._last.q, self._last.qd)
            )  # it rested: at the start, or after a pause
        while self._last.due < now + self._lead:
            rested = self.motion.set_point_rests
            q, qd = self.motion.step()
            if rested and self.motion.set_point_rests:
                break
            self._promise(SetPoint(self._last.due + POINT_PERIOD, q, qd))
        while len(self._promised) > 2 and self._promised[2].point.due <= now:
            self._promised.popleft()

    def brake(self) -> None:
        """Come to rest from the present set-point on: the fixed ones after it no longer hold. Once only."""
        self.braking_now = True
        now = self._clock.now()
        while len(self._promised) > 1 and self._promised[-2].point.due >= now:
            self._promised.pop()
        newest = self._promised[-1]
        self._last = newest.point
        self.motion.come_to_rest(newest.stop)
        if now <= self._last.due:
            self.go_on()

    def window(self) -> list[SetPoint]:
        """Return the set-points from now on; the last one is at rest."""
        points = [promised.point for promised in self._promised]
        follower = self.motion.braking()
        due = self._last.due
        # maximum number of points of a stopping path; five seconds, ten times the need of any arm
        while not follower.at_rest and len(points) < 500:
            q, qd = follower.step(goes_on=False)
            due += POINT_PERIOD
            points.append(SetPoint(due, q, qd))
        return [*points[1:-1], SetPoint(due, points[-1].q, np.zeros_like(points[-1].q))]

    def _promise(self, point: SetPoint) -> None:
        self._last = point
        self._promised.append(_Promised(point, self.motion.braking()))
        self.sent += 1
        self._commanded(point.due, point.q)
