"""The estimate of a grip, sample by sample: bias, filters, limit surface, slip observer, disturbance.

`Estimator` keeps the constants and the last `GripEstimate`; the compiled `estimate_sample` makes the next one. Its
arguments and results are NamedTuples, which numba takes as they are. No argument is changed.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from pomona.executive.values.arrays import Float64
from pomona.executive.values.numba_kernel import kernel
from pomona.skills.grip.estimate_kernel import (
    calm_load,
    is_contact,
    jumps_of_one_finger,
    loads_in_noise,
    observe_finger_loads,
    remaining_reserve,
)
from pomona.skills.grip.limit_surface import SoftContact, SurfaceTable, surface_table
from pomona.skills.grip.observer import DynamicSettings, ObserverSettings, steps_in_a_sample
from pomona.skills.grip.pads import MIRROR, smooth
from pomona.skills.grip.settings import FilterSettings, GripSettings


class NoiseModel(NamedTuple):
    """Bias and noise of both fingers, learned while nothing touches them."""

    bias: Float64  # mean of the samples, shape (2, 6) [N, N·m]
    band: Float64  # noise of the fast filter in the common (row 0) and the differential mode (row 1), shape (2, 6)
    variance: Float64  # noise of each slowly filtered channel of a finger, shape (6,)
    difference_variance: float  # noise of the difference between the fingers' normal forces [N²]
    f_n_band: float  # twice the standard deviation of the measured grip force [N]
    bias_std: float  # standard deviation of the minimum grip force's error caused by the error of the bias [N]
    push: float  # a tangential force that grows by less may be noise [N]


class Rates(NamedTuple):
    """Constants that depend on the sample rate.

    Attributes:
        fast, normal, load, centre, rise, calm: weight of a new sample in the low-pass with the lag of this name, 0 … 1.
        period: between two samples [s].
        substeps, step: integration steps of the observer in a period, and their length [s].
    """

    fast: float
    normal: float
    load: float
    centre: float
    rise: float
    calm: float
    period: float
    substeps: int
    step: float


class Allowance(NamedTuple):
    """Loads beyond the measured ones that the grip allows for."""

    lever: float  # of the fruit's centre about the fingers' axis, until the fruit is carried [m]
    reserve: float  # tangential force on top of the load [N]


class GripModel(NamedTuple):
    """Constants of a grip between two samples."""

    noise: NoiseModel
    rates: Rates
    friction: SurfaceTable
    filters: FilterSettings
    observer: ObserverSettings
    dynamic: DynamicSettings
    allowance: Allowance


class Memory(NamedTuple):
    """State of filters and observer that passes from one estimate to the next.

    Attributes:
        fast, slow: filtered common mode (row 0) and differential mode (row 1) of the fingers, shape (2, 6).
        is_started: False until the observer's first sample.
        omega, z: slip velocity [rad/s] and deflection of the bristles [rad].
        integral: of the dynamic term [N].
        centre: distance of the centre of rotation from the contact [m].
        f_t: tangential load of the last estimate [N].
        f_t_before, f_least_before: slow averages against which a rise is measured [N].
        f_t_calm, tau_calm: averages of load and moment while nothing pushes [N, N·m].
        push_left: a push that lasts longer than this from now on counts as load [s].
        change_left, change_right: recent maximum of the finger's fast change beyond noise [N].
    """

    fast: Float64 = np.zeros((2, 6))
    slow: Float64 = np.zeros((2, 6))
    is_started: bool = False
    omega: float = 0.0
    z: float = 0.0
    integral: float = 0.0
    centre: float = 0.0
    f_t: float = 0.0
    f_t_before: float = 0.0
    f_least_before: float = 0.0
    f_t_calm: float = 0.0
    tau_calm: float = 0.0
    push_left: float = 0.0
    change_left: float = 0.0
    change_right: float = 0.0


class GripEstimate(NamedTuple):
    """Loads, slip and disturbance of a grip after one sample.

    Attributes:
        left, right: pressing force of each finger [N].
        f_n: grip force, twice the weaker finger's, with the positive bias of noise on abs(left - right) removed [N].
        f_t: tangential force of both fingers together [N]; its components in the left pad's frame are `load`.
        tau_n: torsional moment of both fingers together [N·m].
        tau_std: standard deviation of `tau_n` by noise [N·m].
        f_least: minimum grip force for the load by the limit surface, without margin [N].
        f_least_std: its standard deviation by noise [N].
        f_least_rise: its difference from its own slow average [N]; negative while it falls.
        f_coulomb: minimum grip force by Coulomb's law, without the moment [N].
        f_cautious: minimum grip force with the reserve and the fruit's centre `offset` off the axis [N].
        f_reserved: minimum grip force with the rest of the reserve at the load's own lever [N].
        twist: relative excess of `f_least` over `f_coulomb`, 0 … `twist_bound`.
        f_nd: dynamic term of the grip force [N].
        slip_speed: of the fruit along the pads [m/s].
        push: growth of a carried load beyond noise and lifting [N]: a lower bound of the impact.
        shear_jump: jump of one finger's tangential force beyond noise while the other finger is quiet [N]; 0 where the
            whole load of the finger has come or gone in proportion.
        press_jump_of_one: the same of its normal force [N].
        press_jump_of_both: jump of both normal forces together, beyond noise and the fingers' own motion [N].
        contact_jump: jump of a finger's force in proportion to its load: a contact that breaks or forms [N].
        one_presses_more: True after one finger's normal force has jumped alone; the stronger finger then counts in
            `f_n`.
        f_n_band: noise of `f_n`, twice its standard deviation [N].
        bias_std: error of `f_least` by the bias, standard deviation [N].
        unfiltered: mean wrench of both fingers in the left pad's frame, bias removed, shape (6,).
        memory: state for the next estimate.
    """

    left: float = 0.0
    right: float = 0.0
    f_n: float = 0.0
    f_t: float = 0.0
    load: tuple[float, float] = (0.0, 0.0)
    tau_n: float = 0.0
    tau_std: float = 0.0
    f_least: float = 0.0
    f_least_std: float = 0.0
    f_least_rise: float = 0.0
    f_coulomb: float = 0.0
    f_cautious: float = 0.0
    f_reserved: float = 0.0
    twist: float = 0.0
    f_nd: float = 0.0
    slip_speed: float = 0.0
    push: float = 0.0
    shear_jump: float = 0.0
    press_jump_of_one: float = 0.0
    press_jump_of_both: float = 0.0
    contact_jump: float = 0.0
    one_presses_more: bool = False
    f_n_band: float = 0.0
    bias_std: float = 0.0
    unfiltered: Float64 = np.zeros(6)
    memory: Memory = Memory()

    @property
    def stronger(self) -> float:
        """Larger one of the fingers' forces [N]."""
        return max(self.left, self.right)

    @property
    def weaker(self) -> float:
        """Smaller one of the fingers' forces [N]."""
        return min(self.left, self.right)

    @property
    def force_sum(self) -> float:
        """Sum of the fingers' forces [N]; above `f_n` where a drifting sensor sets them apart."""
        return self.left + self.right


