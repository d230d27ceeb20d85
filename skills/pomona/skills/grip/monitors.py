"""Monitors of a grip: each one looks at one condition, sample by sample, and reports a `GripProblem` while it lasts.

`SlipWatch` detects slip without relying on the coefficient of friction. When a round fruit slides, its contact moves on
the pads: the torques over the normal force give the centre of pressure. When it turns, the lever arm of its load,
moment over force, changes; the acceleration of a lift does not change it. A fast and a slow average are compared, and
their difference counts beyond noise.

To add one, write a class with a method `check` here and put it into the list of `hold_monitors` where its problem
outranks those below. A monitor keeps its own timers; it commands nothing. After a problem whose code is in
`grip.FREEZING` the controller never lowers the force again.
"""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol

import numpy as np

from pomona.executive.values.arrays import Float64
from pomona.executive.values.numba_kernel import kernel
from pomona.skills.grip.estimate import GripEstimate
from pomona.skills.grip.grip import IN_HAND, GripMode, GripProblem
from pomona.skills.grip.pads import LEVER_LOAD, MIRROR
from pomona.skills.grip.sensor import GripSample, SensorWatch, Timer
from pomona.skills.grip.settings import GripSettings, SlipWatchSettings, WatchSettings

# mean normal force of the fingers below which the centre of pressure is unknown [N]
LEAST_FORCE = 0.15


class SlipWatch:
    """Watches the centre of pressure and the lever arm of a held fruit.

    Attributes:
        slipped: distance that the contact has moved since `start` [m].
        turned: motion of the lever arm since the load settled on the pads [m]; a motion of the hand that tilts it
            moves it, too.
    """

    def __init__(self, settings: SlipWatchSettings, rate: float) -> None:
        self._settings = settings
        self._lags = np.array(settings.place_lags)
        self._shares = 1.0 - np.exp(-1.0 / (rate * self._lags))
        self._period = 1.0 / rate
        self._torque_std = 0.0
        self._means, self._places = np.zeros((3, 5)), np.zeros((3, 2))
        self._lever_fast = self._lever_slow = self._lever_first = self.turned = 0.0
        self._samples = 0
        self._carried_for = 0.0
        self._origin = np.full(2, np.nan)
        self._slipped_before = 0.0
        self.slipped = 0.0

    def calibrate(self, samples: Float64) -> None:
        """Learn the noise of the torques from samples with nothing touching, shape (n, 2, 6)."""
        alike = 0.5 * (samples[:, 0] + MIRROR * samples[:, 1])
        self._torque_std = float(np.sqrt(alike[:, 3:5].var(axis=0).max()))

    def start(self) -> None:
        """Use the present place of the fruit as the reference."""
        self._samples = 0
        self._carried_for = 0.0
        self._origin[:] = np.nan
        self.slipped = self._slipped_before = 0.0

    def check(self, estimate: GripEstimate, periods: int, is_carried: bool) -> bool:
        """Take one sample; return True when the fruit slides or turns now.

        Args:
            estimate: after the sample.
            periods: sample periods that it stands for.
            is_carried: the fruit hangs in the fingers.
        """
        self._samples += periods
        weakest = _average(
            estimate.unfiltered,
            self._samples,
            min(periods, 10),
            self._shares,
            self._means,
            self._places,
        )
        if weakest < LEAST_FORCE:
            return False
        pressing = self._means[:, 0]
        places = self._places
        if math.isnan(self._origin[0]) and self._samples * self._period > self._lags[1]:
            self._origin[:] = places[1]
        elif not math.isnan(self._origin[0]):
            self.slipped = self._slipped_before + math.dist(places[1], self._origin)
        slides = self._slides(places, pressing, is_carried)
        turns = self._turns(estimate, is_carried, periods)
        if slides or turns:
            self._means[1:] = self._means[0]
            self._samples = min(self._samples, round(1.0 / self._shares[0]))
            self._lever_slow = self._lever_fast
            # Count from here: the rising force brings the fruit to rest, which is no further slip.
            if not math.isnan(self._origin[0]):
                self._slipped_before += math.dist(places[0], self._origin)
                self._origin[:] = places[0]
        return slides or turns

    def _slides(self, places: Float64, pressing: Float64, is_carried: bool) -> bool:
        s = self._settings
        if not math.dist(places[0], self._origin) > s.moved_far:
            return False
        for fast, slow in ((0, 1), (1, 2)):
            if slow == 2 and not is_carried:
                continue
            moved = math.dist(places[fast], places[slow])
            share = self._shares[fast]
            std = self._torque_std / float(pressing[fast]) * math.sqrt(share / (2.0 - share))
            change = math.dist(self._means[fast, 3:], self._means[slow, 3:])
            given = s.compliance * 2.0 * change
            if moved > max(s.moved, s.stds * std) + given:
                return True
        return False

    def _turns(self, estimate: GripEstimate, is_carried: bool, periods: int) -> bool:
        s = self._settings
        if not is_carried or estimate.f_t < LEVER_LOAD:
            self._carried_for = 0.0
            return False
        lever = estimate.tau_n / estimate.f_t
        if self._carried_for == 0.0:
            self._lever_fast = self._lever_slow = lever
        self._carried_for += periods * self._period
        slow_lag = min(s.lever_lags[1], max(self._carried_for, s.lever_lags[0]))
        self._lever_fast += (1.0 - math.exp(-periods * self._period / s.lever_lags[0])) * (
            lever - self._lever_fast
        )
        self._lever_slow += (1.0 - math.exp(-periods * self._period / slow_lag)) * (
            lever - self._lever_slow
        )
        moved = abs(self._lever_fast - self._lever_slow)
        noise = s.lever_stds * estimate.tau_std / estimate.f_t
        least = max(s.lever_moved, s.lever_ratio * abs(self._lever_slow), noise)
        if self._carried_for <= s.lever_lags[1]:
            self._lever_first = self._lever_slow
            return False
        self.turned = abs(self._lever_slow - self._lever_first)
        return moved > least


