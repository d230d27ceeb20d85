"""Times of the commands to the fingers: at most fifty a second, and none that changes next to nothing.

A gripper takes a new rate every 20 ms. A superfluous command delays an important one by that time. Rest and small
corrections are therefore repeated only as often as the driver's watchdog needs.
"""

from __future__ import annotations

import math

from pomona.skills.grip.settings import CommandSettings


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
        self, rate: float, command_period: float = 0.02, settings: CommandSettings = CommandSettings()
    ) -> None:
        self._settings = settings
        self._period = 1.0 / rate
        self.every = math.ceil(command_period * rate - 1e-6)
        self.interval = self.every * self._period
        self._keep_alive, self._heartbeat = round(settings.keep_alive * rate), round(settings.heartbeat * rate)
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
