"""Reference of the grasp force: a ramp to the initial force, then static plus dynamic term.

f_ref = margin * f_ns + f_nd (the paper's eq. slip_avoidance_control_law), through a 50 Hz low-pass. The static part
rises with the load and falls slowly. Two more parts act like the dynamic one, for moments only: the load's rise, since
it will have risen further when the fingers answer, and what the measured force lacks near the limit surface, since a
fruit that slides bears no more than its friction and its load alone would not tell how much is needed.
"""

from __future__ import annotations

import math

from skills.grip.settings import ForceLaw, GripSettings
from skills.grip.slip_sense import SlipSense

LOW_PASS = 1.0 / (2.0 * math.pi * 50.0)
"""Time constant of the reference [s]."""

EDGE, EDGE_GAIN = 0.95, 5.0
"""Where the least force is beyond this share of the measured one and noise, so many times the excess is added."""

LEAD = 1.5
"""So many times the rise of the least force beyond noise is added while it rises, and more where the load twists the
fruit: what it will be when the fingers answer, and no more, since they would have to be opened again."""

PIVOT_MARGIN, PIVOT_RATE = 1.25, 1.5
"""While pivoting: on the force that Coulomb's law needs for the weight alone, and how slowly it is let go to [N/s]."""

MOST_URGENT = 10.0
"""Bound of what is added to the static part [N]: enough for the fingers' full speed."""

URGENT_BASE, URGENT_SHARE = 1.0, 1.0
"""A light load is answered with less: this many newtons and this share of the least force."""

DOUBTFUL = 3.0
"""The bound once the sensor is not to be trusted [N]."""

CARRIED, CARRIED_AFTER, RISING = 0.25, 0.1, 0.05
"""A tangential load of so much [N] for so long [s], while the least force rises by less than this share beyond noise,
is a fruit that is carried: the initial force and the caution have done their work."""

RELAXING = 2.5
"""What the reference is too high by falls by this share a second [1/s], and at least at the relax rate."""

EXCESS, EXCESS_RELAXING, EXCESS_LAG = 1.2, 12.0, 0.15
"""What is beyond so many times the wanted force, averaged over the last [s], falls faster [1/s]: noise does not reach
that far."""

DOUBT = 2.0
"""So many standard deviations of the bias are covered too where friction is uncertain and the margin beyond the worst
one is slim: they weigh on light fruit."""

AVERAGED_OVER, LOWERED_OVER, BEYOND_BLUR = 0.3, 0.6, 2.0
"""A carried fruit's static part is averaged over the first [s] while it rises and over the second while it falls: when
a lift slows down the fruit seems lighter. What is beyond the average by more than so many standard deviations of noise
counts at once."""

CREEP_GAIN, CREEP_FAST, CREEP_SLOW, CREEP_NOISE = 6.0, 0.15, 0.6, 0.06
"""A moment whose share of the least force grows creeps: so many times what its average over the second [s] is beyond
the one over the third, and beyond the fourth, is added."""

LEAST_MARGIN = 1.06
"""Margin on top of the worst friction that is possible, where it is uncertain."""


