"""Commands of the fingers: the speed that tracks the reference of the grip force, and when it is commanded.

    v = -(c (f_ref - f) + d/dt f_ref) / s,   s: stiffness of both pads in series

The position of the fingers integrates the speed, so a
constant reference is reached without droop. The rate of the reference is fed forward, so a rising one is tracked
without lag; the gain then acts on the error before the rise, which would else be corrected twice.

A gripper takes a new rate every 20 ms. A superfluous command delays an important one by that time. Rest and small
corrections are therefore repeated only as often as the driver's watchdog needs.
"""

from __future__ import annotations

import math
from dataclasses import replace

from pomona.skills.grip.settings import (
    CommandSettings,
    ForceLoopSettings,
    TrackingSettings,
)


def finger_speed(
    f_ref: float,
    f_ref_rate: float,
    f_n: float,
    settings: ForceLoopSettings,
    speed_before: float = 0.0,
    error_feedthrough: float = 1.0,
    hardest: float = 0.0,
) -> float:
    """Return the rate of the opening to command [m/s]; negative closes.

    The rate keeps the force within the limit until the next command. It is 0.0 for input that is not finite, and where
    a force of more than twice the limit would be raised further.

    Args:
        f_ref, f_ref_rate: reference of the grip force [N] and its rate [N/s].
        f_n: measured grip force [N].
        settings: gain and limits.
        speed_before: last commanded rate [m/s].
        error_feedthrough: 0 … 1; with 1 the gain acts on the whole error although its rise is fed forward, which
            overshoots.
        hardest: twice the stronger finger's force [N]: it stays within the limit, too.
    """
    if not all(map(math.isfinite, (f_ref, f_ref_rate, f_n, hardest))):
        return 0.0
    f_n = abs(f_n)
    if f_n > 2.0 * settings.max_force and f_ref > f_n:
        return 0.0
    if f_n > settings.max_force or f_ref > settings.max_force:
        f_ref = min(f_ref, settings.max_force)
        f_ref_rate = min(f_ref_rate, 0.0)
    # The rise of the reference is fed forward: the gain acts on the error before it.
    before = f_ref - (1.0 - error_feedthrough) * f_ref_rate * settings.command_period
    coming = speed_before * settings.lag
    error = (before - f_n) / settings.stiffness + coming
    closing = settings.gain * error + f_ref_rate / settings.stiffness
    left = (settings.max_force - max(f_n, hardest)) / settings.stiffness + coming
    fastest = min(settings.closing_speed, max(left, 0.0) / settings.command_period)
    return min(max(-closing, -fastest), settings.opening_speed)


class ForceTracker:
    """The force loop with its memory: the last commanded reference, and whether the fingers are correcting."""

    def __init__(
        self, loop: ForceLoopSettings, settings: TrackingSettings = TrackingSettings()
    ) -> None:
        self._loop = loop
        self._settings = settings
        self._calm_loop = replace(loop, gain=min(settings.calm_gain, loop.gain))
        self._f_ref_commanded = 0.0
        self._correcting = 0.0
        self._moving = 0.0

    def expected(self, speed: float, period: float, periods: int = 1) -> float:
        """Return the change of the grip force by the fingers' own motion in each period since the last call [N].

        Args:
            speed: last commanded rate of the opening [m/s]; the fingers reach it within the loop's lag.
            period: between two samples [s].
            periods: since the last call.
        """
        self._moving += (1.0 - math.exp(-periods * period / self._loop.lag)) * (
            speed - self._moving
        )
        moving = min(max(self._moving, -self._settings.foreseen), self._settings.foreseen)
        return -moving * self._loop.stiffness * period

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
        """Return True within a band, to whose middle a correction goes; a step opens by less than an excess."""
        settings = self._settings
        one_step = self._loop.step * self._loop.stiffness
        band = (
            max(noise_band * settings.too_much, one_step)
            if error < 0.0
            else noise_band * settings.too_little
        )
        near = settings.near * f_ref + band
        if self._correcting * error <= 0.0:
            self._correcting = 0.0 if abs(error) < near else math.copysign(1.0, error)
        return self._correcting == 0.0


class CommandTiming:
    """Decides, sample by sample, whether a rate is commanded.

    Args:
        rate: of the samples [Hz].
        command_period: shortest time between two rates [s].

    Attributes:
        every: smallest number of samples between two rates.
        interval: the same [s].
    """

    def __init__(
        self,
        rate: float,
        command_period: float = 0.02,
        settings: CommandSettings = CommandSettings(),
    ) -> None:
        self._settings = settings
        self._period = 1.0 / rate
        self.every = math.ceil(command_period * rate - 1e-6)
        self.interval = self.every * self._period
        self._keep_alive, self._heartbeat = (
            round(settings.keep_alive * rate),
            round(settings.heartbeat * rate),
        )
        self._since = self._heartbeat
        self._calm_for = 0.0

    @property
    def near(self) -> bool:
        """True when the next sample may bring a command."""
        return self._since + 1 >= self.every

    def pass_time(self, periods: int) -> bool:
        """Count samples, and return True when the gripper would take a rate now."""
        self._since += periods
        return self._since >= self.every

    def goes_out(self, speed: float, before: float, holding: bool) -> bool:
        """Return True when a rate is to be commanded now.

        Args:
            speed, before: this rate of the opening and the last commanded one [m/s].
            holding: a fruit is in hand; before, every rate is commanded.
        """
        trims = holding and abs(speed - before) < self._settings.trim
        waits_for = self._heartbeat if speed == before == 0.0 else self._keep_alive
        if trims and self._calm_for >= self._settings.calm_after and self._since < waits_for:
            return False
        self._calm_for = self._calm_for + self._since * self._period if trims else 0.0
        self._since = 0
        return True
