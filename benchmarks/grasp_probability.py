"""A grip force reference by one principle: press with the minimum force for which slip is improbable.

    P(slip before the fingers can answer) <= eps

An interacting-multiple-model Kalman filter estimates the load and its rate. The limit surface maps the load that is
predicted for the horizon, and the uncertain friction, to a distribution of the minimum grip force; the reference is its
(1 - eps) quantile. `ProbabilityController` puts it in the place of the modes LIFTING, CARRIED and CATCHING of
`GripController`; sensing, slip detection, monitors and tracking are the same objects.
docs/evidence/grasp-one-principle.md has the comparison; `python -m benchmarks.compare_grasp` makes it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from pomona.executive.values.arrays import Float64
from pomona.skills.grip.closing import Closing
from pomona.skills.grip.controller import GripController
from pomona.skills.grip.estimate import GripEstimate, NoiseModel
from pomona.skills.grip.grip import GripMode
from pomona.skills.grip.limit_surface import SoftContact, least_force_of_finger, surface_table
from pomona.skills.grip.monitors import GripState
from pomona.skills.grip.pads import LEVER_LOAD, PAD_HALF, PRESSING
from pomona.skills.grip.reference import (
    CarriedMode,
    ForceReference,
    Levels,
    LiftingMode,
    usual_modes,
)
from pomona.skills.grip.sensor import LowPass
from pomona.skills.grip.settings import GripSettings

CALM, MOVE, HIT = range(3)


class ProbabilitySettings(NamedTuple):
    """Constants of the reference; each line has the quantity with its unit, and where it comes from."""

    horizon: float = (
        0.05  # time from a load to the fingers' answer [s]: command period, lag and filter; gripper
    )
    eps: float = 0.01  # accepted probability of slip within the horizon; choice
    s_model: float = (
        0.05  # relative error of the minimum force with known friction; draws of seed 7
    )
    mu_stds: float = (
        1.8  # standard deviations that `mu_uncertainty` stands for (uniform: 1.73); calibration
    )
    move_rate: float = 0.005  # calm loads that begin to move [1/s]; task
    hit_rate: float = 0.0005  # calm loads that jump [1/s]; task
    calm_rate: float = (
        25.0  # moving loads that become calm [1/s]: a lift takes the load over in 40 ms; task
    )
    q_calm: float = 0.02  # walk of a calm load [N/√s]; sensor's drift
    push_rate: float = 30.0  # rate of a push at a carried fruit, standard deviation [N/s]; task
    lift_rate: float = (
        10.0  # rate of a load that comes from the table, standard deviation [N/s]; lifts
    )
    lift_share: float = 22.0  # and its part relative to the load [1/s]; lifts
    rate_time: float = 0.03  # correlation time of that rate [s]: stiffness of contact; lifts
    hit_std: float = 3.0  # jump of the load, standard deviation [N]; task
    lever: float = 0.012  # distance at which loads move and jump, standard deviation [m]; fruit
    slide_scale: float = 5.0  # mean of a push that a sliding fruit hides [N]; task
    fall_time: float = 0.6  # time constant with which an excess is let go [s]: slip must be found meanwhile; slip watch
    tested_fall_time: float = (
        0.15  # the same as far as a grip of this ratio has borne the load before [s]; gripper
    )
    tested_lag: float = 0.1  # time for which it must have borne it [s]; slip watch
    answer_time: float = 0.15  # and that of the force for a load that moves [s]; draws of seed 7


class LoadState(NamedTuple):
    """Estimate of the load by each of the models.

    Attributes:
        weight: probability of each model, shape (3,).
        mean: force and rate of each model in the channels x, y [N, N/s] and moment [N·m, N·m/s], shape (3, 3, 2).
        variance: of force, of both, of rate, shape (3, 3, 3).
    """

    weight: Float64
    mean: Float64
    variance: Float64


def unknown_load() -> LoadState:
    """Return the state before the first sample: a load of 0 ± 3 N at a lever of 10 mm."""
    variance = np.zeros((3, 3, 3))
    variance[:, :, 0] = np.array([9.0, 9.0, 9e-4])
    return LoadState(np.array([1.0, 0.0, 0.0]), np.zeros((3, 3, 2)), variance)


@njit(cache=True)
def advance_load(state, measured, noise, dt, is_carried, s):  # type: ignore[no-untyped-def]
    """Return the state one sample later.

    Args:
        state: of the last sample.
        measured: force x, y [N] and moment [N·m] of both fingers together, shape (3,).
        noise: its variance, shape (3,).
        dt: sample period [s].
        is_carried: the fruit hangs in the fingers.
        s: the settings.
    """
    weight, mean, variance = state
    change = np.zeros((3, 3))
    change[CALM, MOVE], change[CALM, HIT] = dt * s.move_rate, dt * s.hit_rate
    change[MOVE, CALM], change[MOVE, HIT] = dt * s.calm_rate, dt * s.hit_rate
    change[HIT, CALM], change[HIT, MOVE] = dt * s.calm_rate, 1.0 - dt * s.calm_rate
    change[CALM, CALM] = 1.0 - change[CALM, MOVE] - change[CALM, HIT]
    change[MOVE, MOVE] = 1.0 - change[MOVE, CALM] - change[MOVE, HIT]
    load = 0.0
    for i in range(3):
        load += weight[i] * math.hypot(mean[i, 0, 0], mean[i, 1, 0])
    rate_std = s.push_rate if is_carried else s.lift_rate + s.lift_share * load
    kept = math.exp(-dt / s.rate_time)
    moved = s.rate_time * (1.0 - kept)
    new_weight, log_likelihood = np.zeros(3), np.zeros(3)
    new_mean, new_variance = np.zeros((3, 3, 2)), np.zeros((3, 3, 3))
    for j in range(3):
        for i in range(3):
            new_weight[j] += change[i, j] * weight[i]
        for c in range(3):
            unit = s.lever if c == 2 else 1.0
            start_rate = (unit * rate_std) ** 2
            f = r = p_ff = p_fr = p_rr = 0.0
            for i in range(3):
                share = change[i, j] * weight[i] / max(new_weight[j], 1e-300)
                f += share * mean[i, c, 0]
                r += share * mean[i, c, 1]
            for i in range(3):
                share = change[i, j] * weight[i] / max(new_weight[j], 1e-300)
                d_f, d_r = mean[i, c, 0] - f, mean[i, c, 1] - r
                p_ff += share * (variance[i, c, 0] + d_f * d_f)
                p_fr += share * (variance[i, c, 1] + d_f * d_r)
                p_rr += share * ((start_rate if i == CALM else variance[i, c, 2]) + d_r * d_r)
            if j == CALM:
                r = p_fr = p_rr = 0.0
                p_ff += (unit * s.q_calm) ** 2 * dt
            else:
                f, r = f + moved * r, kept * r
                p_ff += 2.0 * moved * p_fr + moved * moved * p_rr
                p_fr = kept * (p_fr + moved * p_rr)
                p_rr = kept * kept * p_rr + start_rate * (1.0 - kept * kept)
                if j == HIT:
                    p_ff += (unit * s.hit_std) ** 2
            innovation = measured[c] - f
            total = p_ff + noise[c]
            gain_f, gain_r = p_ff / total, p_fr / total
            new_mean[j, c, 0], new_mean[j, c, 1] = f + gain_f * innovation, r + gain_r * innovation
            new_variance[j, c, 0] = (1.0 - gain_f) * p_ff
            new_variance[j, c, 1] = (1.0 - gain_f) * p_fr
            new_variance[j, c, 2] = p_rr - gain_r * p_fr
            log_likelihood[j] -= 0.5 * (innovation * innovation / total + math.log(total))
    likeliest = log_likelihood.max()
    for j in range(3):
        new_weight[j] *= math.exp(log_likelihood[j] - likeliest)
    return LoadState(new_weight / new_weight.sum(), new_mean, new_variance)


@njit(cache=True)
def _beyond(force, mean, std):  # type: ignore[no-untyped-def]
    """Probability that a normally distributed force exceeds this one."""
    return 0.5 * math.erfc((force - mean) / (std * 1.4142135623730951))


@njit(cache=True)
def _least(f_x, f_y, tau, table):  # type: ignore[no-untyped-def]
    return 2.0 * least_force_of_finger(0.5 * math.hypot(f_x, f_y), 0.5 * tau, table)[0]


@njit(cache=True)
def least_distribution(state, ahead, table, s):  # type: ignore[no-untyped-def]
    """Mean and standard deviation by the load's error of the minimum grip force that each model predicts, shape (3, 2).

    Args:
        state: of the load.
        ahead: time from now [s].
        table: limit surface of a finger.
        s: the settings.
    """
    result = np.zeros((3, 2))
    b = s.rate_time * (1.0 - math.exp(-ahead / s.rate_time))
    for j in range(3):
        mean, variance = state.mean[j], state.variance[j]
        f_x, f_y = mean[0, 0] + b * mean[0, 1], mean[1, 0] + b * mean[1, 1]
        tau = abs(mean[2, 0] + b * mean[2, 1])
        v = np.zeros(3)
        for c in range(3):
            v[c] = variance[c, 0] + 2.0 * b * variance[c, 1] + b * b * variance[c, 2]
        f_t = max(math.hypot(f_x, f_y), 1e-6)
        std_f = math.sqrt((f_x * f_x * v[0] + f_y * f_y * v[1]) / (f_t * f_t))
        least = _least(f_x, f_y, tau, table)
        by_force = 2.0 * least_force_of_finger(0.5 * (f_t + std_f), 0.5 * tau, table)[0] - least
        by_moment = (
            2.0 * least_force_of_finger(0.5 * f_t, 0.5 * (tau + math.sqrt(v[2])), table)[0] - least
        )
        result[j, 0], result[j, 1] = least, math.hypot(by_force, by_moment)
    return result


@njit(cache=True)
def smallest_force(state, table, known, reserve, s, highest):  # type: ignore[no-untyped-def]
    """Return the smallest grip force with a probability of slip of at most eps [N]: for the load now, and for later.

    Args:
        state: of the load.
        table: limit surface of a finger.
        known: (relative error of the friction, error of the measured grip force [N], grip force that comes [N]).
        reserve: minimum grip force of the load with its reserve [N]; 0 without one.
        s: the settings.
        highest: bound of the result [N].
    """
    s_mu, force_std, coming = known
    relative = math.hypot(s_mu, s.s_model)
    later, now = (
        least_distribution(state, s.horizon, table, s),
        least_distribution(state, 0.0, table, s),
    )
    hidden = 0.0
    for j in range(3):
        later[j, 1] = math.sqrt(later[j, 1] ** 2 + (relative * later[j, 0]) ** 2 + force_std**2)
        by_friction = (relative * now[j, 0]) ** 2 + force_std**2
        if j != CALM:
            hidden += state.weight[j] * _beyond(
                coming, now[j, 0], math.sqrt(now[j, 1] ** 2 + by_friction)
            )
            now[j, 1] = 0.0  # noise of a moving load does not last
        now[j, 1] = math.sqrt(now[j, 1] ** 2 + by_friction)
    reserved = (reserve, math.sqrt((relative * reserve) ** 2 + force_std**2))
    lasting = _quantile(state.weight, now, reserved, (0.0, 0.0), s, highest)
    return lasting, _quantile(state.weight, later, reserved, (hidden, coming), s, highest)


@njit(cache=True)
def _quantile(weight, least, reserved, hidden, s, highest):  # type: ignore[no-untyped-def]
    """Bisect for the force whose probability of slip is eps [N]."""
    low, high = 0.0, highest
    for _ in range(24):
        force = 0.5 * (low + high)
        slip = hidden[0] * math.exp(-max(force - hidden[1], 0.0) / s.slide_scale)
        for j in range(3):
            slip += weight[j] * _beyond(force, least[j, 0], least[j, 1])
        if reserved[0] > 0.0:
            slip += _beyond(force, reserved[0], reserved[1])
        if slip > s.eps:
            low = force
        else:
            high = force
    return high


class ProbabilityReference(ForceReference):
    """Reference by the probability of slip while the fruit is lifted and carried.

    Attributes:
        load: estimate of the load.
    """

    def __init__(
        self, settings: GripSettings, constants: ProbabilitySettings = ProbabilitySettings()
    ) -> None:
        super().__init__(
            settings,
            lambda levels: (
                *usual_modes(levels),
                ProbableLifting(levels, self),
                ProbableCarrying(levels, self),
            ),
        )
        self.load = unknown_load()
        self._constants, self._period = constants, settings.period
        self._noise, self._momentary = np.ones(6), 0.0
        self._ratio, self._tested = LowPass(constants.tested_lag), 0.0
        self.take_contact(settings.contact)

    def calibrate(self, variance: Float64) -> None:
        """Learn the variance of a finger's channels, shape (6,)."""
        self._noise = variance

    def take_contact(self, contact: SoftContact) -> None:
        """Use another friction; nothing has been borne with it."""
        self._tested = 0.0
        self._table = surface_table(contact)

    def set_friction(self, settings: GripSettings) -> None:
        super().set_friction(settings)
        self.take_contact(settings.contact)

    def observe(self, estimate: GripEstimate, periods: int) -> None:
        """Take the load of one sample, in any mode."""
        wrench, pressing = estimate.unfiltered, max(0.5 * estimate.f_n, PRESSING)
        x = min(max(wrench[4] / pressing, -PAD_HALF), PAD_HALF)
        y = min(max(-wrench[3] / pressing, -PAD_HALF), PAD_HALF)
        moment = wrench[5] - (x * wrench[1] - y * wrench[0])
        measured = 2.0 * np.array([wrench[0], wrench[1], moment])
        ratio = 0.5 * estimate.f_t / pressing
        of_moment = self._noise[5] + ratio * ratio * self._noise[4]
        noise = 2.0 * np.array([self._noise[0], self._noise[1], of_moment])
        for _ in range(periods):
            self.load = advance_load(
                self.load, measured, noise, self._period, self.is_carried, self._constants
            )

    def probable(
        self, estimate: GripEstimate, coming: float, elapsed: float, lowest: float
    ) -> float:
        """Return the reference [N]: a rise is followed at once, an excess is let go slowly."""
        levels, s = self._levels, self._constants
        known = (
            levels.settings.mu_uncertainty / s.mu_stds,
            math.hypot(0.5 * estimate.f_n_band, estimate.bias_std),
            coming,
        )
        highest = 2.0 * levels.settings.loop.max_force
        reserve = self._reserved(estimate)
        levels.wanted, force = smallest_force(self.load, self._table, known, reserve, s, highest)
        levels.for_weight = levels.margin * estimate.f_coulomb
        ratio = self._ratio.update(estimate.f_least / max(estimate.f_n, 0.1), elapsed)
        self._tested = max(self._tested, ratio)
        is_tested = levels.held * self._tested > estimate.f_least
        falls = 1.0 - math.exp(-elapsed / (s.tested_fall_time if is_tested else s.fall_time))
        target = max(levels.wanted, levels.settings.floor)
        if target >= levels.held:
            levels.held = min(target, max(levels.held, levels.limit))
        elif levels.may_fall:
            levels.held += falls * (target - levels.held)
        if levels.held < lowest:
            levels.held = min(levels.held + levels.settings.ramp_rate * elapsed, lowest)
        self._momentary = max(
            force - levels.held, math.exp(-elapsed / s.answer_time) * self._momentary
        )
        return levels.held + self._momentary

    def _reserved(self, estimate: GripEstimate) -> float:
        """Minimum grip force of the calm load with the reserve, at its lever or at that of an unknown centre [N]."""
        settings, memory = self._levels.settings, estimate.memory
        if settings.reserve == 0.0:
            return 0.0
        if self.is_carried and memory.f_t_calm > LEVER_LOAD:
            f_t, lever = memory.f_t_calm + settings.reserve, memory.tau_calm / memory.f_t_calm
        else:
            f_t, lever = estimate.f_t + settings.reserve, settings.offset / math.sqrt(3.0)
        return float(_least(f_t, 0.0, lever * f_t, self._table))

    @property
    def is_catching(self) -> bool:
        """True while a carried fruit is pressed with more than its load needs, since something pushes."""
        return self.is_carried and self._momentary > self._levels.settings.floor


