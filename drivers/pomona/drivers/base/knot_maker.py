"""Set-points of a motion in larger steps, with velocities, for controllers that join them by cubics."""

from __future__ import annotations

import numpy as np

from pomona.drivers.path_motion import PathMotion
from pomona.drivers.streamed_motion import StreamedMotion
from pomona.executive.clock import Clock
from pomona.executive.values.arrays import Float64


class KnotMaker:
    """Steps one motion from knot to knot.

    Attributes:
        q_last: of the newest knot, shape (dof,) [rad].
        due: when the arm shall pass the newest set-point, on the cell's clock [s].
    """

    def __init__(
        self,
        motion: PathMotion | StreamedMotion,
        q_arm: Float64,
        clock: Clock,
        period: float,
        spacing: float,
        lead: float,
    ) -> None:
        """
        Args:
            q_arm: where the motion starts, shape (dof,) [rad].
            period: of the motion's steps [s]; spacing: time between knots [s].
            lead: time by which knots precede the arm [s]. A streamed motion that begins to move waits so long, since
                the set-points that fill this time are not known yet.
        """
        self.motion, self.q_last, self.due = motion, q_arm, clock.now()
        self._clock = clock
        self._period = period
        self._steps = max(round(spacing / period), 1)
        self._wait = lead if isinstance(motion, StreamedMotion) else 0.0
        self._looked_at = -np.inf
        self._next: tuple[float, Float64, Float64] | None = None

    def next(self, due: float) -> tuple[float, Float64, Float64] | None:
        """Return the time after the knot before [s], positions [rad] and velocities [rad/s], shape (dof,) each.

        None while the set-point rests; such steps are as far apart in time as those of a motion.

        Args:
            due: when the arm shall pass the knot before [s].
        """
        knot = self._next
        self._next = None
        if knot is not None:
            return self._made(*knot)
        now = self._clock.now()
        rested = self.motion.set_point_rests
        if rested and 0.0 <= now - self._looked_at < self._period - 1e-9:
            return None
        wait = max(now + self._wait - due, 0.0) if rested else 0.0
        self._looked_at = now
        self.due = due + wait
        q, qd = self.motion.step()
        if rested and self.motion.set_point_rests:
            return None
        steps = 1
        while steps < self._steps and not self.motion.set_point_rests:
            self.due += self._period
            q, qd = self.motion.step()
            steps += 1
        self.due = due + wait + steps * self._period
        knot = steps * self._period, q, np.zeros_like(qd) if self.motion.set_point_rests else qd
        if wait > 0.0:
            self._next = knot
            return wait, self.q_last, np.zeros_like(qd)
        return self._made(*knot)

    def _made(self, elapsed: float, q: Float64, qd: Float64) -> tuple[float, Float64, Float64]:
        self.q_last = q
        return elapsed, q, qd
