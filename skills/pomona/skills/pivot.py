"""Pivot: let a held fruit turn in the fingers under gravity until it hangs plumb, without letting it slide down."""

from __future__ import annotations

from collections.abc import Generator
from typing import Annotated

from pomona.drivers.interfaces import Gripper
from pomona.executive.ports import LENGTH, TIME, Length, Port, Time
from pomona.executive.skill import Skill, Work
from pomona.skills.grip.hold import Hold
from pomona.skills.shared.grip_view import show_grip

STEADY = 0.3
"""The fruit hangs still when its lever has not changed for so long [s]."""

STILL = 0.0005
"""A lever that changes by less than this is still [m]."""


class Pivot(Skill):
    """The controller's second mode. Its force bears the weight only; friction against turning brakes the fruit.

    The fruit's lever is its moment over its weight: how far its centre hangs beside the fingers. When the node ends or
    is interrupted the fruit is held against turning again.
    """

    devices = (Gripper,)
    failures = (
        "NOT_HELD",
        "NOT_PLUMB",
        "LOST",
        "ONE_FINGER",
        "FORCE_LIMIT",
        "SENSOR_STALE",
        "SENSOR_SATURATED",
        "SENSOR_FAULT",
        "SLIPPED",
    )

    def run(
        self,
        hold: Hold,
        plumb: Annotated[
            Length, Port(min="0.5 mm", help="how far the fruit's centre may hang off the vertical through the fingers")
        ] = LENGTH("4 mm"),
        patience: Annotated[Time, Port(min="0.5 s", help="how long it may take")] = TIME("8 s"),
    ) -> Work[None]:
        if not hold.holds:
            raise self.failure("NOT_HELD", "no fruit is held that could pivot")
        hold = hold.under(self.device(Gripper))
        hold.pivot(True)
        try:
            lever = yield from self._turn(hold, patience)
        finally:
            hold.pivot(False)
        show_grip(self, hold, everything=True)
        if lever > plumb:
            message = f"the fruit stopped turning with its centre {1e3 * lever:.1f} mm off the vertical"
            raise self.failure("NOT_PLUMB", message, lever_m=lever)
        return None

    def _turn(self, hold: Hold, patience: float) -> Generator[str | None, None, float]:
        """Watch until the force is down and the fruit hangs still; the lever that is left [m]."""
        start = since = self.context.elapsed()
        before = lever_of(hold)
        while self.context.elapsed() - start < patience:
            problem = hold.problem
            if problem is not None:
                raise self.failure(problem.code, problem.message, **problem.data)
            lever, now = lever_of(hold), self.context.elapsed()
            if abs(lever - before) > STILL or not hold.has_settled:
                before, since = lever, now
            if now - since > STEADY:
                return lever
            show_grip(self, hold)
            yield f"turning: {1e3 * lever:.1f} mm off the vertical, {hold.reading.f_n:.1f} N"
        return lever_of(hold)


def lever_of(hold: Hold) -> float:
    """How far the centre of a held fruit hangs beside the fingers [m]."""
    reading = hold.reading
    return abs(reading.tau_n) / max(reading.f_t, 0.1)
