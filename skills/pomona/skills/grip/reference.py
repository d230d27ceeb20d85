"""Reference of the grasp force: a ramp to the initial force, then static plus dynamic term.

f_ref = margin * f_ns + f_nd (the paper's eq. slip_avoidance_control_law), through a 50 Hz low-pass. The static part
rises with the load and falls slowly. Two more parts act like the dynamic one, for moments only: the load's rise, since
it will have risen further when the fingers answer, and what the measured force lacks near the limit surface, since a
fruit that slides bears no more than its friction and its load alone would not tell how much is needed.
"""

from __future__ import annotations

import math

from pomona.skills.grip.limit_surface import least_force
from pomona.skills.grip.settings import ForceLaw, GripSettings
from pomona.skills.grip.slip_sense import SlipSense


class ForceReference:
    """The grasp force to track, and the law that chooses it.

    `wanted` is what the load needs by the law, `for_weight` what it would need without its moment, as gripped at its
    centre [N].
    `pivoting` bears the weight only and leaves the moment alone, so that the fruit turns until it hangs plumb.
    `sliding` is a grasp force to keep whatever the load [N], or None.
    """

    def __init__(self, settings: GripSettings) -> None:
        self.f_ref = 0.0
        self.wanted = self.for_weight = 0.0
        self.frozen = ""
        self.pivoting = False
        self.sliding: float | None = None
        self.set_friction(settings)
        self._held = self._urgent = self._averaged = self._caught = 0.0
        self._steady = self._share_fast = self._share_slow = math.nan
        self._loaded_for = 0.0
        self._limit = math.inf
        self.carried = False
        self._standing: tuple[float, float] | None = None

    def set_friction(self, settings: GripSettings) -> None:
        """Take settings with another friction."""
        self.settings, self._tuned = settings, settings.reference
        self._margin = max(settings.margin, self._tuned.least_margin * (1.0 + settings.mu_uncertainty))
        self._bias_stds = self._tuned.bias_stds if self._margin > settings.margin else 0.0
        load = 0.5 * settings.expected_load
        self._expected = 2.0 * float(least_force(load, load * settings.offset, settings.contact))

    @property
    def settled(self) -> bool:
        """Whether the held part has come down to what is wanted."""
        return self._held <= max(self.wanted, self.settings.floor) * 1.05

    @property
    def catching(self) -> bool:
        """Whether something has just hit the fruit."""
        return self._caught > self.settings.floor

    def begin(self, f_n: float) -> None:
        """Start from the force that is there at contact."""
        self.f_ref = self._held = min(max(f_n, 0.0), self.settings.initial_force)

    def ramp(self, elapsed: float) -> float:
        """Rise towards the initial force."""
        self._held = min(self._held + self.settings.ramp_rate * elapsed, self.settings.initial_force)
        self.f_ref = self._held
        return self.f_ref

    def stand(self, load: tuple[float, float]) -> None:
        """The fruit stands under a tangential load [N]: until that changes, it is none that the grip must bear."""
        self._standing = load

    def freeze(self, reason: str) -> None:
        """Never lower the reference again: the sensor is not to be trusted."""
        self.frozen = self.frozen or reason

    def distrust(self, reason: str) -> None:
        """Freeze, and rise no further than to a multiple of the force that has held until now."""
        if not math.isfinite(self._limit):
            self._limit = self._tuned.distrusted * max(self.f_ref, self.settings.floor)
        self.freeze(reason)

    def follow(self, sense: SlipSense, force_coming: float, elapsed: float) -> None:
        """Follow the law for `elapsed` seconds.

        Args:
            sense: loads after the newest sample.
            force_coming: both fingers' forces together once what was commanded has shown [N].
            elapsed: since the last call [s].
        """
        s, tuned = self.settings, self._tuned
        if self.sliding is not None:
            self.wanted, self._urgent = self.sliding, 0.0
            lowest = self._held - self._fall(self.sliding) * elapsed
            self._held = self.f_ref = max(lowest, min(self.sliding, self._held + tuned.sliding_rate * elapsed))
            return
        if self._standing is not None:
            f_x, f_y = sense.load
            if math.hypot(f_x - self._standing[0], f_y - self._standing[1]) < tuned.load_changed:
                self.wanted = s.initial_force
                self._held = self.f_ref = min(s.initial_force, self._held + s.ramp_rate * elapsed)
                return
            self._standing = None
        if sense.f_t < tuned.carried_load:
            self._loaded_for = 0.0
        elif sense.rise < tuned.carried_rise * sense.least + sense.normal_noise_band:
            self._loaded_for += elapsed
        self.wanted = (
            tuned.pivot_margin * sense.coulomb if self.pivoting else self._average(self._static(sense), sense, elapsed)
        )
        self.for_weight = self._margin * sense.coulomb
        needed = target = max(self.wanted, s.floor)
        if self._loaded_for < tuned.carried_after and not self.carried:
            target = max(target, s.initial_force)
        else:
            self.carried = True
        self._averaged += (1.0 - math.exp(-elapsed / tuned.excess_lag)) * (target - self._averaged)
        share = 1.0 - math.exp(-elapsed / tuned.low_pass)
        if target >= self._held:
            loaded = self._held + share * (max(needed, self._held) - self._held)
            self._held = min(max(loaded, min(target, self._held + s.ramp_rate * elapsed)), max(self._held, self._limit))
        elif not self.frozen:
            self._held = max(target, self._held - self._fall(target) * elapsed)
        self._urgent += share * (self._answer(sense, force_coming) - self._urgent)
        f_ref = max(self._held + self._urgent, self._catch(sense, elapsed))
        self.f_ref = min(f_ref, self._limit, s.loop.max_force)

    def _fall(self, target: float) -> float:
        """How fast the held part comes down to what is wanted [N/s]."""
        if self.pivoting:
            return self._tuned.pivot_rate
        near = max(self.settings.relax_rate, self._tuned.relaxing * (self._held - target))
        excess = self._held - self._tuned.excess * max(target, self._averaged)
        return near + self._tuned.excess_relaxing * max(excess, 0.0)

    def _static(self, sense: SlipSense) -> float:
        s = self.settings
        if s.law is ForceLaw.CONSTANT:
            return s.initial_force
        if s.law is ForceLaw.COULOMB:
            return self._margin * sense.coulomb
        if s.law is ForceLaw.STATIC:
            return self._margin * sense.least
        if not self.carried:
            return self._margin * sense.cautious + self._bias_stds * sense.bias_std
        reserve = sense.reserved - sense.least
        uncertain = 1.0 + s.mu_uncertainty
        return (
            self._margin * sense.least
            + self._tuned.reserve_margin * uncertain * reserve
            + self._bias_stds * sense.bias_std
        )

    def _average(self, static: float, sense: SlipSense, elapsed: float) -> float:
        """The static part without the noise of light fruit [N]."""
        if self.settings.law is not ForceLaw.SLIP_AVOIDANCE or not self.carried:
            return static
        if math.isnan(self._steady):
            self._steady = static
        tuned = self._tuned
        over = tuned.averaged_over if static > self._steady else tuned.lowered_over
        self._steady += (1.0 - math.exp(-elapsed / over)) * (static - self._steady)
        creep = tuned.creep_gain * self._creep(sense, elapsed) * sense.coulomb
        noise = tuned.averaged_stds * self._margin * sense.least_noise_std
        return self._steady + max(static - self._steady - noise, 0.0) + creep

    def _creep(self, sense: SlipSense, elapsed: float) -> float:
        """How fast the moment's share of the least force grows, beyond noise."""
        tuned = self._tuned
        share = sense.least / max(sense.coulomb, 0.1)
        if math.isnan(self._share_fast):
            self._share_fast = self._share_slow = share
        self._share_fast += (1.0 - math.exp(-elapsed / tuned.creep_fast)) * (share - self._share_fast)
        self._share_slow += (1.0 - math.exp(-elapsed / tuned.creep_slow)) * (share - self._share_slow)
        return max(self._share_fast - self._share_slow - tuned.creep_noise, 0.0)

    def _answer(self, sense: SlipSense, force_coming: float) -> float:
        """What is added for a moment [N]."""
        tuned = self._tuned
        if self.settings.law is not ForceLaw.SLIP_AVOIDANCE:
            return 0.0
        if self.pivoting:
            return min(tuned.edge_gain * max(sense.coulomb - tuned.edge * force_coming, 0.0), tuned.most_urgent)
        missing = max(sense.least - tuned.edge * force_coming - sense.normal_noise_band, 0.0)
        coming = tuned.lead * (1.0 + sense.twist) * max(sense.rise - sense.normal_noise_band, 0.0)
        if sense.f_t < self.settings.expected_load:
            coming = min(coming, max(self._expected - sense.least, 0.0))
        # What presses beyond the need already is not added again, but where the load twists: its moment is to come.
        spare = max(1.0 - sense.twist, 0.0) * max(force_coming - self._margin * sense.least, 0.0)
        if self.frozen:
            bound = tuned.doubtful
        else:
            bound = min(tuned.urgent_base + tuned.urgent_share * sense.least, tuned.most_urgent)
        return min(sense.f_nd + max(coming - spare, 0.0) + tuned.edge_gain * missing, bound)

    def _catch(self, sense: SlipSense, elapsed: float) -> float:
        """The force with which a carried fruit that something has hit is caught [N].

        One that slides shows no more of the push than friction bears, so more is pressed than its load needs, and as
        long as it slides the more the longer. That is not let go before the push has passed.
        """
        tuned = self._tuned
        if self.frozen or self.settings.law is not ForceLaw.SLIP_AVOIDANCE:
            return 0.0
        if sense.hit > 0.0 and sense.least > tuned.slides * sense.f_n:
            more = min(tuned.hit * sense.hit / self.settings.contact.mu, tuned.most_urgent)
            self._caught = max(self._caught, sense.f_n + more)
        elif sense.hit == 0.0:
            self._caught -= min(tuned.excess_relaxing * elapsed, 1.0) * self._caught
        return self._caught
