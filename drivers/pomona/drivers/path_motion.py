"""The motion of an arm along a timed path, with the right to slow down: state for the caller, end, stop and pause.

Stopping, pausing and another speed bend time, not the path: the rate changes as fast as the joints' acceleration limits
allow (the path's own accelerations included), eased in and out so that jerk stays bounded. It is never above 1, so a
path that is within the limits stays within them.
"""

from __future__ import annotations

import copy
import math
from abc import ABC, abstractmethod
from enum import Enum

import numpy as np

from pomona.drivers.interfaces import ArmLimits, MotionState, Trajectory
from pomona.executive.values.arrays import Float64

BLEND = 0.3
"""Time over which the distance from the last set-point to the path's start is taken up [s]: a choice. It is longer for
a distance that needs more than `SHARE` of the joints' limits then."""
SHARE = 0.1


class PathFollower:
    """The set-point on a trajectory, stepped at a fixed period."""

    def __init__(
        self,
        trajectory: Trajectory,
        limits: ArmLimits,
        period: float,
        speed: float = 1.0,
        q_from: Float64 | None = None,
    ) -> None:
        """
        Args:
            period: of the steps [s].
            speed: share of the path's own pace at which it is followed, above 0 to 1.
            q_from: the last set-point, shape (dof,) [rad]. When something holds the arm beside it, it differs from the
                path's start, and the set-point moves smoothly onto the path. None: it begins at the path's start.
        """
        self._period = period
        self._limits = limits
        away = np.zeros_like(trajectory.q[0]) if q_from is None else q_from - trajectory.q[0]
        needed = _quintic_time(away, limits)
        trajectory = stretched(trajectory, max(needed / trajectory.duration, 1.0))
        self._duration = trajectory.duration
        self._q, self._qd, self._qdd = _resample(trajectory, period)
        if away.any():
            blend = max(min(BLEND, self._duration), needed)
            t = np.minimum(np.arange(len(self._q)) * period, self._duration)
            for part, left in zip((self._q, self._qd, self._qdd), _quintic(t, blend), strict=True):
                part += np.outer(left, away)
        self.path_time = 0.0
        self.speed = speed  # share of the path's own pace; may be changed at any time
        self.rate = speed  # at once: a path begins at rest
        self._rate_change = 0.0

    @property
    def progress(self) -> float:
        return min(self.path_time / self._duration, 1.0)

    @property
    def time_left(self) -> float:
        """Seconds to the end at the present speed."""
        return (self._duration - self.path_time) / self.speed

    @property
    def finished(self) -> bool:
        """Whether the path's end is reached."""
        return self.path_time >= self._duration - 1e-9

    @property
    def at_rest(self) -> bool:
        """Whether nothing moves along the path."""
        return self.finished or self.rate == 0.0

    def halt(self) -> None:
        """Stand still now, without braking: the arm does not follow any more."""
        self.rate = self._rate_change = 0.0

    def step(self, goes_on: bool = True) -> tuple[Float64, Float64]:
        """Advance one period; joint positions [rad] and velocities [rad/s] of the set-point, (dof,) each.

        It follows the path at its speed, or comes to rest on it.
        """
        before = self.rate
        wanted = self.speed if goes_on else 0.0
        if before != wanted or self._rate_change != 0.0:
            self._change_rate(wanted)
        way = 0.5 * (before + self.rate) * self._period
        self.path_time = min(self.path_time + way, self._duration)
        q, qd, _ = self._sample()
        return q, qd * (0.0 if self.finished else self.rate)

    def _change_rate(self, wanted: float) -> None:
        _, qd, qdd = self._sample()
        speed = np.abs(qd)
        share = speed / self._limits.velocity
        if float(share.max()) < 1e-3:
            self.rate = wanted
            self._rate_change = 0.0
            return
        towards = math.copysign(1.0, wanted - self.rate)
        back = self._rate_change * towards < 0.0 and wanted > 0.0  # a stop waits for nothing
        moving = share > 1e-3
        # qdd rate² + qd change within ± acceleration, joint by joint
        own = qdd[moving] * self.rate**2 * np.sign(qd[moving]) * (-towards if back else towards)
        room = np.maximum(self._limits.acceleration[moving] - own, 0.0) / speed[moving]
        ease = 0.5 * float((self._limits.jerk[moving] / speed[moving]).min())
        if back:
            slower = min(max(abs(self._rate_change) - ease * self._period, 0.0), float(room.min()))
            self._rate_change = math.copysign(slower, self._rate_change)
            # the rate of a path that is followed: one of 0 rests
            self.rate = min(max(self.rate + self._rate_change * self._period, 1e-6), 1.0)
            return
        left = abs(wanted - self.rate)
        change = min(
            float(room.min()),
            math.sqrt(2.0 * ease * left),
            abs(self._rate_change) + ease * self._period,
        )
        change = max(change, 1e-3)
        if change * self._period >= left:
            self.rate = wanted
            self._rate_change = 0.0
        else:
            self._rate_change = towards * change
            self.rate += self._rate_change * self._period

    def _sample(self) -> tuple[Float64, Float64, Float64]:
        if self.finished:
            return self._q[-1], self._qd[-1], self._qdd[-1]
        place = self.path_time / self._period
        i = min(int(place + 1e-9), len(self._q) - 2)
        s = place - i
        if s < 1e-9:
            return self._q[i], self._qd[i], self._qdd[i]
        # Cubic between samples: straight pieces would show as jerks once the path is run slowly.
        step = self._q[i + 1] - self._q[i]
        v0 = self._qd[i] * self._period
        v1 = self._qd[i + 1] * self._period
        q = self._q[i] + s * (v0 + s * (3.0 * step - 2.0 * v0 - v1 + s * (v0 + v1 - 2.0 * step)))
        qd = self._qd[i] + s * (self._qd[i + 1] - self._qd[i])
        return q, qd, self._qdd[i] + s * (self._qdd[i + 1] - self._qdd[i])


