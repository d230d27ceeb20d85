"""Moves of a parallel gripper, and the checks that it follows them. One supervisor for every gripper.

A driver reports its commands (`move`, `stream`, `rest`) and passes each state of the gripper to `look`, which returns
the problem as text. The supervisor does not communicate with the device.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from pomona.drivers.errors import MotionRefused
from pomona.drivers.interfaces import GripperLimits, GripperState, MotionState
from pomona.executive.values.kinds import Measure, Number
from pomona.executive.values.sections import value
from pomona.executive.values.units import LENGTH, TIME

COASTING = 0.3  # the fingers come to rest within this time after a move [s]: braking from 0.2 m/s at 2 m/s² takes 0.1 s
BEYOND = 5e-3  # a width outside the stroke by more than this is implausible [m]
FASTER = 5.0  # implausible multiple of the largest speed; fingers knocked against a wall reach 3 (simulated)
STRONGER = 1.2  # implausible multiple of both fingers' largest force, by the motor's current
SLOW = 2e-3  # fingers slower than this rest [m/s] …
# … once their width has stayed within the first [m] for the second [s]
STEADY = 5e-4
STILL = 0.03
FORGETTING = 2.0
"""Time constant with which a width that lags the streamed speeds is forgiven [s]: rates too slow for the gripper add
up over a long grip, 0.1 mm/s to 0.2 mm."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GripperSupervision:
    """How closely a gripper must follow its commands.

    Attributes:
        margin, share: a move may take this much [s] and this share of its planned time longer than planned.
        stray: fingers without a command stay within this [m]: pads and fruit give way by one or two millimetres.
        lag: fingers follow a streamed speed this much later at most [s]: two or three of the 30 … 50 commands a second
            that a WSG takes.
        follow: the width lags the motion that was streamed by less than this [m]: what presses on a fruit moves by one
            or two millimetres. A width that lags more is stuck, or the fingers are blocked.
    """

    margin: float = value(
        Measure(TIME, "50 ms", "30 s"), "500 ms", "a move may take this much longer than planned"
    )
    share: float = value(Number(0.0, 10.0), "0.5", "and this share of its planned time")
    stray: float = value(
        Measure(LENGTH, "0.2 mm", "50 mm"), "3 mm", "fingers without a command stay within this"
    )
    lag: float = value(
        Measure(TIME, "10 ms", "2 s"),
        "100 ms",
        "they follow a streamed speed this much later at most",
    )
    follow: float = value(
        Measure(LENGTH, "2 mm", "100 mm"),
        "10 mm",
        "the width lags streamed motion by less than this",
    )


