"""Tracking a reference through the force loop: at once where it rises, at rest where only noise moves it."""

from __future__ import annotations

import math
from dataclasses import replace

from skills.grip.force_loop import COMMAND_PERIOD, ForceLoopSettings, finger_speed

QUIET_RATE = 5.0
"""While holding, changes of the reference up to this are left to the loop's gain [N/s]: noise is not fed forward."""

NEAR = 0.015
"""While holding, the fingers rest within this share of the reference and noise: shaking makes fruit creep, and resting
keeps the next command free."""

CALM, CALM_GAIN = 4.0, 3.0
"""Errors within so many times noise are corrected with this gain [1/s]: their measurement is slow, and a larger one
makes the fingers swing."""

FORESEEN = 0.012
"""Faster motion than this is not relied upon before it shows [m/s]: fingers may be held up."""

TOO_MUCH, TOO_LITTLE = 0.6, 0.35
"""Of noise, so much is allowed where the force is too large, and where it is too small."""


class ForceTracker:
    """The force loop with memory: what was commanded last, and whether the fingers are correcting or resting."""

    def __init__(self, loop: ForceLoopSettings) -> None:
        self._loop = loop
        self._calm_loop = replace(loop, gain=min(CALM_GAIN, loop.gain))
        self._f_ref_commanded = 0.0
        self._correcting = 0.0
        self._moving = 0.0

    def expected(self, speed: float, f_n: float, period: float, periods: int = 1) -> float:
        """How much the fingers' own motion changes the grasp force in each of the periods that have passed [N].

        Args:
            speed: rate of the opening that was commanded last [m/s]; the fingers get there within the loop's lag.
            f_n: grasp force [N], where pads stiffen with it.
            period: [s]; `periods` of them have passed since the last call.
        """
        self._moving += (1.0 - math.exp(-periods * period / self._loop.lag)) * (speed - self._moving)
        moving = min(max(self._moving, -FORESEEN), FORESEEN)
        return -moving * self._loop.stiffness.slope(f_n) * period

    def commanded(self, f_ref: float) -> None:
        """A speed was commanded for this reference [N]."""
        self._f_ref_commanded = f_ref

    def on_ramp(self, f_ref: float, f_n: float, speed_before: float) -> float:
        """Rate of the opening [m/s] that tracks a rising reference [N]."""
        rate = (f_ref - self._f_ref_commanded) / COMMAND_PERIOD
        return finger_speed(f_ref, rate, f_n, self._loop, speed_before)

    def while_holding(self, f_ref: float, f_n: float, speed_before: float, unrest: float, hurry: float) -> float:
        """Rate of the opening [m/s] while holding; 0.0 while the force is where it should be but for noise.

        Args:
            f_ref, f_n: reference and measured grasp force [N].
            speed_before: what was commanded before [m/s].
            unrest: how far noise carries the measured force [N].
            hurry: as in `finger_speed`.
        """
        rate = (f_ref - self._f_ref_commanded) / COMMAND_PERIOD
        rate -= min(max(rate, -QUIET_RATE), QUIET_RATE)
        if rate == 0.0 and self._rests(f_ref, f_ref - f_n, unrest):
            return 0.0
        calm = abs(f_ref - f_n) < CALM * unrest
        return finger_speed(f_ref, rate, f_n, self._calm_loop if calm else self._loop, speed_before, hurry)

    def _rests(self, f_ref: float, error: float, unrest: float) -> bool:
        """Whether the fingers rest: until the force has strayed beyond noise, then until it is back."""
        near = NEAR * f_ref + unrest * (TOO_MUCH if error < 0.0 else TOO_LITTLE)
        if self._correcting * error <= 0.0:
            self._correcting = 0.0 if abs(error) < near else math.copysign(1.0, error)
        return self._correcting == 0.0