def stretched(trajectory: Trajectory, factor: float) -> Trajectory:
    """Return the same path, slower by a factor >= 1: rates fall with it, accelerations with its square."""
    return Trajectory(
        trajectory.t * factor, trajectory.q, trajectory.qd / factor, trajectory.qdd / factor**2
    )


def _resample(trajectory: Trajectory, period: float) -> tuple[Float64, Float64, Float64]:
    """Return the trajectory at multiples of the period (and once beyond its end), by cubic Hermite interpolation."""
    t = np.arange(math.ceil(trajectory.duration / period - 1e-9) + 2) * period
    t = np.minimum(t, trajectory.duration)
    i = np.clip(np.searchsorted(trajectory.t, t, side="right") - 1, 0, len(trajectory.t) - 2)
    h = (trajectory.t[i + 1] - trajectory.t[i])[:, None]
    s = ((t - trajectory.t[i])[:, None]) / h
    q0 = trajectory.q[i]
    q1 = trajectory.q[i + 1]
    v0 = trajectory.qd[i] * h
    v1 = trajectory.qd[i + 1] * h
    a = 2.0 * (q0 - q1) + v0 + v1
    b = 3.0 * (q1 - q0) - 2.0 * v0 - v1
    q = q0 + s * (v0 + s * (b + s * a))
    qd = (v0 + s * (2.0 * b + s * 3.0 * a)) / h
    qdd = trajectory.qdd[i] + s * (trajectory.qdd[i + 1] - trajectory.qdd[i])
    return q, qd, qdd


def _quintic(t: Float64, duration: float) -> tuple[Float64, Float64, Float64]:
    """Return a share that falls from 1 to 0 from rest to rest, and its two rates, at the times `t`, shape (n,) each."""
    x = np.minimum(t / duration, 1.0)
    share = 1.0 - x**3 * (10.0 - 15.0 * x + 6.0 * x**2)
    rate = -30.0 * (x * (1.0 - x)) ** 2 / duration
    return share, rate, -60.0 * x * (1.0 - x) * (1.0 - 2.0 * x) / duration**2


def _quintic_time(way: Float64, limits: ArmLimits) -> float:
    """Return the time in which a quintic covers a way, shape (dof,), within `SHARE` of the joints' limits [s]."""
    way = np.abs(way) / SHARE
    peaks = (
        15.0 / 8.0 * way / limits.velocity,
        10.0 / np.sqrt(3.0) * way / limits.acceleration,
        60.0 * way / limits.jerk,
    )
    return max(float(np.power(peak.max(), 1.0 / power)) for power, peak in enumerate(peaks, 1))


HELD_UP = 1.0  # time after which joints that rest beside the path's end count as blocked [s]


class Phase(Enum):
    """State of the set-point: it follows the path, brakes on it, or rests."""

    RUNNING = "running"
    BRAKING = "braking"
    RESTING = "resting"