class GripperSupervisor:
    """Compares a gripper's states with its commands; times are the cell's [s].

    With measured width w and streamed speed v (positive opens), the fingers obey while

        w(t) - lower(t) <= stray + lag * opening    and    upper(t) - w(t) <= stray + lag * closing,

        lower(t) = min over s <= t of w(s) + integral from s to t of max(v, 0)
        upper(t) = max over s <= t of w(s) - integral from s to t of max(-v, 0),

    where `opening` and `closing` are the largest speeds of the last `lag` seconds. Fingers may thus open and close by
    no more than the commands, and by less if something blocks them.

    Attributes:
        at_rest: whether the fingers were measured at rest.
        follows: whether they move within the streamed speeds commanded lately, and do not stray.
        rest_by: fingers that are left alone now do not move beyond this time [s].
    """

    def __init__(
        self,
        limits: GripperLimits,
        acceleration: float,
        supervision: GripperSupervision | None = None,
    ) -> None:
        """
        Args:
            limits: of the hardware: the whole stroke.
            acceleration: with which moves begin and end [m/s²].
        """
        self.at_rest = self.follows = False
        self.rest_by = -math.inf
        self._limits = limits
        self._acceleration = acceleration
        self._supervision = supervision or GripperSupervision()
        self._due = math.inf
        self._target = math.inf  # width of the newest move; none after a streamed speed
        # until then they may move within the way of a move, or come to rest from it
        self._free_until = -math.inf
        self._way = -math.inf, math.inf
        self._speed = self._opening = self._closing = (
            0.0  # commanded now; and the fastest either way lately
        )
        # of the width, see the class
        self._lower_bound = math.inf
        self._upper_bound = -math.inf
        self._told_at = -math.inf
        self._behind = 0.0  # streamed motion that the width has not followed, positive opens
        self._steady: tuple[float, float] | None = None
        self._last: GripperState | None = None

    def move(self, now: float, start: float, width: float, speed: float) -> None:
        """A move from one opening to another was commanded."""
        expected = abs(width - start) / speed + speed / self._acceleration
        self._due = now + expected * (1.0 + self._supervision.share) + self._supervision.margin
        self._target = width
        self._free_until, self.rest_by = math.inf, self._due
        self._behind = 0.0
        self._way = self._reach(min(start, width), max(start, width))

    def stream(self, now: float, speed: float, watchdog: float) -> None:
        """A speed [m/s] was commanded; without another it ends after `watchdog` [s]."""
        if math.isinf(self._free_until):
            self.rest(now)
        self._account(now)
        self._speed = speed
        self._target = math.inf
        self._opening, self._closing = max(self._opening, speed), max(self._closing, -speed)
        if speed:
            self.rest_by = max(self.rest_by, now + watchdog + self._supervision.lag)

    def rest(self, now: float) -> None:
        """The fingers were commanded to stand still, or have ended their move."""
        self._due = math.inf
        self._speed = 0.0
        self._behind = 0.0
        self._lower_bound = math.inf
        self._upper_bound = -math.inf
        self._told_at = now
        self._free_until = now + COASTING
        seen = self._last is not None and now - self._last.stamp <= self._supervision.lag
        # If this thread stalled for longer than `lag`, the width is unknown, and the next report may be old.
        self._way = (
            self._reach(self._last.width, self._last.width)
            if self._last and seen
            else (-math.inf, math.inf)
        )
        self.rest_by = max(self.rest_by, self._free_until)

    def look(self, now: float, state: GripperState) -> str:
        """Return the problem of a state, as the rest of a sentence that begins with the gripper's name; else empty."""
        last = self._last
        if last is not None and state.stamp <= last.stamp:
            return self._overdue(now)
        impossible = self._impossible(state)
        if impossible:
            self.at_rest = self.follows = False
            return impossible
        self._last = state
        if self._steady is None or abs(state.width - self._steady[1]) > STEADY:
            self._steady = (state.stamp, state.width)
        self.at_rest = abs(state.speed) < SLOW and (
            last is None or state.stamp - self._steady[0] >= STILL
        )
        if last is not None:
            left = self._behind * math.exp((last.stamp - state.stamp) / FORGETTING) - (
                state.width - last.width
            )
            self._behind = left if left * self._behind > 0.0 else 0.0
        stray = self._stray(
            state.stamp, state.width, 0.0 if last is None else state.stamp - last.stamp
        )
        self.follows = not stray and -self._closing - SLOW <= state.speed <= self._opening + SLOW
        if stray:
            self.rest_by = math.inf
        elif self.at_rest and state.stamp > self._free_until and not self._speed:
            self.rest_by = now
        return self._overdue(now) or stray or self._lagging(state.width)

    def _impossible(self, state: GripperState) -> str:
        width = state.width
        speed = state.speed
        limits = self._limits
        if not (math.isfinite(width) and math.isfinite(speed)):
            return f"reports a width of {1e3 * width:g} mm and a speed of {1e3 * speed:g} mm/s"
        if not limits.width_min - BEYOND <= width <= limits.width_max + BEYOND:
            return f"reports a width of {1e3 * width:.1f} mm, which is outside its stroke"
        if abs(speed) > FASTER * limits.speed_max:
            return f"reports a speed of {1e3 * speed:.0f} mm/s, which it cannot reach"
        most = STRONGER * 2.0 * limits.force_max
        # this form is True also for NaN
        if state.motor_force is not None and not abs(state.motor_force) <= most:
            return f"reports {state.motor_force:g} N of its motor, which presses with {most:.0f} N at most"
        if self._last is not None:
            way = abs(width - self._last.width)
            elapsed = state.stamp - self._last.stamp
            if way > BEYOND + FASTER * limits.speed_max * (elapsed + self._supervision.lag):
                return f"reports a jump from {1e3 * self._last.width:.1f} to {1e3 * width:.1f} mm at once"
        return ""

    def _overdue(self, now: float) -> str:
        if now <= self._due:
            return ""
        return f"has not ended its move to {1e3 * self._target:.1f} mm within the expected time"

    def _stray(self, stamp: float, width: float, elapsed: float) -> str:
        """Return the problem of a width that violates the inequality of the class; else empty."""
        fading = 1.0 - min(elapsed / self._supervision.lag, 1.0) / 3.0
        self._opening = max(self._speed, self._opening * fading)
        self._closing = max(-self._speed, self._closing * fading)
        self._account(stamp)
        if stamp <= self._free_until:
            self._lower_bound = width
            self._upper_bound = width
            nearest = min(max(width, self._way[0]), self._way[1])
            late = self._supervision.lag * (self._opening if width > nearest else self._closing)
            return (
                self._astray(nearest, width)
                if abs(width - nearest) > self._supervision.stray + late
                else ""
            )
        self._lower_bound, self._upper_bound = (
            min(self._lower_bound, width),
            max(self._upper_bound, width),
        )
        stray = self._supervision.stray
        lag = self._supervision.lag
        if width - self._lower_bound > stray + lag * self._opening:
            return self._astray(self._lower_bound, width)
        return (
            self._astray(self._upper_bound, width)
            if self._upper_bound - width > stray + lag * self._closing
            else ""
        )

    def _lagging(self, width: float) -> str:
        """Return the problem of a width that does not follow the streamed speeds; else empty."""
        fastest = max(self._opening, self._closing)
        if (
            math.isinf(self._free_until)
            or abs(self._behind) <= self._supervision.follow + self._supervision.lag * fastest
        ):
            return ""
        way = "open" if self._behind > 0.0 else "close"
        return (
            f"was commanded to {way} by {1e3 * abs(self._behind):.0f} mm more than its width shows, which stays at "
            f"{1e3 * width:.1f} mm: the width is stuck, or something blocks the fingers"
        )

    def _astray(self, commanded: float, width: float) -> str:
        how = "opens" if width > commanded else "closes"
        way = f"{1e3 * commanded:.1f} → {1e3 * width:.1f} mm"
        if self._target <= width < commanded:
            return f"closes further: {way}; the object between the fingers is gone"
        return f"{how} without a command: {way}; it does not follow its commands, or something pushes the fingers"

    def _reach(self, least: float, most: float) -> tuple[float, float]:
        """Return an interval of openings, extended by the distance in which moving fingers come to rest [m]."""
        speed = 0.0 if self._last is None else self._last.speed
        coasting = abs(speed) * self._supervision.lag + speed * speed / (2.0 * self._acceleration)
        return (least, most + coasting) if speed > 0.0 else (least - coasting, most)

    def _account(self, now: float) -> None:
        """Integrate the streamed speed since the last call."""
        elapsed = max(now - self._told_at, 0.0) if math.isfinite(self._told_at) else 0.0
        self._told_at = max(self._told_at, now)
        self._behind += self._speed * elapsed
        opened = max(self._speed, 0.0) * elapsed
        closed = min(self._speed, 0.0) * elapsed
        self._lower_bound, self._upper_bound = (
            self._lower_bound + opened,
            self._upper_bound + closed,
        )
        self._way = self._way[0] + closed, self._way[1] + opened


