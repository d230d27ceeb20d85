"""What the fingers say about the grasp: loads, the least force that holds them, and the estimated slip."""

from __future__ import annotations

import math

import numpy as np

from pomona.executive.values.arrays import Float64
from pomona.skills.grip.dynamic_term import DynamicSettings
from pomona.skills.grip.limit_surface import SoftContact, surface_table
from pomona.skills.grip.observer import ObserverSettings, steps_in_a_sample
from pomona.skills.grip.pads import MIRROR
from pomona.skills.grip.slip_kernel import (
    NO_LOADS,
    REST,
    Contact,
    Filters,
    Loads,
    Observer,
    Shares,
    Unknown,
    sense_sample,
)
from pomona.skills.grip.tuning import FilterSettings


class SlipSense:
    """Senses loads and slip, sample by sample. Usable alone: `calibrate_bias`, then `advance` with raw wrenches.

    Attributes:
        loads: what the newest sample says; the properties below are the ones that are asked for most.
        f_n: grasp force, twice the smaller finger's, freed of what noise puts between them [N].
        tau_n: torsional moment on both fingers together [N·m].
        carries: told by who steps it: the fruit hangs in the fingers, and a load that grows fast is a push.
        one_sided_press: one finger's normal force has just changed alone: the larger one counts in `f_n` meanwhile.
    """

    def __init__(
        self,
        contact: SoftContact,
        observer: ObserverSettings,
        dynamic: DynamicSettings,
        rate: float = 500.0,
        offset: float = 0.0,
        reserve: float = 0.0,
        filters: FilterSettings | None = None,
    ) -> None:
        """Make one at rest.

        Args:
            contact: friction of pad and fruit.
            observer, dynamic, filters: constants.
            rate: of the samples [Hz].
            offset: lever of the fruit's centre that `cautious` allows for [m].
            reserve: tangential push that `cautious` and `reserved` allow for [N].
        """
        self._settings = filters or FilterSettings()
        self._unknown = Unknown(
            offset, reserve, offset, self._settings.farthest_centre, self._settings.quiet, self._settings.aside
        )
        self.set_friction(contact)
        substeps = steps_in_a_sample(rate)
        self._observer = Observer(
            observer.sigma0, observer.beta, observer.inertia, observer.mass, observer.offset, observer.gain,
            dynamic.kp, dynamic.ki, dynamic.kdc, dynamic.bound, substeps, 1.0 / rate / substeps,
        )  # fmt: skip
        fast, normal, load, centre, self._rise_share = (
            1.0 - math.exp(-1.0 / (rate * lag))
            for lag in (
                self._settings.fast_lag, self._settings.normal_lag, self._settings.load_lag,
                self._settings.centre_lag, self._settings.rise_lag,
            )
        )  # fmt: skip
        self._shares = Shares(fast, normal, load, centre)
        bias, band, fast_state, slow_state, smoothed = (np.zeros((2, 6)) for _ in range(5))
        self._filters = Filters(bias, band, fast_state, slow_state, smoothed, np.zeros(6))
        self._state = REST
        self.loads: Loads = NO_LOADS
        self.one_sided_press = self.carries = False
        self.f_n = self.tau_n = 0.0
        self._calm_share = 1.0 - math.exp(-1.0 / (rate * self._settings.calm_lag))
        self._f_t_before = self._f_t_calm = self._tau_calm = self._pushed_for = 0.0
        self._period = 1.0 / rate
        self._least_before = self._normal_noise_band = self._bias_std = self._difference_variance = 0.0

    def set_friction(self, contact: SoftContact) -> None:
        """Take another friction from the next sample on."""
        table = surface_table(contact)
        self._contact = Contact(
            float(contact.mu), contact.torsion, contact.gamma, contact.delta, contact.ellipsoid,
            table.f, table.tau, table.load,
        )  # fmt: skip

    @property
    def bias(self) -> Float64:
        """What the fingers show with nothing between them, shape (2, 6) [N, N·m]."""
        return self._filters.bias.copy()

    @property
    def raw_bias(self) -> Float64:
        """`bias` itself, shape (2, 6) [N, N·m]: not to be changed."""
        return self._filters.bias

    @property
    def tau_noise_std(self) -> float:
        """Standard deviation of what noise alone puts on `tau_n` [N·m]."""
        variance, loads = self._filters.variance, self.loads
        lever = loads.f_t / max(loads.left + loads.right, 0.4)
        return math.sqrt(2.0 * (variance[5] + lever * lever * variance[4]))

    @property
    def finger_forces(self) -> tuple[float, float]:
        """Pressing force of the left and the right finger [N]."""
        return self.loads.left, self.loads.right

    @property
    def force_sum(self) -> float:
        """Both fingers' pressing forces together [N]; beyond `f_n` where a drifting sensor sets them apart."""
        return self.loads.left + self.loads.right

    @property
    def least(self) -> float:
        """The least grasp force that holds the load, without margin [N]."""
        return self.loads.least

    @property
    def coulomb(self) -> float:
        """The same by Coulomb's law, as if there were no moment [N]."""
        return self.loads.coulomb

    @property
    def f_t(self) -> float:
        """Tangential force of both fingers together [N]."""
        return self.loads.f_t

    @property
    def load(self) -> tuple[float, float]:
        """That force in the left pad's frame, along x and y [N]."""
        smoothed = self._filters.smoothed
        return float(smoothed[0, 0] + smoothed[1, 0]), float(smoothed[0, 1] + smoothed[1, 1])

    @property
    def f_nd(self) -> float:
        """Dynamic term [N]."""
        return self.loads.f_nd

    @property
    def omega(self) -> float:
        """Estimated slip velocity [rad/s]."""
        return self._state.omega

    @property
    def centre(self) -> float:
        """Distance of the centre of rotation from the contact [m]."""
        return self._state.centre

    @property
    def rise(self) -> float:
        """How much the least force has risen just now [N]; negative while it falls."""
        return self.loads.least - self._least_before

    @property
    def hit(self) -> float:
        """How much the tangential force has just grown [N], beyond noise and what a lift does: something hit the fruit.

        A fruit that slides bears no more than friction gives, so this is the least that came.
        """
        if not self.carries:
            return 0.0
        noise = self._settings.hit_stds * math.sqrt(float(self._filters.variance[0] + self._filters.variance[1]))
        return max(self.loads.f_t - (1.0 + self._settings.hit_share) * self._f_t_before - noise, 0.0)

    @property
    def twist(self) -> float:
        """How much more force the moment asks for than the weight alone, as a share of that; 0 … `twist_bound`."""
        return min(max(self.loads.least / max(self.loads.coulomb, 0.1) - 1.0, 0.0), self._settings.twist_bound)

    @property
    def one_sided_jump(self) -> bool:
        """Whether one finger's tangential force has just jumped and the other's has not: no fruit does that."""
        return self.loads.one_sided_jump > self._settings.jump

    @property
    def jump_of_one_finger(self) -> float:
        """How far a force of one finger alone has just jumped beyond noise [N]."""
        return max(self.loads.one_sided_jump, self.loads.one_sided_press_jump)

    @property
    def reserved(self) -> float:
        """The least force for the measured load and a push of the reserve on the same lever [N]."""
        return self.loads.reserved

    @property
    def cautious(self) -> float:
        """The least force if the fruit's centre lay `offset` off the grasp axis, or as measured if that is more [N]."""
        return self.loads.cautious

    @property
    def least_noise_std(self) -> float:
        """Standard deviation of what noise alone puts on the least force [N]."""
        return self.loads.least_noise_std

    @property
    def normal_noise_band(self) -> float:
        """How far noise alone carries the measured grasp force from the true one, twice its standard deviation [N]."""
        return self._normal_noise_band

    @property
    def bias_std(self) -> float:
        """Standard deviation of the error that the bias, itself a mean of noise, puts on the least force [N]."""
        return self._bias_std

    def calibrate_bias(self, samples: Float64) -> None:
        """Take the bias, and how noisy the fingers are, from samples with nothing touching, shape (n, 2, 6)."""
        filters, shares = self._filters, self._shares
        filters.bias[:] = samples.mean(axis=0)
        right = MIRROR * samples[:, 1]
        modes = 0.5 * np.stack([samples[:, 0] + right, samples[:, 0] - right], axis=1)
        fast_std = math.sqrt(shares.fast / (2.0 - shares.fast))
        filters.noise_band[:] = self._settings.noise_share * modes.std(axis=0) * fast_std
        filters.variance[:] = modes.var(axis=0).sum(axis=0) * shares.load / (2.0 - shares.load)
        apart = float(modes[:, 1, 2].var()) * shares.normal / (2.0 - shares.normal)
        self._difference_variance = 4.0 * apart
        of_mean = samples.var(axis=0).sum(axis=0) / len(samples)
        self._bias_std = math.sqrt(float(of_mean[2] + 0.5 * (of_mean[0] + of_mean[1]) / self._contact.mu**2))
        self._normal_noise_band = 4.0 * math.sqrt(
            float(modes[:, :, 2].var(axis=0).sum()) * shares.normal / (2.0 - shares.normal)
        )
        for array in (filters.fast, filters.slow, filters.smoothed):
            array[:] = 0.0
        self._state = REST

    def start_observer(self) -> None:
        """Start the observer at rest under the load that the next sample shows."""
        self._state = self._state._replace(started=False)

    def advance(self, raw: Float64, periods: int = 1, expected: float = 0.0) -> None:
        """Take one raw sample, shape (2, 6), that stands for so many periods.

        In each of them the fingers' own motion is expected to change the grasp force by `expected` [N].
        """
        self.loads, self._state = sense_sample(
            raw, periods, expected, self._filters, self._shares, self._contact, self._left_unknown(), self._observer,
            self._state,
        )  # fmt: skip
        loads = self.loads
        self._f_t_before += min(periods * self._rise_share, 1.0) * (loads.f_t - self._f_t_before)
        self._tell_push_from_load(periods)
        self.one_sided_press = loads.one_sided_press > self._settings.jump
        difference = math.sqrt(max((loads.left - loads.right) ** 2 - self._difference_variance, 0.0))
        self.f_n = max(loads.left + loads.right + (difference if self.one_sided_press else -difference), 0.0)
        self.tau_n = loads.tau_left + loads.tau_right
        self._least_before += min(periods * self._rise_share, 1.0) * (loads.least - self._least_before)

    def _tell_push_from_load(self, periods: int) -> None:
        """Average the load while nothing pushes; a push ends when the load is back, or counts as load in the end."""
        loads, s = self.loads, self._settings
        if self.hit > 0.0:
            self._pushed_for = s.longest_push
        elif loads.f_t < (1.0 + s.hit_share) * self._f_t_calm:
            self._pushed_for = 0.0
        if self._pushed_for > 0.0:
            self._pushed_for -= periods * self._period
            return
        share = min(periods * self._calm_share, 1.0)
        self._f_t_calm += share * (loads.f_t - self._f_t_calm)
        self._tau_calm += share * (abs(loads.tau_left + loads.tau_right) - self._tau_calm)

    def _left_unknown(self) -> Unknown:
        """What is still not known: a push that is there has used up its part of the reserve, and is not held twice.

        A light fruit's lever is drowned in noise sample by sample, and a push at its centre is many times its weight.
        """
        if self._unknown.push == 0.0 or self._f_t_calm < self._settings.calm_load:
            return self._unknown
        pushed = max(self.loads.f_t - self._f_t_calm, 0.0) if self._pushed_for > 0.0 else 0.0
        lever = self._tau_calm / self._f_t_calm
        return self._unknown._replace(push=max(self._unknown.push - pushed, 0.0), push_lever=lever)