class SteppedMotion(ABC):
    """What a motion is doing, as its caller and the arm's driver see it; the driver steps it at a fixed period."""

    def __init__(self) -> None:
        self.state = MotionState.RUNNING
        self.settled = self._stopping = False
        self.problem = ""

    @property
    @abstractmethod
    def set_point_rests(self) -> bool:
        """Whether the commanded position stands still."""

    @property
    def at_rest(self) -> bool:
        """Whether nothing moves: settled, or paused and standing."""
        return self.settled or (self.state is MotionState.PAUSED and self.set_point_rests)

    @property
    def phase(self) -> Phase:
        """RESTING once nothing moves any more, as `at_rest`."""
        if self.at_rest:
            return Phase.RESTING
        free = self.state is MotionState.RUNNING and not self._stopping
        return Phase.RUNNING if free else Phase.BRAKING

    def stop(self) -> None:
        """Come to rest within the limits and stay there."""
        self._stopping = True

    def fail(self, problem: str) -> None:
        """Come to rest and end as FAILED."""
        if self.state in (MotionState.RUNNING, MotionState.PAUSED):
            self.problem = self.problem or problem
            self.stop()

    def abandon(self, problem: str) -> None:
        """End as FAILED where the arm is: its controller has stopped, or does not go on."""
        if self.state in (MotionState.RUNNING, MotionState.PAUSED):
            self.problem = problem
            self.state = MotionState.FAILED
            self._stopping = True

    def pause(self) -> None:
        """Come to rest until `resume`."""
        if self.phase is Phase.RUNNING:
            self.state = MotionState.PAUSED

    def resume(self) -> None:
        """Go on after a pause."""
        if self.state is MotionState.PAUSED and not self._stopping:
            self.state = MotionState.RUNNING

    def look(self, resting: bool, beside: float, now: float) -> None:
        """Update the state, from whether the measured joints rest and their largest distance from the set-point [rad].

        An arm that was stopped against something rests beside its set-point: that is stopped all the same.
        """
        if self._stopping and self.set_point_rests:
            self.state = MotionState.FAILED if self.problem else MotionState.STOPPED
            self.settled = resting


class PathMotion(SteppedMotion):
    """A `Motion` over a trajectory."""

    def __init__(
        self,
        trajectory: Trajectory,
        limits: ArmLimits,
        period: float,
        speed: float = 1.0,
        q_from: Float64 | None = None,
    ) -> None:
        """The arguments are those of `PathFollower`."""
        super().__init__()
        self._follower = PathFollower(trajectory, limits, period, speed, q_from)
        self._resting_since = math.inf

    @property
    def progress(self) -> float:
        return self._follower.progress

    @property
    def time_left(self) -> float:
        """Seconds to the path's end at the present speed."""
        return self._follower.time_left

    @property
    def speed(self) -> float:
        """Share of the path's own pace at which it is followed, above 0 to 1."""
        return self._follower.speed

    @property
    def set_point_rests(self) -> bool:
        """True when the set-point stands: at the end, stopped, or paused."""
        return self._follower.at_rest

    @property
    def set_point_arrived(self) -> bool:
        """True when the set-point has come to the path's end."""
        return self._follower.finished

    def come_to_rest(self, follower: PathFollower) -> None:
        """Brake as `follower` does: an earlier `braking()`, from a set-point that lay further back."""
        self._stopping = True
        self._follower = follower

    def abandon(self, problem: str) -> None:
        super().abandon(problem)
        self._follower.halt()

    def resume(self) -> None:
        super().resume()
        self._resting_since = math.inf  # it rested because it was paused

    def set_speed(self, speed: float) -> None:
        """Follow the path at this share of its own pace from now on."""
        self._follower.speed = speed

    def step(self) -> tuple[Float64, Float64]:
        """Advance one period; joint positions [rad] and velocities [rad/s] of the set-point, (dof,) each."""
        return self._follower.step(self.phase is Phase.RUNNING)

    def braking(self) -> PathFollower:
        """How the set-point would come to rest if it were stopped now."""
        return copy.copy(self._follower)  # the path itself is only read

    def look(self, resting: bool, beside: float, now: float) -> None:
        self._resting_since = min(self._resting_since, now) if resting else math.inf
        if self._stopping or not self._follower.finished:
            super().look(resting, beside, now)
        elif resting and beside < 2e-3:  # joints so near to the path's end are there [rad]
            self.state = MotionState.DONE
            self.settled = True
        elif now - self._resting_since > HELD_UP:
            self.fail(
                f"the arm rests {math.degrees(beside):.1f}° off the end of its path: something holds it"
            )