class GripperMotion:
    """A move of the gripper that was started. Its driver reports the progress and the end."""

    def __init__(
        self,
        width: float,
        speed: float,
        start: float,
        stop: Callable[[GripperMotion], None],
        force: float = math.inf,
    ) -> None:
        """`force`: of one finger at most [N]."""
        self.width = width
        self.speed = speed
        self.force = force
        self.state = MotionState.RUNNING
        self.settled = False
        self.problem = ""
        self.measured = start
        self._start = start
        self._stop = stop

    @property
    def progress(self) -> float:
        way = abs(self.width - self._start)
        if way < 1e-9 or self.state is MotionState.DONE:
            return 1.0
        return min(max(1.0 - abs(self.width - self.measured) / way, 0.0), 1.0)

    @property
    def ended(self) -> bool:
        """Whether the outcome is known; the fingers may still come to rest."""
        return self.state not in (MotionState.RUNNING, MotionState.PAUSED)

    def stop(self) -> None:
        self._stop(self)

    def end(self, state: MotionState, problem: str = "") -> None:
        """Report the end; the first outcome counts."""
        if not self.ended:
            self.state = state
            self.problem = problem


def require_move(
    name: str, limits: GripperLimits, width: float, speed: float, force: float
) -> None:
    """Check the width [m], speed [m/s] and force [N] that a move asks of the gripper `name`.

    Raises MotionRefused: one lies outside the limits; a force above them is bounded by them.
    """
    if not limits.width_min - 1e-6 <= width <= limits.width_max + 1e-6:
        span = f"{1e3 * limits.width_min:.1f} … {1e3 * limits.width_max:.1f} mm"
        raise MotionRefused(name, f"an opening of {1e3 * width:.1f} mm lies outside {span}")
    if not 0.0 < speed <= limits.speed_max * (1.0 + 1e-6):
        raise MotionRefused(
            name, f"a speed of {speed:g} m/s lies outside 0 … {limits.speed_max:g} m/s"
        )
    if not max(limits.force_min, 1e-6) <= force * (1.0 + 1e-6):
        least = f"a finger presses with {limits.force_min:g} N at least"
        raise MotionRefused(name, f"a force of {force:g} N is too small: {least}")


def allowed_speed(speed: float, limits: GripperLimits, is_latched: bool) -> float:
    """Return a streamed speed within the limits [m/s]; 0 if it is not finite. Latched fingers do not open."""
    wanted = min(max(speed, -limits.speed_max), limits.speed_max) if math.isfinite(speed) else 0.0
    return min(wanted, 0.0) if is_latched else wanted