class ForceReference:
    """The grasp force to track, and the law that chooses it.

    `pivoting` bears the weight only and leaves the moment alone, so that the fruit turns until it hangs plumb.
    `sliding` is a grasp force to keep whatever the load [N], or None.
    """

    def __init__(self, settings: GripSettings) -> None:
        self.f_ref = 0.0
        self.wanted = 0.0
        self.frozen = ""
        self.pivoting = False
        self.sliding: float | None = None
        self.know(settings)
        self._held = self._urgent = self._averaged = 0.0
        self._steady = self._share_fast = self._share_slow = math.nan
        self._loaded_for = 0.0
        self.carried = False

    def know(self, settings: GripSettings) -> None:
        """Take other settings."""
        self.settings = settings
        self._margin = max(settings.margin, LEAST_MARGIN * (1.0 + settings.mu_uncertainty))
        self._doubts = DOUBT if self._margin > settings.margin else 0.0

    @property
    def settled(self) -> bool:
        """Whether the held part has come down to what is wanted."""
        return self._held <= max(self.wanted, self.settings.floor) * 1.05

    def begin(self, f_n: float) -> None:
        """Start from the force that is there at contact."""
        self.f_ref = self._held = min(max(f_n, 0.0), self.settings.initial_force)

    def ramp(self, elapsed: float) -> float:
        """Rise towards the initial force."""
        self._held = min(self._held + self.settings.ramp_rate * elapsed, self.settings.initial_force)
        self.f_ref = self._held
        return self.f_ref

    def freeze(self, reason: str) -> None:
        """Never lower the reference again: the sensor is not to be trusted."""
        self.frozen = self.frozen or reason

    def follow(self, sense: SlipSense, f_n: float, elapsed: float) -> None:
        """Follow the law for `elapsed` seconds.

        Args:
            sense: loads after the newest sample.
            f_n: grasp force, what was commanded included [N].
            elapsed: since the last call [s].
        """
        s = self.settings
        if self.sliding is not None:
            self.wanted, self._urgent = self.sliding, 0.0
            lowest = self._held - self._fall(self.sliding) * elapsed
            self._held = self.f_ref = max(lowest, min(self.sliding, self._held + s.ramp_rate * elapsed))
            return
        if sense.f_t < CARRIED:
            self._loaded_for = 0.0
        elif sense.rise < RISING * sense.least + sense.unrest:
            self._loaded_for += elapsed
        self.wanted = (
            PIVOT_MARGIN * sense.coulomb if self.pivoting else self._average(self._static(sense), sense, elapsed)
        )
        needed = target = max(self.wanted, s.floor)
        if self._loaded_for < CARRIED_AFTER and not self.carried:
            target = max(target, s.initial_force)
        else:
            self.carried = True
        self._averaged += (1.0 - math.exp(-elapsed / EXCESS_LAG)) * (target - self._averaged)
        share = 1.0 - math.exp(-elapsed / LOW_PASS)
        if target >= self._held:
            loaded = self._held + share * (max(needed, self._held) - self._held)
            self._held = max(loaded, min(target, self._held + s.ramp_rate * elapsed))
        elif not self.frozen:
            self._held = max(target, self._held - self._fall(target) * elapsed)
        self._urgent += share * (self._answer(sense, f_n) - self._urgent)
        self.f_ref = min(self._held + self._urgent, s.loop.max_force)

    def _fall(self, target: float) -> float:
        """How fast the held part comes down to what is wanted [N/s]."""
        if self.pivoting:
            return PIVOT_RATE
        near = max(self.settings.relax_rate, RELAXING * (self._held - target))
        return near + EXCESS_RELAXING * max(self._held - EXCESS * max(target, self._averaged), 0.0)

    def _static(self, sense: SlipSense) -> float:
        s = self.settings
        if s.law is ForceLaw.CONSTANT:
            return s.initial_force
        if s.law is ForceLaw.COULOMB:
            return self._margin * sense.coulomb
        if s.law is ForceLaw.STATIC:
            return self._margin * sense.least
        return self._margin * (sense.reserved if self.carried else sense.cautious) + self._doubts * sense.doubt

    def _average(self, static: float, sense: SlipSense, elapsed: float) -> float:
        """The static part without the noise of light fruit [N]."""
        if self.settings.law is not ForceLaw.SLIP_AVOIDANCE or not self.carried:
            return static
        if math.isnan(self._steady):
            self._steady = static
        over = AVERAGED_OVER if static > self._steady else LOWERED_OVER
        self._steady += (1.0 - math.exp(-elapsed / over)) * (static - self._steady)
        creep = CREEP_GAIN * self._creep(sense, elapsed) * sense.coulomb
        return self._steady + max(static - self._steady - BEYOND_BLUR * self._margin * sense.blur, 0.0) + creep

    def _creep(self, sense: SlipSense, elapsed: float) -> float:
        """How fast the moment's share of the least force grows, beyond noise."""
        share = sense.least / max(sense.coulomb, 0.1)
        if math.isnan(self._share_fast):
            self._share_fast = self._share_slow = share
        self._share_fast += (1.0 - math.exp(-elapsed / CREEP_FAST)) * (share - self._share_fast)
        self._share_slow += (1.0 - math.exp(-elapsed / CREEP_SLOW)) * (share - self._share_slow)
        return max(self._share_fast - self._share_slow - CREEP_NOISE, 0.0)

    def _answer(self, sense: SlipSense, f_n: float) -> float:
        """What is added for a moment [N]."""
        if self.settings.law is not ForceLaw.SLIP_AVOIDANCE:
            return 0.0
        if self.pivoting:
            return min(EDGE_GAIN * max(sense.coulomb - EDGE * f_n, 0.0), MOST_URGENT)
        missing = max(sense.least - EDGE * f_n - sense.unrest, 0.0)
        coming = LEAD * (1.0 + sense.twist) * max(sense.rise - sense.unrest, 0.0)
        # What presses beyond the need already is not added again, but where the load twists: its moment is to come.
        spare = max(1.0 - sense.twist, 0.0) * max(f_n - self._margin * sense.least, 0.0)
        bound = DOUBTFUL if self.frozen else min(URGENT_BASE + URGENT_SHARE * sense.least, MOST_URGENT)
        return min(sense.f_nd + max(coming - spare, 0.0) + EDGE_GAIN * missing, bound)
