"""Gives a motion to the resident script knot by knot, a moment ahead of the arm.

The script keeps a ring of knots for `lead` and joins them by cubics. When a motion along a path is stopped, the knots
of its braking take the place of those that the arm does not need within `SURE`.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pomona.devices.universal_robots.options import POINT_PERIOD, SURE, UrFile
from pomona.drivers import KnotMaker, MotionState, PathFollower, PathMotion, StreamedMotion
from pomona.executive import Clock, Float64

PERIOD = 0.004  # period of stepping the path here [s]
CUSHION = 0.1  # time from the first knot until the script plays it [s], in which the next ones come; also in the script
ROUNDING = 1e-4  # of the times that the script reports [s]
JOINED = 3  # knots of which the last alone is sent when a motion brakes: the script needs the next one later


@dataclass(frozen=True, slots=True, eq=False)
class Knot:
    """Joints [rad] and their speeds [rad/s], shape (6,), at a time since the motion began or went on [s].

    Attributes:
        after: time of the knot that it follows [s]; the script drops those between them.
        braking: how a motion along a path comes to rest from here.
    """

    time: float
    after: float
    q: Float64
    qd: Float64
    braking: PathFollower | None


class KnotStream(KnotMaker):
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
        super().__init__(motion, q_arm, clock, PERIOD, POINT_PERIOD, options.lead)
        self.number = number
        self.sent = 0
        self._lead = options.lead
        self._commanded = commanded
        self._time = 0.0  # of the newest knot [s]
        self._braked = False
        self._begun = False  # the script has taken the knot at the time 0
        # when the script was at the time 0, by its newest report and at this computer's rate [s]
        self._zero_at = 0.0
        self._waiting: deque[Knot] = deque()
        self._taken: deque[Knot] = deque()  # by the script, which has not passed them all

    @property
    def played(self) -> bool:
        """Whether the script must have played everything that was sent."""
        return not self._waiting and self._left(self._clock.now()) < ROUNDING

    def pump(self, taken: int, playing: float) -> Knot | None:
        """Take note that the script has taken the knot `taken`; return the one that it shall have now, if any.

        `playing`: time of the motion at which the script is now [s].
        """
        now = self._clock.now()
        self._zero_at = now - playing
        if self._waiting and taken == self.number:
            knot = self._waiting.popleft()
            self._taken.append(knot)
            self._begun = True
            self.number = self.number + 1
            self.sent = self.sent + 1
            self._commanded(self._zero_at + knot.time, knot.q)
        while len(self._taken) > 1 and self._taken[0].time < playing:
            self._taken.popleft()
        if not self._waiting:
            if self._brake(playing):
                self._extend(now, JOINED)
                if not self._waiting:  # it rests there at once
                    self._append(JOINED * PERIOD, self.q_last, np.zeros_like(self.q_last))
            elif self._left(now) < self._lead:
                self._extend(now, 1)
        return self._waiting[0] if self._waiting else None

    def _left(self, now: float) -> float:
        """Return for how long the script plays what it has [s]; negative when it has played all.

        The script's own progress counts: a controller that slows its motions down needs longer than this computer.
        """
        return self._zero_at + self._time - now if self._begun else -1.0

    def _brake(self, playing: float) -> bool:
        """Let a motion that was stopped brake from the first knot that is not due within `SURE`; once."""
        motion = self.motion
        taken = self._taken
        stopped = motion.phase.name == "BRAKING" and motion.state is MotionState.RUNNING
        if self._braked or not stopped or not taken:
            return False
        self._braked = True
        while len(taken) > 1 and taken[-2].time > playing + SURE:
            taken.pop()
        if not isinstance(motion, PathMotion) or taken[-1].braking is None:
            return False
        self._time = taken[-1].time
        self.q_last = taken[-1].q
        motion.come_to_rest(taken[-1].braking)
        return True

    def _extend(self, now: float, joined: int) -> None:
        """Add the next knot, or the last of some, unless the set-point rests.

        An arm that has rested, as after a pause, begins anew: with two knots, since the script counts no time with one.
        """
        left = self._left(now)
        before = self.q_last
        braking = self._braking()
        rested = left < ROUNDING
        due = now + (CUSHION if rested else left)
        knots = [knot for _ in range(joined) if (knot := self.next(due)) is not None]
        if not knots:
            return
        if rested:
            self._begun = False
            self._time = 0.0
            self._taken.clear()
            self._append(0.0, before, np.zeros_like(before), braking)
        self._append(sum(elapsed for elapsed, _, _ in knots), *knots[-1][1:], self._braking())

    def _append(
        self, elapsed: float, q: Float64, qd: Float64, braking: PathFollower | None = None
    ) -> None:
        before = self._time
        self._time = self._time + elapsed
        self._waiting.append(Knot(self._time, before, q, qd, braking))

    def _braking(self) -> PathFollower | None:
        return self.motion.braking() if isinstance(self.motion, PathMotion) else None
