"""Tracking a reference through the force loop: at once where it rises, at rest where only noise moves it."""

from __future__ import annotations

import math
from dataclasses import replace

from pomona.skills.grip.force_loop import ForceLoopSettings, finger_speed
from pomona.skills.grip.settings import TrackingSettings


class ForceTracker:
    """The force loop with memory: what was commanded last, and whether the fingers are correcting or resting."""

    def __init__(self, loop: ForceLoopSettings, settings: TrackingSettings = TrackingSettings()) -> None:
        self._loop, self._settings = loop, settings
        self._calm_loop = replace(loop, gain=min(settings.calm_gain, loop.gain))
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
        moving = min(max(self._moving, -self._settings.foreseen), self._settings.foreseen)
        return -moving * self._loop.stiffness.slope(f_n) * period

    @property
    def moving(self) -> float:
        """Rate of the opening that the fingers have by now [m/s], as commanded and after their lag."""
        return self._moving

    def commanded(self, f_ref: float) -> None:
        """A speed was commanded for this reference [N]."""
        self._f_ref_commanded = f_ref

    def on_ramp(self, f_ref: float, f_n: float, speed_before: float) -> float:
        """Rate of the opening [m/s] that tracks a rising reference [N]."""
        rate = (f_ref - self._f_ref_commanded) / self._loop.command_period
        return finger_speed(f_ref, rate, f_n, self._loop, speed_before)

    def while_holding(
        self,
        f_ref: float,
        f_n: float,
        speed_before: float,
        noise_band: float,
        error_feedthrough: float,
        hardest: float = 0.0,
    ) -> float:
        """Rate of the opening [m/s] while holding; 0.0 while the force is where it should be but for noise.

        Args:
            f_ref, f_n: reference and measured grasp force [N].
            speed_before: what was commanded before [m/s].
            noise_band: how far noise carries the measured force [N].
            error_feedthrough, hardest: as in `finger_speed`.
        """
        rate = (f_ref - self._f_ref_commanded) / self._loop.command_period
        quiet = self._settings.quiet_rate
        rate -= min(max(rate, -quiet), quiet)
        if rate == 0.0 and self._rests(f_ref, f_ref - f_n, noise_band):
            return 0.0
        calm = abs(f_ref - f_n) < self._settings.calm * noise_band
        loop = self._calm_loop if calm else self._loop
        return finger_speed(f_ref, rate, f_n, loop, speed_before, error_feedthrough, hardest)

    def _rests(self, f_ref: float, error: float, noise_band: float) -> bool:
        """Whether the fingers rest: until the force has strayed beyond noise, then until it is back."""
        settings = self._settings
        near = settings.near * f_ref + noise_band * (settings.too_much if error < 0.0 else settings.too_little)
        if self._correcting * error <= 0.0:
            self._correcting = 0.0 if abs(error) < near else math.copysign(1.0, error)
        return self._correcting == 0.0