@kernel()
def estimate_sample(  # type: ignore[no-untyped-def]
    memory,
    raw,
    periods,
    expected,
    is_carried,
    noise,
    rates,
    friction,
    filters,
    observer,
    dynamic,
    allowance,
):
    """Return the estimate after one raw sample.

    Args:
        raw: wrenches, shape (2, 6), as in `WrenchSample`.
        periods: sample periods since the last estimate.
        expected: change of the grip force in each of them by the fingers' own motion [N].
        is_carried: the fruit hangs in the fingers: a load that grows fast is a push.
        noise, rates, friction, filters, observer, dynamic, allowance: the parts of `GripModel`; numba takes them faster
            one by one.
    """
    fast = memory.fast.copy()
    slow = memory.slow.copy()
    smoothed = np.empty((2, 6))
    shares = (rates.fast, rates.normal, rates.load)
    for _ in range(periods):
        smooth(raw, noise, fast, slow, smoothed, shares, expected)
    push, push_lever = remaining_reserve(memory, allowance)
    unknown = (allowance.lever, push, push_lever, filters.farthest_centre)
    left = loads_in_noise(smoothed[0], noise.variance, friction, unknown)
    right = loads_in_noise(smoothed[1], noise.variance, friction, unknown)
    omega, z, integral, centre, f_nd = observe_finger_loads(
        left, right, periods, rates, observer, dynamic, memory
    )

    load = (left.f_x + right.f_x, left.f_y + right.f_y)
    f_t = math.hypot(left.f_x + right.f_x, left.f_y + right.f_y)
    tau_n = left.tau_n + right.tau_n
    f_least = left.least + right.least
    f_coulomb = left.f_t / friction.mu + right.f_t / friction.mu
    rise_share = min(periods * rates.rise, 1.0)
    f_t_before = memory.f_t_before + rise_share * (f_t - memory.f_t_before)
    f_least_before = memory.f_least_before + rise_share * (f_least - memory.f_least_before)
    push_now = 0.0
    if is_carried:
        push_now = max(f_t - (1.0 + filters.push_ratio) * f_t_before - noise.push, 0.0)
    f_t_calm, tau_calm, push_left = calm_load(f_t, tau_n, push_now, periods, memory, rates, filters)

    jumps_of_one, change_left, change_right = jumps_of_one_finger(
        memory, fast, slow, periods, noise, rates, filters
    )
    shear_jump, press_jump_of_one, contact_jump = jumps_of_one
    press_jump_of_both = 0.0
    if not is_contact(fast, slow, noise.band, 0.0, filters.aside):
        press_jump_of_both = abs(fast[0, 2] - slow[0, 2]) - noise.band[0, 2]
    one_presses_more = 2.0 * (abs(fast[1, 2] - slow[1, 2]) - noise.band[1, 2]) > filters.jump
    apart = left.f_n - right.f_n
    difference = math.sqrt(max(apart * apart - noise.difference_variance, 0.0))
    f_n = max(left.f_n + right.f_n + (difference if one_presses_more else -difference), 0.0)

    lever = f_t / max(left.f_n + right.f_n, 0.4)
    unfiltered = np.empty(6)
    for j in range(6):
        unfiltered[j] = 0.5 * (
            raw[0, j] - noise.bias[0, j] + MIRROR[j] * (raw[1, j] - noise.bias[1, j])
        )
    tau_std = math.sqrt(2.0 * (noise.variance[5] + lever * lever * noise.variance[4]))
    f_least_std = math.sqrt(left.least_variance + right.least_variance)
    rise = f_least - f_least_before
    cautious = left.cautious + right.cautious
    reserved = left.reserved + right.reserved
    twist = min(max(f_least / max(f_coulomb, 0.1) - 1.0, 0.0), filters.twist_bound)
    slip_speed = abs(omega) * centre
    averages = (
        f_t,
        f_t_before,
        f_least_before,
        f_t_calm,
        tau_calm,
        push_left,
        change_left,
        change_right,
    )
    memory = Memory(fast, slow, True, omega, z, integral, centre, *averages)
    jumps = (shear_jump, press_jump_of_one, press_jump_of_both, contact_jump, one_presses_more)
    forces = (
        left.f_n,
        right.f_n,
        f_n,
        f_t,
        load,
        tau_n,
        tau_std,
        f_least,
        f_least_std,
        rise,
        f_coulomb,
        cautious,
    )
    others = (reserved, twist, f_nd, slip_speed, push_now)
    return GripEstimate(
        *(forces + others + jumps + (noise.f_n_band, noise.bias_std, unfiltered, memory))
    )