@kernel(error_model="numpy")
def _average(wrench, samples, periods, shares, means, places):  # type: ignore[no-untyped-def]
    """Update averages and places by the mean wrench of both fingers, and return the smallest normal force [N].

    Columns of `means`, shape (3, 5), one row a time constant: normal force, that times the centre of pressure (x, y),
    tangential force (x, y). Each average is a plain mean until its time constant has passed. `places` are the
    centres of pressure, shape (3, 2).
    """
    for k in range(3):
        share = max(min(periods * shares[k], 1.0), 1.0 / samples)
        means[k, 0] += share * (-wrench[2] - means[k, 0])
        means[k, 1] += share * (wrench[4] - means[k, 1])
        means[k, 2] += share * (-wrench[3] - means[k, 2])
        means[k, 3] += share * (wrench[0] - means[k, 3])
        means[k, 4] += share * (wrench[1] - means[k, 4])
        places[k, 0] = means[k, 1] / means[k, 0]
        places[k, 1] = means[k, 2] / means[k, 0]
    return min(means[0, 0], means[1, 0], means[2, 0])


class GripState(NamedTuple):
    """A grip after one sample, as monitors see it."""

    sample: GripSample  # the newest one
    estimate: GripEstimate  # after it
    mode: GripMode  # of the grip
    width: float  # opening between the pads' faces [m]
    f_wanted: float  # grip force that the load needs by the law [N]
    f_for_weight: float  # the same without the load's moment [N]
    has_dead_finger: bool = False  # True when one finger reads nothing while the other one presses

    @property
    def counted_force(self) -> float:
        """Measured grip force [N]; if one sensor reads nothing, twice the other finger's force."""
        return 2.0 * self.estimate.stronger if self.has_dead_finger else self.estimate.f_n

    def problem(self, code: str, message: str, **data: float) -> GripProblem:
        """Return a problem of this moment."""
        return GripProblem(code, message, self.sample.stamp, data)


class Monitor(Protocol):
    """Looks at one condition."""

    def check(self, now: GripState) -> GripProblem | None:
        """Take the state after a sample, and return the problem while there is one."""


def first_problem(monitors: tuple[Monitor, ...], now: GripState) -> GripProblem | None:
    """Let every monitor take the state, and return the problem of the first one that has one."""
    problems = [monitor.check(now) for monitor in monitors]
    return next((problem for problem in problems if problem is not None), None)


def hold_monitors(
    settings: GripSettings, sensors: SensorWatch, saturation: SaturationMonitor, slip: SlipMonitor
) -> tuple[Monitor, ...]:
    """Return the monitors of a held fruit, the most serious problem first."""
    return (
        SensorFaultMonitor(sensors),
        saturation,
        GoneMonitor(settings.watch),
        DeadFingerMonitor(settings.watch),
        slip,
        NeededForceMonitor(settings.loop.max_force),
    )


def has_dead_finger(estimate: GripEstimate, mode: GripMode, limits: WatchSettings) -> bool:
    """Return True when one finger reads nothing while the other one presses; pads that slide may press unevenly."""
    weaker = estimate.weaker
    stronger = estimate.stronger
    # The table's friction on a fruit may load one finger alone, as it did when that finger pushed the fruit.
    stands = mode in (GripMode.STANDING, GripMode.LIFTING)
    rubs = stands and weaker > limits.gone and stronger - weaker < limits.push_limit
    is_dead = weaker < limits.dead * stronger and stronger > limits.alive and not rubs
    return is_dead and mode in IN_HAND and mode is not GripMode.SLIDING


