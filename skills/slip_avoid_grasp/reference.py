"""Reference of the grasp force: a ramp to the initial force, then static plus dynamic term; fast up, slow down.

f_ref = margin * f_ns + f_nd (the paper's eq. slip_avoidance_control_law), through a 50 Hz low-pass. Near the limit
surface the reference is raised beyond the measured force in proportion to what is missing: a fruit that already slides
bears no more than its friction, so its load alone would not tell how much is needed.
"""

from __future__ import annotations

import math

from skills.slip_avoid_grasp.settings import ForceLaw, GripSettings
from skills.slip_avoid_grasp.slip_sense import SlipSense

LOW_PASS = 1.0 / (2.0 * math.pi * 50.0)
"""Time constant of the reference [s]."""

EDGE, EDGE_GAIN = 0.95, 10.0
"""Where the least force is beyond this share of the measured one, so many times the excess is added."""

CARRIED, CARRIED_AFTER = 0.25, 0.3
"""A tangential load of so much [N] for so long [s] is a fruit that is carried: the initial force has done its work."""


class ForceReference:
    """The grasp force to track, and the law that chooses it."""

    def __init__(self, settings: GripSettings) -> None:
        self.settings = settings
        self.f_ref = 0.0
        self.wanted = 0.0
        self.frozen = ""
        self._margin = settings.margin * (1.0 + settings.mu_uncertainty)
        self._loaded_for = 0.0
        self._carried = False

    def begin(self, f_n: float) -> None:
        """Start from the force that is there at contact."""
        self.f_ref = min(max(f_n, 0.0), self.settings.initial_force)

    def ramp(self, elapsed: float) -> float:
        """Rise towards the initial force."""
        self.f_ref = min(self.f_ref + self.settings.ramp_rate * elapsed, self.settings.initial_force)
        return self.f_ref

    def freeze(self, reason: str) -> None:
        """Never lower the reference again: the sensor is not to be trusted."""
        self.frozen = self.frozen or reason

    def follow(self, sense: SlipSense, f_n: float, elapsed: float) -> None:
        """Follow the law for `elapsed` seconds.

        Args:
            sense: loads after the newest sample.
            f_n: measured grasp force [N].
            elapsed: since the last call [s].
        """
        s = self.settings
        self._loaded_for = self._loaded_for + elapsed if sense.f_t > CARRIED else 0.0
        self.wanted = self._law(sense, f_n)
        target = max(self.wanted, s.floor)
        if self._loaded_for < CARRIED_AFTER and not self._carried:
            target = max(target, s.initial_force)
        else:
            self._carried = True
        target = min(target, s.loop.max_force)
        if target >= self.f_ref:
            self.f_ref += (1.0 - math.exp(-elapsed / LOW_PASS)) * (target - self.f_ref)
        elif not self.frozen:
            self.f_ref = max(target, self.f_ref - s.relax_rate * elapsed)

    def _law(self, sense: SlipSense, f_n: float) -> float:
        s = self.settings
        if s.law is ForceLaw.CONSTANT:
            return s.initial_force
        if s.law is ForceLaw.COULOMB:
            return self._margin * sense.coulomb
        if s.law is ForceLaw.STATIC:
            return self._margin * sense.least
        missing = max(sense.least - EDGE * f_n, 0.0)
        return self._margin * sense.least + sense.f_nd + EDGE_GAIN * missing
