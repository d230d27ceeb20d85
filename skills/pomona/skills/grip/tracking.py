"""Tracking of the reference by the fingers: at once where it rises, at rest within noise."""

from __future__ import annotations

import math
from dataclasses import replace

from pomona.skills.grip.force_loop import ForceLoopSettings, finger_speed
from pomona.skills.grip.settings import TrackingSettings


class ForceTracker:
    """The force loop with its memory: the last commanded reference, and whether the fingers are correcting."""

    def __init__(self, loop: ForceLoopSettings, settings: TrackingSettings = TrackingSettings()) -> None:
        self._loop, self._settings = loop, settings
        self._calm_loop = replace(loop, gain=min(settings.calm_gain, loop.gain))
        self._f_ref_commanded = 0.0
        self._correcting = 0.0
        self._moving = 0.0

    def expected(self, speed: float, f_n: float, period: float, periods: int = 1) -> float:
        """Return the change of the grip force by the fingers' own motion in each period since the last call [N].

        Args:
            speed: last commanded rate of the opening [m/s]; the fingers reach it within the loop's lag.
            f_n: grip force [N], for pads that stiffen.
            period: between two samples [s].
            periods: since the last call.
        """
        self._moving += (1.0 - math.exp(-periods * period / self._loop.lag)) * (speed - self._moving)
        moving = min(max(self._moving, -self._settings.foreseen), self._settings.foreseen)
        return -moving * self._loop.stiffness.slope(f_n) * period

    @property
    def moving(self) -> float:
        """Rate of the opening by the command and the fingers' lag [m/s]."""
        return self._moving

    def commanded(self, f_ref: float) -> None:
        """Take the reference for which a speed was commanded [N]."""
        self._f_ref_commanded = f_ref

    def on_ramp(self, f_ref: float, f_n: float, speed_before: float) -> float:
        """Return the rate of the opening [m/s] that tracks a rising reference [N]."""
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
        """Return the rate of the opening while holding [m/s]; 0.0 while the error of the force is within noise.

        Args:
            f_ref, f_n: reference and measured grip force [N].
            speed_before: last commanded rate [m/s].
            noise_band: of the measured force [N].
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
        """Return True when the fingers rest; a correction begins beyond the band and ends at its middle."""
        settings = self._settings
        near = settings.near * f_ref + noise_band * (settings.too_much if error < 0.0 else settings.too_little)
        if self._correcting * error <= 0.0:
            self._correcting = 0.0 if abs(error) < near else math.copysign(1.0, error)
        return self._correcting == 0.0
