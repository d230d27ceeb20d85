"""The skill Pivot."""

from __future__ import annotations

from typing import Annotated

from pomona.drivers.interfaces import Gripper
from pomona.executive.ports import TIME, Port, Time
from pomona.executive.skill import Work
from pomona.skills.grip.hold import Hold
from pomona.skills.shared.following import MovingSkill
from pomona.skills.shared.held_fruit import show_grip, watch_grip
from pomona.skills.shared.live_watch import WATCH_FAILURES, LiveWatch, watched

# largest distance of the fruit's centre from the vertical through the fingers [m]
PLUMB = 0.004


class Pivot(MovingSkill):
    """Let a held fruit turn in the fingers under gravity until it hangs plumb.

    The force bears the weight only, and friction brakes the turning. The lever of the fruit, moment over weight, is the
    distance of its centre from the vertical through the fingers. After the node the fruit is held against turning.
    """

    devices = (Gripper,)
    failures = (
        *WATCH_FAILURES,
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
        patience: Annotated[Time, Port(min="0.5 s", help="maximum time")] = TIME("8 s"),
    ) -> Work[None]:
        if not hold.holds:
            raise self.failure("NOT_HELD", "no fruit is held that could pivot")
        eyes = yield from watched(self)
        hold = hold.under(self.device(Gripper))
        hold.pivot(True)
        try:
            lever = yield from self._turn(hold, patience, eyes)
        finally:
            hold.pivot(False)
        show_grip(self, hold, everything=True)
        if lever > PLUMB:
            message = (
                f"the fruit stopped turning with its centre {1e3 * lever:.1f} mm off the vertical"
            )
            raise self.failure("NOT_PLUMB", message, lever_m=lever)

    def _turn(self, hold: Hold, patience: float, eyes: LiveWatch | None) -> Work[float]:
        """Wait until the force is down and the fruit hangs still; return its lever [m]."""
        start = since = self.context.elapsed()
        before = lever_of(hold)
        while self.context.elapsed() - start < patience:
            watch_grip(self, hold)
            if eyes is not None:
                eyes.look()
            lever = lever_of(hold)
            now = self.context.elapsed()
            if (
                abs(lever - before) > 0.0005 or not hold.has_settled
            ):  # smallest change of the lever [m]
                before = lever
                since = now
            if (
                now - since > 0.3
            ):  # time without a change of the lever after which the fruit hangs still [s]
                return lever
            yield f"turning: {1e3 * lever:.1f} mm off the vertical, {hold.reading.f_n:.1f} N"
        return lever_of(hold)


def lever_of(hold: Hold) -> float:
    """Return the distance of a held fruit's centre from the vertical through the fingers [m]."""
    reading = hold.reading
    return abs(reading.tau_n) / max(reading.f_t, 0.1)