class ProbableLifting(LiftingMode):
    """The load comes on the fingers: at least the initial force."""

    def __init__(self, levels: Levels, reference: ProbabilityReference) -> None:
        super().__init__(levels)
        self._reference = reference

    def follow(self, estimate: GripEstimate, force_coming: float, elapsed: float) -> float:
        tuned = self._levels.tuned
        is_steady = (
            estimate.f_least_rise < tuned.carried_rise * estimate.f_least + estimate.f_n_band
        )
        if estimate.f_t < tuned.carried_load:
            self._loaded_for = 0.0
        elif is_steady:
            self._loaded_for += elapsed
        lowest = 0.0 if self._is_carried() else self._levels.settings.initial_force
        return self._reference.probable(estimate, force_coming, elapsed, lowest)


class ProbableCarrying(CarriedMode):
    """The fruit hangs."""

    def __init__(self, levels: Levels, reference: ProbabilityReference) -> None:
        super().__init__(levels)
        self._reference = reference

    def follow(self, estimate: GripEstimate, force_coming: float, elapsed: float) -> float:
        return self._reference.probable(estimate, force_coming, elapsed, 0.0)

    def next_mode(self, _estimate: GripEstimate) -> GripMode:
        return self.mode


class ProbabilityController(GripController):
    """The grip controller with `ProbabilityReference`."""

    constants = ProbabilitySettings()

    def __init__(self, settings: GripSettings) -> None:
        super().__init__(settings)
        self._reference: ProbabilityReference = ProbabilityReference(settings, self.constants)
        self._closing = Closing(settings, self._reference, self._tracker, self._timing.interval)
        self._noise: NoiseModel | None = None

    def _watch_hold(self, now: GripState) -> None:
        model = self._estimator._model
        if self._noise is not model.noise:
            self._noise, share = model.noise, model.rates.load
            self._reference.calibrate(model.noise.variance * (2.0 - share) / share)
        self._reference.observe(now.estimate, now.sample.periods)
        super()._watch_hold(now)

    def _learn_friction(self) -> None:
        if not self._reference.is_catching:
            super()._learn_friction()
            self._reference.take_contact(self.settings.contact)
