"""Monitors of a grip: each one looks at one condition, sample by sample, and reports a `GripProblem` while it lasts.

To add one, write a class with a method `check` here and put it into the list of `hold_monitors` where its problem
outranks those below. A monitor keeps its own timers; it commands nothing. After a problem whose code is in
`grip.FREEZING` the controller never lowers the force again.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

from pomona.skills.grip.estimate_kernel import GripEstimate
from pomona.skills.grip.grip import GripProblem
from pomona.skills.grip.reference_modes import ReferenceMode
from pomona.skills.grip.sensor_watch import SensorWatch
from pomona.skills.grip.settings import GripSettings, WatchSettings
from pomona.skills.grip.slip_watch import SlipWatch
from pomona.skills.grip.stream_guard import GripSample
from pomona.skills.grip.timing import Timer


class GripState(NamedTuple):
    """A grip after one sample, as monitors see it."""

    sample: GripSample  # the newest one
    estimate: GripEstimate  # after it
    mode: ReferenceMode  # of the force reference
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


def has_dead_finger(estimate: GripEstimate, mode: ReferenceMode, limits: WatchSettings) -> bool:
    """Return True when one finger reads nothing while the other one presses; pads that slide may press unevenly."""
    is_dead = estimate.weaker < limits.dead * estimate.stronger and estimate.stronger > limits.alive
    return is_dead and mode not in (ReferenceMode.SLIDING, ReferenceMode.RAMP)


class SensorFaultMonitor:
    """SENSOR_FAULT: readings that cannot be right."""

    def __init__(self, sensors: SensorWatch) -> None:
        self._sensors = sensors

    def check(self, now: GripState) -> GripProblem | None:
        if not self._sensors.reason:
            return None
        left, right = now.estimate.left, now.estimate.right
        message = f"{self._sensors.reason}; the grip is kept"
        return now.problem("SENSOR_FAULT", message, left_force_n=left, right_force_n=right)


class SaturationMonitor:
    """SENSOR_SATURATED: a channel at the end of its range for `saturated_after`."""

    def __init__(self, limits: WatchSettings) -> None:
        self._limits, self._saturated = limits, Timer()

    def check(self, now: GripState) -> GripProblem | None:
        if self._saturated.update(any(now.sample.saturated), now.sample.elapsed) <= self._limits.saturated_after:
            return None
        message = "a finger's channel is at the end of its range; the force is neither raised nor lowered"
        return now.problem("SENSOR_SATURATED", message, force_n=now.counted_force)


class GoneMonitor:
    """LOST: both fingers read less than `gone` for `gone_after`."""

    def __init__(self, limits: WatchSettings) -> None:
        self._limits, self._gone = limits, Timer()

    def check(self, now: GripState) -> GripProblem | None:
        estimate = now.estimate
        if self._gone.update(estimate.stronger < self._limits.gone, now.sample.elapsed) <= self._limits.gone_after:
            return None
        message = f"the fruit is gone: {estimate.left:.2f} N and {estimate.right:.2f} N at {1e3 * now.width:.1f} mm"
        return now.problem("LOST", message, width_m=now.width)


class DeadFingerMonitor:
    """ONE_FINGER: one finger reads nothing for `gone_after` while the other one presses."""

    def __init__(self, limits: WatchSettings) -> None:
        self._limits, self._dead = limits, Timer()

    def check(self, now: GripState) -> GripProblem | None:
        if self._dead.update(now.has_dead_finger, now.sample.elapsed) <= self._limits.gone_after:
            return None
        left, right = now.estimate.left, now.estimate.right
        message = f"one finger reads no force any more ({left:.2f} N, {right:.2f} N); the grip is kept"
        return now.problem("ONE_FINGER", message, left_force_n=left, right_force_n=right)


class SlipMonitor:
    """SLIPPED: the fruit has moved on the pads by `slip_limit`, or needs more force than there is for `beyond_after`.

    Attributes:
        slip: estimated slip since the grip holds [m].
    """

    def __init__(self, settings: GripSettings, slips: SlipWatch) -> None:
        self._limits, self._slip_limit, self._slips = settings.watch, settings.slip_limit, slips
        self._beyond = Timer()
        self.slip = 0.0

    def check(self, now: GripState) -> GripProblem | None:
        limits, estimate, elapsed = self._limits, now.estimate, now.sample.elapsed
        slides, pivots = now.mode is ReferenceMode.SLIDING, now.mode is ReferenceMode.PIVOTING
        f_n = now.counted_force
        needed = estimate.f_coulomb if pivots else estimate.f_least
        beyond = self._beyond.update(needed > limits.beyond * f_n and not slides, elapsed)
        if needed > limits.slipping * f_n and not slides:
            self.slip += estimate.slip_speed * elapsed
        slip = max(self.slip, 0.0 if slides or pivots else self._slips.slipped)
        if slip <= self._slip_limit and beyond <= limits.beyond_after:
            return None
        message = f"the fruit slips: about {1e3 * slip:.1f} mm, needs {needed:.1f} N, has {f_n:.1f} N"
        return now.problem("SLIPPED", message, slip_m=slip, least_force_n=needed)


class NeededForceMonitor:
    """FORCE_LIMIT: the load needs more force than is allowed."""

    def __init__(self, max_force: float) -> None:
        self._max_force = max_force

    def check(self, now: GripState) -> GripProblem | None:
        if now.f_wanted <= self._max_force:
            return None
        message = f"the load needs {now.f_wanted:.1f} N, the limit is {self._max_force:.1f} N"
        data = {"wanted_force_n": now.f_wanted, "for_weight_alone_n": now.f_for_weight, "limit_n": self._max_force}
        return now.problem("FORCE_LIMIT", message, **data)


class FingerForceMonitor:
    """FORCE_LIMIT before the fruit is held: a finger presses with more than half of the largest grip force."""

    def __init__(self, max_force: float) -> None:
        self._max_force = max_force

    def check(self, now: GripState) -> GripProblem | None:
        left, right = now.estimate.left, now.estimate.right
        if max(left, right) <= 0.5 * self._max_force:
            return None
        message = f"a finger reads {max(left, right):.1f} N, more than half of {self._max_force:.1f} N"
        return now.problem("FORCE_LIMIT", message, left=left, right=right)
