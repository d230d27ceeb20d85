"""Set-points of a motion for servo mode, which has no queue: each is sent when the arm shall pass it."""

from __future__ import annotations

from collections.abc import Callable

from pomona.drivers import DeviceFault, PathMotion, StreamedMotion
from pomona.executive import Clock, Float64

PERIOD = 0.004  # of set-points [s]: servo mode takes 250 a second
MOST = 2  # periods by which a late set-point goes on: the arm is slower then, and jumps nowhere
SETTLES = 0.05  # time after the last set-point in which an arm in servo mode comes to it [s]: assumed, not measured


class ServoStream:
    """The set-points of one motion.

    Attributes:
        sent: set-points so far.
        q_last: the newest one, (dof,) [rad]; due: when the arm shall pass it, on the cell's clock [s].
    """

    def __init__(
        self,
        device: str,
        motion: PathMotion | StreamedMotion,
        q_arm: Float64,
        clock: Clock,
        longest: float,
        commanded: Callable[[float, Float64], None],
    ) -> None:
        """
        Args:
            longest: time without a set-point after which a moving arm has stopped by itself [s].
            commanded: called with each set-point and the time at which the arm shall pass it [s].
        """
        self.motion, self.sent, self.q_last, self.due = motion, 0, q_arm, clock.now()
        self._device = device
        self._clock = clock
        self._longest = longest
        self._commanded = commanded
        self._moves = False
        self._settled_at = 0.0

    @property
    def played(self) -> bool:
        """Whether the set-point rests and the arm must have come to it."""
        return self.motion.set_point_rests and self._clock.now() >= self._settled_at

    def next(self) -> Float64 | None:
        """Return the set-point of now, (dof,) [rad]; None while it rests.

        Raises DeviceFault: the last one is so old that the moving arm has stopped; going on would start it again.
        """
        now = self._clock.now()
        rested = self.motion.set_point_rests
        late = now - self.due
        if rested:
            self.due = now
        elif self._moves and late > self._longest:
            why = "the computer or the connection was delayed, and the arm has stopped"
            raise DeviceFault(self._device, f"got no set-point for {1e3 * late:.0f} ms: {why}")
        q, qd = self.motion.step()
        if rested and self.motion.set_point_rests:
            return None
        steps = 1
        while (
            steps < MOST
            and not self.motion.set_point_rests
            and self.due + (steps + 0.5) * PERIOD < now
        ):
            q, qd = self.motion.step()
            steps += 1
        self.due = max(self.due + steps * PERIOD, now - PERIOD)
        self._moves = bool(qd.any()) and not self.motion.set_point_rests
        self.sent, self.q_last, self._settled_at = self.sent + 1, q, self.due + SETTLES
        self._commanded(self.due, q)
        return q