class Estimator:
    """Makes a `GripEstimate` of each sample. Usable alone: `calibrate`, then `advance` with raw wrenches.

    Attributes:
        estimate: the newest one; all zero before the first sample.
    """

    def __init__(self, settings: GripSettings) -> None:
        self._filters = settings.filters
        self._model = _model_of(settings)
        self.estimate = GripEstimate()

    @property
    def bias(self) -> Float64:
        """Reading of the fingers with nothing between them, shape (2, 6) [N, N·m]."""
        return self._model.noise.bias

    def calibrate(self, samples: Float64) -> None:
        """Learn bias and noise from samples with nothing touching, shape (n, 2, 6)."""
        rates = self._model.rates
        share = self._filters.noise_stds
        right = MIRROR * samples[:, 1]
        modes = 0.5 * np.stack([samples[:, 0] + right, samples[:, 0] - right], axis=1)
        fast_std = math.sqrt(rates.fast / (2.0 - rates.fast))
        variance = modes.var(axis=0).sum(axis=0) * rates.load / (2.0 - rates.load)
        apart = float(modes[:, 1, 2].var()) * rates.normal / (2.0 - rates.normal)
        of_mean = samples.var(axis=0).sum(axis=0) / len(samples)
        normal_variance = (
            float(modes[:, :, 2].var(axis=0).sum()) * rates.normal / (2.0 - rates.normal)
        )
        noise = NoiseModel(
            bias=samples.mean(axis=0),
            band=share * modes.std(axis=0) * fast_std,
            variance=variance,
            difference_variance=4.0 * apart,
            f_n_band=4.0 * math.sqrt(normal_variance),
            bias_std=math.sqrt(
                float(of_mean[2] + 0.5 * (of_mean[0] + of_mean[1]) / self._model.friction.mu**2)
            ),
            push=self._filters.push_stds * math.sqrt(float(variance[0] + variance[1])),
        )
        self._model = self._model._replace(noise=noise)
        self.estimate = GripEstimate(f_n_band=noise.f_n_band, bias_std=noise.bias_std)

    def set_friction(self, contact: SoftContact) -> None:
        """Use another friction from the next sample on."""
        self._model = self._model._replace(friction=surface_table(contact))

    def restart_observer(self) -> None:
        """Start the slip observer at rest under the load of the next sample."""
        memory = self.estimate.memory._replace(is_started=False)
        self.estimate = self.estimate._replace(memory=memory)

    def advance(
        self, raw: Float64, periods: int = 1, expected: float = 0.0, is_carried: bool = False
    ) -> GripEstimate:
        """Take one raw sample; the arguments are those of `estimate_sample`."""
        self.estimate = estimate_sample(
            self.estimate.memory, raw, periods, expected, is_carried, *self._model
        )
        return self.estimate


def _model_of(settings: GripSettings) -> GripModel:
    filters = settings.filters
    period = 1.0 / settings.rate
    substeps = steps_in_a_sample(settings.rate)

    def weight(lag: float) -> float:
        return 1.0 - math.exp(-1.0 / (settings.rate * lag))

    return GripModel(
        noise=NoiseModel(np.zeros((2, 6)), np.zeros((2, 6)), np.zeros(6), *(0.0,) * 4),
        rates=Rates(
            fast=weight(filters.fast_lag),
            normal=weight(filters.normal_lag),
            load=weight(filters.load_lag),
            centre=weight(filters.centre_lag),
            rise=weight(filters.rise_lag),
            calm=weight(filters.calm_lag),
            period=period,
            substeps=substeps,
            step=period / substeps,
        ),
        friction=surface_table(settings.contact),
        filters=filters,
        observer=settings.observer,
        dynamic=settings.dynamic,
        allowance=Allowance(settings.offset, settings.reserve),
    )
