"""When a rate of the fingers is commanded: at most fifty times a second, and only when it says something new.

A gripper takes a new rate every 20 ms. A command that changes next to nothing keeps the next one, which may matter,
waiting for so long; so fingers at rest, and corrections of noise, wait until they must be told again.
"""

from __future__ import annotations

import math

from pomona.skills.grip.settings import CommandSettings


class CommandTiming:
    """Tells, sample by sample, whether a rate shall go out.

    Args:
        rate: of the samples [Hz].
        command_period: the gripper takes a new rate this often [s].
        settings: when it is given one.

    Attributes:
        every: samples between two rates at the closest.
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
        """Whether the next sample may bring a command."""
        return self._since + 1 >= self.every

    def pass_time(self, periods: int) -> bool:
        """Samples have come; whether the gripper would take a rate now."""
        self._since += periods
        return self._since >= self.every

    def goes_out(self, speed: float, before: float, holding: bool) -> bool:
        """Whether a rate goes out now, which the gripper would take.

        Args:
            speed, before: this rate of the opening and the one that was commanded last [m/s].
            holding: a fruit is in hand; before that every rate goes out.
        """
        trims = holding and abs(speed - before) < self._settings.trim
        waits_for = self._heartbeat if speed == before == 0.0 else self._keep_alive
        if trims and self._calm_for >= self._settings.calm_after and self._since < waits_for:
            return False
        self._calm_for = self._calm_for + self._since * self._period if trims else 0.0
        self._since = 0
        return True
