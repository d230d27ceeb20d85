"""Gives a motion to the resident script knot by knot, a moment ahead of the arm.

The script keeps a ring of knots and joins them by cubics. Knots in the ring cannot be changed, so it is kept short
(`lead`): a stop on the path takes effect behind them.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pomona.devices.universal_robots.options import UrFile
from pomona.drivers import KnotMaker, PathMotion, StreamedMotion
from pomona.executive import Clock, Float64

PERIOD = 0.004  # period of stepping the path here [s]
CUSHION = 0.1  # time from the first knot until the script plays it [s], in which the next ones come; also in the script


@dataclass(frozen=True, slots=True, eq=False)
class Knot:
    """Joints [rad] and their speeds [rad/s], shape (6,), at a time since the motion began or went on [s]."""

    time: float
    q: Float64
    qd: Float64


class KnotStream:
    """The knots of one motion.

    Attributes:
        number: of the knot that the script takes next.
        sent: knots that it has taken.
    """

    def __init__(
        self,
        motion: PathMotion | StreamedMotion,
        q_arm: Float64,
        clock: Clock,
        options: UrFile,
        number: int,
        commanded: Callable[[float, Float64], None],
    ) -> None:
        """Begin at the arm's own position `q_arm`, (6,) [rad].

        `commanded` is called with each knot that was taken and the time at which the arm shall pass it [s].
        """
        self.number, self.sent = number, 0
        self._clock, self._lead, self._commanded = clock, options.lead, commanded
        self._maker = KnotMaker(motion, q_arm, clock, PERIOD, options.point_period, options.lead)
        self._time = 0.0  # of the newest knot [s]
        self._began: float | None = None  # when the script plays the time 0; None until it has taken that knot
        self._waiting: deque[Knot] = deque()

    @property
    def q_last(self) -> Float64:
        """The newest knot, (6,) [rad]."""
        return self._maker.q_last

    @property
    def due(self) -> float:
        """When the arm shall pass the newest set-point, on the cell's clock [s]."""
        return self._maker.due

    @property
    def played(self) -> bool:
        """Whether the script must have played everything that was sent."""
        return not self._waiting and self._left(self._clock.now()) <= 0.0

    def pump(self, taken: int) -> Knot | None:
        """Take note that the script has taken the knot `taken`; return the one that it shall have now, if any."""
        now = self._clock.now()
        if self._waiting and taken == self.number:
            knot = self._waiting.popleft()
            self._began = now + CUSHION if self._began is None else self._began
            self.number, self.sent = self.number + 1, self.sent + 1
            self._commanded(self._began + knot.time, knot.q)
        if not self._waiting and self._left(now) < self._lead:
            self._extend(now)
        return self._waiting[0] if self._waiting else None

    def _left(self, now: float) -> float:
        """Return for how long the script plays what it has [s]; negative when it has played all."""
        return -1.0 if self._began is None else self._began + self._time - now

    def _extend(self, now: float) -> None:
        """Add the next knot, unless the set-point rests; an arm that has rested, as after a pause, begins anew.

        It begins with two knots, since the script counts no time with one alone.
        """
        left, before = self._left(now), self.q_last
        rested = left < 0.0
        knot = self._maker.next(now + (CUSHION if rested else left))
        if knot is None:
            return
        if rested:
            self._began, self._time = None, 0.0
            self._waiting.append(Knot(0.0, before, np.zeros_like(before)))
        elapsed, q, qd = knot
        self._time += elapsed
        self._waiting.append(Knot(self._time, q, qd))