class SensorFaultMonitor:
    """SENSOR_FAULT: readings that cannot be right."""

    def __init__(self, sensors: SensorWatch) -> None:
        self._sensors = sensors

    def check(self, now: GripState) -> GripProblem | None:
        if not self._sensors.reason:
            return None
        left = now.estimate.left
        right = now.estimate.right
        return now.problem(
            "SENSOR_FAULT",
            f"{self._sensors.reason}; the grip is kept",
            left_force_n=left,
            right_force_n=right,
        )


class SaturationMonitor:
    """SENSOR_SATURATED: a channel at the end of its range for `saturated_after`."""

    def __init__(self, limits: WatchSettings) -> None:
        self._limits, self._saturated = limits, Timer()

    def check(self, now: GripState) -> GripProblem | None:
        if (
            self._saturated.update(any(now.sample.saturated), now.sample.elapsed)
            <= self._limits.saturated_after
        ):
            return None
        return now.problem(
            "SENSOR_SATURATED",
            "a finger's channel is at the end of its range; the force is neither raised nor lowered",
            force_n=now.counted_force,
        )


class GoneMonitor:
    """LOST: both fingers read less than `gone` for `gone_after`."""

    def __init__(self, limits: WatchSettings) -> None:
        self._limits, self._gone = limits, Timer()

    def check(self, now: GripState) -> GripProblem | None:
        estimate = now.estimate
        if (
            self._gone.update(estimate.stronger < self._limits.gone, now.sample.elapsed)
            <= self._limits.gone_after
        ):
            return None
        return now.problem(
            "LOST",
            f"the fruit is gone: {estimate.left:.2f} N and {estimate.right:.2f} N at {1e3 * now.width:.1f} mm",
            width_m=now.width,
        )


class DeadFingerMonitor:
    """ONE_FINGER: one finger reads nothing for `gone_after` while the other one presses."""

    def __init__(self, limits: WatchSettings) -> None:
        self._limits, self._dead = limits, Timer()

    def check(self, now: GripState) -> GripProblem | None:
        if self._dead.update(now.has_dead_finger, now.sample.elapsed) <= self._limits.gone_after:
            return None
        left = now.estimate.left
        right = now.estimate.right
        return now.problem(
            "ONE_FINGER",
            f"one finger reads no force any more ({left:.2f} N, {right:.2f} N); the grip is kept",
            left_force_n=left,
            right_force_n=right,
        )


class SlipMonitor:
    """SLIPPED: the fruit has moved on the pads by `slip_limit`, or needs more force than there is for `beyond_after`.

    Attributes:
        slip: estimated slip since the grip holds [m].
    """

    def __init__(self, settings: GripSettings, slips: SlipWatch) -> None:
        self._limits = settings.watch
        self._slip_limit = settings.slip_limit
        self._slips = slips
        self._beyond = Timer()
        self.slip = 0.0

    def check(self, now: GripState) -> GripProblem | None:
        limits = self._limits
        estimate = now.estimate
        elapsed = now.sample.elapsed
        slides = now.mode is GripMode.SLIDING
        f_n = now.counted_force
        needed = estimate.f_least
        beyond = self._beyond.update(needed > limits.beyond * f_n and not slides, elapsed)
        if needed > limits.slipping * f_n and not slides:
            self.slip += estimate.slip_speed * elapsed
        slip = max(self.slip, 0.0 if slides else self._slips.slipped)
        if slip <= self._slip_limit and beyond <= limits.beyond_after:
            return None
        return now.problem(
            "SLIPPED",
            f"the fruit slips: about {1e3 * slip:.1f} mm, needs {needed:.1f} N, has {f_n:.1f} N",
            slip_m=slip,
            least_force_n=needed,
        )


class NeededForceMonitor:
    """FORCE_LIMIT: the load needs more force than is allowed."""

    def __init__(self, max_force: float) -> None:
        self._max_force = max_force

    def check(self, now: GripState) -> GripProblem | None:
        if now.f_wanted <= self._max_force:
            return None
        message = f"the load needs {now.f_wanted:.1f} N, the limit is {self._max_force:.1f} N"
        data = {
            "wanted_force_n": now.f_wanted,
            "for_weight_alone_n": now.f_for_weight,
            "limit_n": self._max_force,
        }
        return now.problem("FORCE_LIMIT", message, **data)


class FingerForceMonitor:
    """FORCE_LIMIT before the fruit is held: a finger presses with more than half of the largest grip force."""

    def __init__(self, max_force: float) -> None:
        self._max_force = max_force

    def check(self, now: GripState) -> GripProblem | None:
        left = now.estimate.left
        right = now.estimate.right
        if max(left, right) <= 0.5 * self._max_force:
            return None
        return now.problem(
            "FORCE_LIMIT",
            f"a finger reads {max(left, right):.1f} N, more than half of {self._max_force:.1f} N",
            left=left,
            right=right,
        )
