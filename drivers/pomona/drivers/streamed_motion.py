"""A motion that follows streamed set-points, for closed-loop control.

A set-point is only a target: the path to it stays within the joints' limits of speed, acceleration and jerk for any
input. Speeds follow the fastest profile that can still stop (v² = 2 a d). A moving average over the last `2 a / j`
seconds turns its steps of acceleration into bounded jerk; an average of values within limits is within them, too.
A set-point with a velocity and a time is a target that moves on: the profile then holds for the distance to it, and
half of the average's length is made up for (`delay`). A target that is too quick is followed from behind.
Without a new set-point within the watchdog's time the joints come to rest and the motion has failed.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from pomona.drivers.errors import BadTrajectory
from pomona.drivers.interfaces import ArmLimits, MotionState
from pomona.drivers.path_motion import Phase, SteppedMotion
from pomona.executive.values.arrays import Float64

CATCHING_UP = 0.25
"""Share of the acceleration with which a joint joins a target that moves on; the rest is for the target's own."""


class StreamedMotion(SteppedMotion):
    """A motion towards the newest set-point, stepped by the arm's driver at a fixed period."""

    time_left = math.inf  # seconds to its end: not known, since set-points may keep arriving

    def __init__(
        self,
        q: Float64,
        limits: ArmLimits,
        period: float,
        watchdog: float,
        speed: float = 1.0,
        now: Callable[[], float] = lambda: 0.0,
    ) -> None:
        """
        Args:
            q: where the arm stands, shape (dof,) [rad].
            watchdog: without a new set-point for this long it comes to rest and has failed [s].
            speed: share of the joints' largest speeds that is used, above 0 to 1.
            now: when the arm shall pass the newest set-point, on the cell's clock [s]; for set-points with a time.
        """
        super().__init__()
        self.speed = speed
        self.progress = 0.0
        self._limits = limits
        self._period = period
        self._watchdog = watchdog
        window = max(math.ceil(2.0 * float((limits.acceleration / limits.jerk).max()) / period), 1)
        self._lately = np.tile(q, (window, 1))  # where the unsmoothed set-point was
        self._next = 0
        self._sum: Float64 = q * window
        self._raw, self._rate = q.copy(), np.zeros_like(q)
        self._target: Float64 = q.copy()
        # velocity of the target, and when it is there
        self._moves_on = np.zeros_like(q)
        self._at = 0.0
        self._now = now
        self.delay = (window - 1) * period / 2.0
        self._smooth: Float64 = q.copy()
        self._still = window  # steps for which nothing has moved
        self._aimed = 0.0

    # ------------------------------------------------------------------------------------ set-points

    def aim(self, q: Float64, qd: Float64 | None = None, at: float = 0.0) -> None:
        """Go to joints, shape (dof,) [rad], from now on; with `qd` [rad/s] pass them at `at` [s] with that velocity.

        Raises BadTrajectory: not finite, or outside the joints' limits; it is ignored, and the watchdog runs on.
        """
        self.take(self.checked(q, qd, at))

    def checked(self, q: Float64, qd: Float64 | None, at: float) -> tuple[Float64, Float64, float]:
        """Return the arguments of `aim`, (dof,) each and a time, for `take` in the thread that steps.

        Raises BadTrajectory: see `aim`.
        """
        target = np.array(q, np.float64)
        moves_on = np.zeros_like(self._raw) if qd is None else np.array(qd, np.float64)
        numbers = np.concatenate([target.ravel(), moves_on.ravel(), [at]])
        if not target.shape == moves_on.shape == self._raw.shape or not np.isfinite(numbers).all():
            raise BadTrajectory(f"a set-point must be {self._raw.size} finite numbers", 0)
        outside = np.maximum(self._limits.lower - target, target - self._limits.upper)
        quick = np.abs(moves_on) - self._limits.velocity
        joint = int(np.maximum(outside, quick).argmax())
        if outside[joint] > 0.0:
            span = f"{np.degrees(self._limits.lower[joint]):.1f}° and {np.degrees(self._limits.upper[joint]):.1f}°"
            words = f"joint {joint + 1} would be at {np.degrees(target[joint]):.1f}°, its limits are {span}"
            raise BadTrajectory(words, 0, joint)
        if quick[joint] > 0.0:
            most = f"{np.degrees(self._limits.velocity[joint]):.0f}°/s"
            words = f"joint {joint + 1} would move at {np.degrees(moves_on[joint]):.0f}°/s, its limit is {most}"
            raise BadTrajectory(words, 0, joint)
        return target, moves_on, at

    def take(self, target: tuple[Float64, Float64, float]) -> None:
        """Go to a target of `checked` from now on."""
        (self._target, self._moves_on, self._at), self._aimed = target, 0.0

    # ------------------------------------------------------------------------------------ supervision

    @property
    def set_point_rests(self) -> bool:
        return self._still >= len(self._lately)

    @property
    def set_point_arrived(self) -> bool:
        """Whether it stands at its target: one that stands elsewhere is not stepped any more."""
        return self.set_point_rests and bool(np.abs(self._target - self._raw).max() < 1e-3)  # rad

    def set_speed(self, speed: float) -> None:
        """Use this share of the joints' largest speeds from now on."""
        self.speed = speed

    def abandon(self, problem: str) -> None:
        super().abandon(problem)
        self._rate[:], self._still = 0.0, len(self._lately)

    def resume(self) -> None:
        """Follow the set-points that arrive from now on."""
        if self.state is MotionState.PAUSED:
            self._aimed, self._target = 0.0, self._raw.copy()
            self._moves_on = np.zeros_like(self._raw)
        super().resume()

    # ------------------------------------------------------------------------------------ stepping

    def step(self) -> tuple[Float64, Float64]:
        """Advance one period; joint positions [rad] and velocities [rad/s] of the set-point, (dof,) each."""
        if self.phase is Phase.RUNNING:
            self._aimed += self._period
            if self._aimed > self._watchdog + 1e-9:
                self.fail(f"no new set-point came for {1e3 * self._watchdog:.0f} ms")
        free = self.phase is Phase.RUNNING
        before = self._raw
        smooth = self._smooth
        self._raw = self._advanced(self._fastest() if free else np.zeros_like(self._rate), free)
        self._sum = self._sum + self._raw - self._lately[self._next]
        self._lately[self._next] = self._raw
        self._next = (self._next + 1) % len(self._lately)
        self._still = self._still + 1 if np.array_equal(self._raw, before) else 0
        mean = np.clip(
            self._sum / len(self._lately), self._limits.lower, self._limits.upper
        )  # rounding
        self._smooth = self._raw.copy() if self._still >= len(self._lately) else mean
        if self.set_point_rests:
            self._sum = self._raw * len(self._lately)  # so that rounding errors do not accumulate
            return self._smooth, np.zeros_like(smooth)
        return self._smooth, (self._smooth - smooth) / self._period

    def _fastest(self) -> Float64:
        """Return the speeds towards the target from which each joint can still stop at it, or fall in with it."""
        h = self._period
        on = self._moves_on
        ahead = self._now() + h + self.delay - self._at
        way = self._target + on * (ahead - h) - self._raw if on.any() else self._target - self._raw
        wanted = on + np.sign(way) * self._stopping_speed(
            np.abs(way), CATCHING_UP if on.any() else 1.0
        )
        if on.any():
            lower, upper = np.maximum(
                [self._raw - self._limits.lower, self._limits.upper - self._raw], 0.0
            )
            wanted = np.clip(wanted, -self._stopping_speed(lower), self._stopping_speed(upper))
        most = self.speed * self._limits.velocity
        return np.clip(wanted, -most, most)

    def _stopping_speed(self, distance: Float64, share: float = 1.0) -> Float64:
        """Return the speeds from which each joint can stop within a distance, not negative, in whole periods.

        `share` of the acceleration is used.
        """
        h = self._period
        a = share * self._limits.acceleration
        speed: Float64 = np.minimum(
            np.sqrt((0.5 * a * h) ** 2 + 2.0 * a * distance) - 0.5 * a * h, distance / h
        )
        return speed

    def _advanced(self, wanted: Float64, free: bool) -> Float64:
        most = self._limits.acceleration * self._period
        self._rate = self._rate + np.clip(wanted - self._rate, -most, most)
        moved: Float64 = self._raw + self._rate * self._period
        if free:  # the last step ends on a target that stands
            there = (
                ~self._moves_on.any()
                & (np.abs(self._target - moved) < 1e-9)
                & (np.abs(self._rate) <= most)
            )
            moved = np.where(there, self._target, moved)
            self._rate = np.where(there, 0.0, self._rate)
        return np.clip(moved, self._limits.lower, self._limits.upper)
