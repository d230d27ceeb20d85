"""Compiled step from one sample to the next `GripEstimate`: bias, filters, limit surface, slip observer, disturbance.

Arguments and results are NamedTuples, which numba takes as they are. No argument is changed.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from pomona.executive.values.arrays import Float64
from pomona.skills.grip.limit_surface import SurfaceTable, least_force_of_finger
from pomona.skills.grip.observer import DynamicSettings, ObserverSettings, answer_slip, observe
from pomona.skills.grip.pads import LEVER_LOAD, MIRROR, PRESSING, loads_of_finger, smooth
from pomona.skills.grip.settings import FilterSettings


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


class _FingerLoads(NamedTuple):
    f_n: float
    f_x: float
    f_y: float
    f_t: float
    tau_n: float
    least: float
    least_variance: float
    cautious: float
    reserved: float
    centre: float
    friction_torque: float
    friction_force: float


@njit(cache=True)
def estimate_sample(  # type: ignore[no-untyped-def]
    memory, raw, periods, expected, is_carried, noise, rates, friction, filters, observer, dynamic, allowance
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
    fast, slow, smoothed = memory.fast.copy(), memory.slow.copy(), np.empty((2, 6))
    shares = (rates.fast, rates.normal, rates.load)
    for _ in range(periods):
        smooth(raw, noise, fast, slow, smoothed, shares, expected)
    push, push_lever = _remaining_reserve(memory, filters, allowance)
    unknown = (allowance.lever, push, push_lever, filters.farthest_centre)
    left = _loads_of(smoothed[0], noise.variance, friction, unknown)
    right = _loads_of(smoothed[1], noise.variance, friction, unknown)
    omega, z, integral, centre, f_nd = _observe(left, right, periods, rates, observer, dynamic, memory)

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
    f_t_calm, tau_calm, push_left = _calm_load(f_t, tau_n, push_now, periods, memory, rates, filters)

    jumps_of_one, change_left, change_right = _jumps_of_one_finger(memory, fast, slow, periods, noise, rates, filters)
    shear_jump, press_jump_of_one, contact_jump = jumps_of_one
    press_jump_of_both = 0.0
    if not _is_contact(fast, slow, noise.band, 0.0, filters.aside):
        press_jump_of_both = abs(fast[0, 2] - slow[0, 2]) - noise.band[0, 2]
    one_presses_more = 2.0 * (abs(fast[1, 2] - slow[1, 2]) - noise.band[1, 2]) > filters.jump
    apart = left.f_n - right.f_n
    difference = math.sqrt(max(apart * apart - noise.difference_variance, 0.0))
    f_n = max(left.f_n + right.f_n + (difference if one_presses_more else -difference), 0.0)

    lever = f_t / max(left.f_n + right.f_n, 0.4)
    unfiltered = np.empty(6)
    for j in range(6):
        unfiltered[j] = 0.5 * (raw[0, j] - noise.bias[0, j] + MIRROR[j] * (raw[1, j] - noise.bias[1, j]))
    tau_std = math.sqrt(2.0 * (noise.variance[5] + lever * lever * noise.variance[4]))
    f_least_std = math.sqrt(left.least_variance + right.least_variance)
    rise, cautious, reserved = f_least - f_least_before, left.cautious + right.cautious, left.reserved + right.reserved
    twist = min(max(f_least / max(f_coulomb, 0.1) - 1.0, 0.0), filters.twist_bound)
    slip_speed = abs(omega) * centre
    averages = (f_t, f_t_before, f_least_before, f_t_calm, tau_calm, push_left, change_left, change_right)
    memory = Memory(fast, slow, True, omega, z, integral, centre, *averages)
    jumps = (shear_jump, press_jump_of_one, press_jump_of_both, contact_jump, one_presses_more)
    forces = (left.f_n, right.f_n, f_n, f_t, load, tau_n, tau_std, f_least, f_least_std, rise, f_coulomb, cautious)
    others = (reserved, twist, f_nd, slip_speed, push_now)
    return GripEstimate(*(forces + others + jumps + (noise.f_n_band, noise.bias_std, unfiltered, memory)))


@njit(cache=True)
def _remaining_reserve(memory, filters, allowance):  # type: ignore[no-untyped-def]
    """Reserve that is left [N] and its lever [m].

    A measured push is subtracted, so that it is not counted twice. The lever is that of the calm load: a push at the
    fruit's centre is many times the weight of a light fruit, whose lever is below the noise of a sample.
    """
    if allowance.reserve == 0.0 or memory.f_t_calm < LEVER_LOAD:
        return allowance.reserve, allowance.lever
    pushed = max(memory.f_t - memory.f_t_calm, 0.0) if memory.push_left > 0.0 else 0.0
    return max(allowance.reserve - pushed, 0.0), memory.tau_calm / memory.f_t_calm


@njit(cache=True)
def _calm_load(f_t, tau_n, push_now, periods, memory, rates, filters):  # type: ignore[no-untyped-def]
    """Averages of load and moment while nothing pushes [N, N·m], and the time for which a push may last [s].

    A push ends when the load is back; one that lasts longer than `longest_push` counts as load.
    """
    push_left = memory.push_left
    if push_now > 0.0:
        push_left = filters.longest_push
    elif f_t < (1.0 + filters.push_ratio) * memory.f_t_calm:
        push_left = 0.0
    if push_left > 0.0:
        return memory.f_t_calm, memory.tau_calm, push_left - periods * rates.period
    share = min(periods * rates.calm, 1.0)
    f_t_calm = memory.f_t_calm + share * (f_t - memory.f_t_calm)
    return f_t_calm, memory.tau_calm + share * (abs(tau_n) - memory.tau_calm), push_left


@njit(cache=True)
def _loads_of(wrench, variance, friction, unknown):  # type: ignore[no-untyped-def]
    """Loads of one finger, and the grip forces that they need."""
    lever_of_centre, push, push_lever, farthest = unknown
    mu, torsion, gamma = friction.mu, friction.torsion, friction.gamma
    f, tau = friction.f, friction.tau
    f_n, f_x, f_y, tau_n = loads_of_finger(wrench)
    # Noise biases magnitudes upwards: its variance is subtracted from their squares.
    f_t = math.sqrt(max(f_x * f_x + f_y * f_y - variance[0] - variance[1], 0.0))
    lever = f_t / max(f_n, PRESSING)
    tau_variance = variance[5] + lever * lever * variance[4]
    tau_n = math.copysign(math.sqrt(max(tau_n * tau_n - tau_variance, 0.0)), tau_n)
    least, s = least_force_of_finger(f_t, tau_n, friction)
    by_force = least_force_of_finger(f_t + math.sqrt(variance[0]), tau_n, friction)[0]
    noisy_tau = abs(tau_n) + math.sqrt(tau_variance)
    by_moment = least_force_of_finger(f_t, noisy_tau, friction)[0]
    least_variance = (by_force - least) ** 2 + (by_moment - least) ** 2
    worst_case_f_t = f_t + 0.5 * push
    pushed_tau = abs(tau_n) + 0.5 * push * push_lever
    reserved = least_force_of_finger(worst_case_f_t, pushed_tau, friction)[0]
    worst_case_tau = max(abs(tau_n), f_t * lever_of_centre)
    cautious = least_force_of_finger(worst_case_f_t, worst_case_tau, friction)[0]
    # Centre of rotation at the onset of sliding, and the friction there.
    pressing = max(f_n, 0.05)
    u = s * (f.size - 1)
    j = min(int(u), f.size - 2)
    f_tilde = f[j] + (u - j) * (f[j + 1] - f[j])
    tau_tilde = tau[j] + (u - j) * (tau[j + 1] - tau[j])
    if s >= 1.0:
        centre = farthest
    elif friction.is_ellipsoid:
        centre = torsion * pressing**gamma / mu * math.tan(0.5 * math.pi * s)
    else:
        centre = friction.delta * pressing**gamma * s / (1.0 - s)
    centre = min(centre, farthest)
    friction_torque = torsion * pressing ** (gamma + 1.0) * tau_tilde
    friction_force = mu * pressing * f_tilde
    at_centre = (centre, friction_torque, friction_force)
    return _FingerLoads(f_n, f_x, f_y, f_t, tau_n, least, least_variance, cautious, reserved, *at_centre)


@njit(cache=True)
def _observe(left, right, periods, rates, observer, dynamic, memory):  # type: ignore[no-untyped-def]
    """(omega, z, integral, centre, dynamic term [N]) after the periods of a sample."""
    centre = 0.5 * left.centre + 0.5 * right.centre
    if memory.is_started:
        centre = memory.centre + min(periods * rates.centre, 1.0) * (centre - memory.centre)
    y = abs(left.tau_n) + abs(right.tau_n) + centre * (left.f_t + right.f_t)
    g = left.friction_torque + right.friction_torque + centre * (left.friction_force + right.friction_force)
    omega, z, integral = memory.omega, memory.z, memory.integral
    if not memory.is_started:
        omega, z, integral = 0.0, y / observer.sigma0, 0.0
    J = observer.inertia + observer.mass * (centre + observer.offset) ** 2
    before = omega
    f_nd = 0.0
    for _ in range(periods * rates.substeps):
        omega, z = observe(omega, z, y, g, J, observer, rates.step)
        integral, f_nd = answer_slip(integral, before, omega, dynamic, rates.step)
        before = omega
    return omega, z, integral, centre, f_nd


@njit(cache=True)
def _jumps_of_one_finger(memory, fast, slow, periods, noise, rates, filters):  # type: ignore[no-untyped-def]
    """Jumps of one finger beyond noise [N], and the recent maximum of each finger's changes [N].

    The jumps are (tangential, normal) while the other finger is quiet, and that of a contact. A finger
    that swings passes through its average: its recent changes show that it is not quiet.
    """
    left, right = _changes(fast, slow, noise.band, 1.0), _changes(fast, slow, noise.band, -1.0)
    kept = math.exp(-periods * rates.period / filters.swing_memory)
    change_left = max(max(left), kept * memory.change_left)
    change_right = max(max(right), kept * memory.change_right)
    tangential = normal = contact = 0.0
    sides = ((1.0, left, max(right), change_right), (-1.0, right, max(left), change_left))
    for sign, (jumped, pressed), other, other_recent in sides:
        if _is_contact(fast, slow, noise.band, sign, filters.aside):
            contact = max(contact, jumped, pressed)
        elif other <= filters.quiet and other_recent <= max(filters.quiet, filters.swing * max(jumped, pressed)):
            normal = max(normal, pressed)
            tangential = max(tangential, jumped)
    return (tangential, normal, contact), change_left, change_right


@njit(cache=True)
def _changes(fast, slow, band, sign):  # type: ignore[no-untyped-def]
    """Fast changes of a finger's tangential and normal force beyond noise [N]; `sign` as in `_is_contact`."""
    tangential = normal = 0.0
    for j in range(3):
        change = abs(fast[0, j] - slow[0, j] + sign * (fast[1, j] - slow[1, j])) - band[0, j] - band[1, j]
        if j < 2:
            tangential = max(tangential, change)
        else:
            normal = change
    return tangential, normal


@njit(cache=True)
def _is_contact(fast, slow, band, sign, aside):  # type: ignore[no-untyped-def]
    """Return True when a finger's force has jumped along its own load: a contact that broke or formed.

    The contact of a sliding fruit breaks and forms within milliseconds, and its force stays on the friction cone. A
    faulty channel changes alone, across that load.

    Args:
        sign: 1 for the left finger, -1 for the right one, 0 for the mean of both.
    """
    jump = load = along = noise = 0.0
    for j in range(3):
        step = fast[0, j] - slow[0, j] + sign * (fast[1, j] - slow[1, j])
        force = slow[0, j] + sign * slow[1, j]
        jump += step * step
        load += force * force
        along += step * force
        noise = max(noise, band[0, j] + abs(sign) * band[1, j])
    across = math.sqrt(max(jump - along * along / max(load, 1e-12), 0.0))
    return across <= aside * math.sqrt(jump) + noise
