"""The compiled step behind `SlipSense`: one sample through bias, filters, limit surface, observer and dynamic term.

Everything goes in and comes out by name: numba takes NamedTuples as they are. Arrays in them are changed in place.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from numba import njit

from pomona.executive.values.arrays import Float64
from pomona.skills.grip.dynamic_term import answer_slip
from pomona.skills.grip.limit_surface import least_force_of_finger
from pomona.skills.grip.observer import observe
from pomona.skills.grip.pads import MIRROR, PRESSING, loads_of_finger, smooth


class Filters(NamedTuple):
    """Bias, filters and noise of both fingers; shape (2, 6) each where nothing else is said.

    Attributes:
        bias: what the fingers read with nothing between them.
        noise_band, fast, slow: of the fingers' common mode (row 0) and differential mode (row 1).
        smoothed: both fingers' wrenches, the right one's in the left pad's frame.
        variance: of the noise of each smoothed channel, shape (6,).
    """

    bias: Float64
    noise_band: Float64
    fast: Float64
    slow: Float64
    smoothed: Float64
    variance: Float64


class Shares(NamedTuple):
    """Weight of a new sample in each low-pass filter, 0 … 1."""

    fast: float
    normal: float
    load: float
    centre: float


class Contact(NamedTuple):
    """Friction parameters of the contact, with the limit surface at the nodes of its table."""

    mu: float
    torsion: float
    gamma: float
    delta: float
    ellipsoid: bool
    f: Float64
    tau: Float64
    load: Float64


class Unknown(NamedTuple):
    """Allowances for what is not known.

    Attributes:
        lever: of the fruit's centre of mass about the fingers' axis [m].
        push: tangential force that may come on top [N], at the load's own lever `push_lever` [m].
        farthest_centre: limit of the distance of the centre of rotation [m].
        quiet: force beyond noise up to which the other finger counts as feeling nothing [N].
        aside: share of a jump that may lie across the load of a contact that breaks or forms.
    """

    lever: float
    push: float
    push_lever: float
    farthest_centre: float
    quiet: float
    aside: float


class Observer(NamedTuple):
    """Constants of observer and dynamic term; see `ObserverSettings` and `DynamicSettings`."""

    sigma0: float
    beta: float
    inertia: float
    mass: float
    offset: float
    gain: float
    kp: float
    ki: float
    kdc: float
    bound: float
    substeps: int
    step: float


class SlipState(NamedTuple):
    """What observer and dynamic term remember from sample to sample.

    Attributes:
        started: False until the first sample after `start_observer`.
        omega: estimated slip velocity [rad/s].
        z: the bristles' deflection [rad].
        integral: of the dynamic term [N].
        centre: distance of the centre of rotation from the contact [m].
    """

    started: bool
    omega: float
    z: float
    integral: float
    centre: float


REST = SlipState(False, 0.0, 0.0, 0.0, 0.0)


class Loads(NamedTuple):
    """What the fingers bear, by one sample.

    Attributes:
        left, right: pressing force of each finger [N].
        tau_left, tau_right: torsional moment on each [N·m].
        f_t: tangential force of both together [N].
        least: least grasp force that holds the load by the limit surface; coulomb: by Coulomb's law [N].
        cautious: the same with the fruit's centre `Unknown.lever` off the axis; reserved: with a push on top [N].
        least_noise_std: standard deviation of `least` by noise alone [N].
        f_nd: dynamic term [N].
        one_sided_jump: how far one finger's tangential force has jumped beyond noise while the other feels nothing [N];
            0 where its whole load has come or gone in proportion: the contact of a fruit that slides.
        one_sided_press: how far the fingers' normal forces have jumped apart, beyond noise [N].
        one_sided_press_jump: as `one_sided_jump`, of the normal force [N].
        press_jump: how far both fingers' normal forces have jumped together, beyond noise and their own motion [N]; 0
            where the whole load of both has come or gone in proportion.
        contact_jump: how far a finger's forces have jumped in proportion, whatever the other one feels [N].
    """

    left: float
    right: float
    tau_left: float
    tau_right: float
    f_t: float
    least: float
    coulomb: float
    cautious: float
    reserved: float
    least_noise_std: float
    f_nd: float
    one_sided_jump: float
    one_sided_press: float
    one_sided_press_jump: float
    press_jump: float
    contact_jump: float


NO_LOADS = Loads(*(0.0,) * 16)


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
def sense_sample(raw, periods, expected, filters, shares, contact, unknown, observer, state):  # type: ignore[no-untyped-def]
    """Take one raw sample that stands for `periods` sample periods.

    Args:
        raw: wrenches, shape (2, 6), as in `WrenchSample`.
        periods: how many sample periods have passed.
        expected: what the fingers' own motion adds to the grasp force in each of them [N].

    Returns:
        (loads, state after it).
    """
    for _ in range(periods):
        smooth(
            raw, filters.bias, MIRROR, filters.noise_band, filters.fast, filters.slow, filters.smoothed,
            (shares.fast, shares.normal, shares.load), expected,
        )  # fmt: skip
    left = _loads_of(filters.smoothed[0], filters.variance, contact, unknown)
    right = _loads_of(filters.smoothed[1], filters.variance, contact, unknown)
    state, f_nd = _observe(left, right, periods, shares.centre, observer, state)
    fast, slow, band = filters.fast, filters.slow, filters.noise_band
    along, across, contact_jump = _jumps_of_one_finger(fast, slow, band, unknown)
    together = 0.0 if _is_contact(fast, slow, band, 0.0, unknown.aside) else abs(fast[0, 2] - slow[0, 2]) - band[0, 2]
    loads = Loads(
        left.f_n,
        right.f_n,
        left.tau_n,
        right.tau_n,
        math.hypot(left.f_x + right.f_x, left.f_y + right.f_y),
        left.least + right.least,
        left.f_t / contact.mu + right.f_t / contact.mu,
        left.cautious + right.cautious,
        left.reserved + right.reserved,
        math.sqrt(left.least_variance + right.least_variance),
        f_nd,
        along,
        2.0 * (abs(fast[1, 2] - slow[1, 2]) - band[1, 2]),
        across,
        together,
        contact_jump,
    )
    return loads, state


@njit(cache=True)
def _loads_of(wrench, variance, contact, unknown):  # type: ignore[no-untyped-def]
    """Loads of one finger, and the grasp force that they need."""
    mu, torsion, gamma = contact.mu, contact.torsion, contact.gamma
    f, tau, load = contact.f, contact.tau, contact.load
    f_n, f_x, f_y, tau_n = loads_of_finger(wrench)
    # Noise biases magnitudes upwards: its variance is subtracted from their squares.
    f_t = math.sqrt(max(f_x * f_x + f_y * f_y - variance[0] - variance[1], 0.0))
    lever = f_t / max(f_n, PRESSING)
    tau_variance = variance[5] + lever * lever * variance[4]
    tau_n = math.copysign(math.sqrt(max(tau_n * tau_n - tau_variance, 0.0)), tau_n)
    least, s = least_force_of_finger(f_t, tau_n, mu, torsion, gamma, f, tau, load)
    by_force = least_force_of_finger(f_t + math.sqrt(variance[0]), tau_n, mu, torsion, gamma, f, tau, load)[0]
    noisy_tau = abs(tau_n) + math.sqrt(tau_variance)
    by_moment = least_force_of_finger(f_t, noisy_tau, mu, torsion, gamma, f, tau, load)[0]
    least_variance = (by_force - least) ** 2 + (by_moment - least) ** 2
    worst_case_f_t = f_t + 0.5 * unknown.push
    pushed_tau = abs(tau_n) + 0.5 * unknown.push * unknown.push_lever
    reserved = least_force_of_finger(worst_case_f_t, pushed_tau, mu, torsion, gamma, f, tau, load)[0]
    worst_case_tau = max(abs(tau_n), f_t * unknown.lever)
    cautious = least_force_of_finger(worst_case_f_t, worst_case_tau, mu, torsion, gamma, f, tau, load)[0]
    # Centre of rotation at the onset of sliding, and what friction bears there.
    pressing = max(f_n, 0.05)
    u = s * (f.size - 1)
    j = min(int(u), f.size - 2)
    f_tilde = f[j] + (u - j) * (f[j + 1] - f[j])
    tau_tilde = tau[j] + (u - j) * (tau[j + 1] - tau[j])
    if s >= 1.0:
        centre = unknown.farthest_centre
    elif contact.ellipsoid:
        centre = torsion * pressing**gamma / mu * math.tan(0.5 * math.pi * s)
    else:
        centre = contact.delta * pressing**gamma * s / (1.0 - s)
    return _FingerLoads(
        f_n, f_x, f_y, f_t, tau_n, least, least_variance, cautious, reserved,
        min(centre, unknown.farthest_centre), torsion * pressing ** (gamma + 1.0) * tau_tilde, mu * pressing * f_tilde,
    )  # fmt: skip


@njit(cache=True)
def _observe(left, right, periods, centre_share, observer, state):  # type: ignore[no-untyped-def]
    """(state, dynamic term [N]) after the periods that a sample stands for."""
    centre = 0.5 * left.centre + 0.5 * right.centre
    if state.started:
        centre = state.centre + min(periods * centre_share, 1.0) * (centre - state.centre)
    y = abs(left.tau_n) + abs(right.tau_n) + centre * (left.f_t + right.f_t)
    g = left.friction_torque + right.friction_torque + centre * (left.friction_force + right.friction_force)
    omega, z, integral = state.omega, state.z, state.integral
    if not state.started:
        omega, z, integral = 0.0, y / observer.sigma0, 0.0
    J = observer.inertia + observer.mass * (centre + observer.offset) ** 2
    before = omega
    f_nd = 0.0
    for _ in range(periods * observer.substeps):
        omega, z = observe(omega, z, y, g, J, observer.sigma0, observer.beta, observer.gain, observer.step)
        integral, f_nd = answer_slip(
            integral, before, omega, observer.kp, observer.ki, observer.kdc, observer.bound, observer.step
        )
        before = omega
    return SlipState(True, omega, z, integral, centre), f_nd


@njit(cache=True)
def _jumps_of_one_finger(fast, slow, band, unknown):  # type: ignore[no-untyped-def]
    """How far one finger's tangential and normal force have jumped beyond noise while the other feels nothing [N], and
    how far a contact has broken or formed."""
    tangential = normal = contact = 0.0
    for finger in range(2):
        sign = 1.0 if finger == 0 else -1.0
        jumped = pressed = 0.0
        other = 0.0
        for j in range(3):
            alike, apart = fast[0, j] - slow[0, j], fast[1, j] - slow[1, j]
            beyond = band[0, j] + band[1, j]
            if j < 2:
                jumped = max(jumped, abs(alike + sign * apart) - beyond)
            else:
                pressed = abs(alike + sign * apart) - beyond
            other = max(other, abs(alike - sign * apart) - beyond)
        if _is_contact(fast, slow, band, sign, unknown.aside):
            contact = max(contact, jumped, pressed)
        elif other <= unknown.quiet:
            tangential, normal = max(tangential, jumped), max(normal, pressed)
    return tangential, normal, contact


@njit(cache=True)
def _is_contact(fast, slow, band, sign, aside):  # type: ignore[no-untyped-def]
    """Whether a finger's whole load has just come or gone: its jump lies along the load itself.

    The contact of a fruit that slides breaks and forms again within milliseconds, and its force keeps its place on the
    friction cone meanwhile. A channel that is wrong changes alone, across that load.

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
