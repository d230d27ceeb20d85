"""Compiled parts of `estimate_sample`: loads and jumps of the fingers, reserve, slip. No argument is changed."""

from __future__ import annotations

import math
from typing import NamedTuple

from pomona.executive.values.numba_kernel import kernel
from pomona.skills.grip.limit_surface import least_force_of_finger
from pomona.skills.grip.observer import answer_slip, observe
from pomona.skills.grip.pads import LEVER_LOAD, PRESSING, loads_of_finger


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


@kernel()
def remaining_reserve(memory, allowance):  # type: ignore[no-untyped-def]
    """Reserve that is left [N] and its lever [m].

    A measured push is subtracted, so that it is not counted twice. The lever is that of the calm load: a push at the
    fruit's centre is many times the weight of a light fruit, whose lever is below the noise of a sample.
    """
    if allowance.reserve == 0.0 or memory.f_t_calm < LEVER_LOAD:
        return allowance.reserve, allowance.lever
    pushed = max(memory.f_t - memory.f_t_calm, 0.0) if memory.push_left > 0.0 else 0.0
    return max(allowance.reserve - pushed, 0.0), memory.tau_calm / memory.f_t_calm


@kernel()
def calm_load(f_t, tau_n, push_now, periods, memory, rates, filters):  # type: ignore[no-untyped-def]
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


@kernel()
def loads_in_noise(wrench, variance, friction, unknown):  # type: ignore[no-untyped-def]
    """Loads of one finger, and the grip forces that they need."""
    lever_of_centre, push, push_lever, farthest = unknown
    mu = friction.mu
    torsion = friction.torsion
    gamma = friction.gamma
    f = friction.f
    tau = friction.tau
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
    return _FingerLoads(
        f_n, f_x, f_y, f_t, tau_n, least, least_variance, cautious, reserved, *at_centre
    )


@kernel()
def observe_finger_loads(left, right, periods, rates, observer, dynamic, memory):  # type: ignore[no-untyped-def]
    """(omega, z, integral, centre, dynamic term [N]) after the periods of a sample."""
    centre = 0.5 * left.centre + 0.5 * right.centre
    if memory.is_started:
        centre = memory.centre + min(periods * rates.centre, 1.0) * (centre - memory.centre)
    y = abs(left.tau_n) + abs(right.tau_n) + centre * (left.f_t + right.f_t)
    g = (
        left.friction_torque
        + right.friction_torque
        + centre * (left.friction_force + right.friction_force)
    )
    omega = memory.omega
    z = memory.z
    integral = memory.integral
    if not memory.is_started:
        omega = 0.0
        z = y / observer.sigma0
        integral = 0.0
    J = observer.inertia + observer.mass * (centre + observer.offset) ** 2
    before = omega
    f_nd = 0.0
    for _ in range(periods * rates.substeps):
        omega, z = observe(omega, z, y, g, J, observer, rates.step)
        integral, f_nd = answer_slip(integral, before, omega, dynamic, rates.step)
        before = omega
    return omega, z, integral, centre, f_nd


@kernel()
def jumps_of_one_finger(memory, fast, slow, periods, noise, rates, filters):  # type: ignore[no-untyped-def]
    """Jumps of one finger beyond noise [N], and the recent maximum of each finger's changes [N].

    The jumps are (tangential, normal) while the other finger is quiet, and that of a contact. A finger
    that swings passes through its average: its recent changes show that it is not quiet.
    """
    left = _changes(fast, slow, noise.band, 1.0)
    right = _changes(fast, slow, noise.band, -1.0)
    kept = math.exp(-periods * rates.period / filters.swing_memory)
    change_left = max(max(left), kept * memory.change_left)
    change_right = max(max(right), kept * memory.change_right)
    tangential = normal = contact = 0.0
    sides = ((1.0, left, max(right), change_right), (-1.0, right, max(left), change_left))
    for sign, (jumped, pressed), other, other_recent in sides:
        if is_contact(fast, slow, noise.band, sign, filters.aside):
            contact = max(contact, jumped, pressed)
        elif other <= filters.quiet and other_recent <= max(
            filters.quiet, filters.swing * max(jumped, pressed)
        ):
            normal = max(normal, pressed)
            tangential = max(tangential, jumped)
    return (tangential, normal, contact), change_left, change_right


@kernel()
def _changes(fast, slow, band, sign):  # type: ignore[no-untyped-def]
    """Fast changes of a finger's tangential and normal force beyond noise [N]; `sign` as in `is_contact`."""
    tangential = normal = 0.0
    for j in range(3):
        change = (
            abs(fast[0, j] - slow[0, j] + sign * (fast[1, j] - slow[1, j]))
            - band[0, j]
            - band[1, j]
        )
        if j < 2:
            tangential = max(tangential, change)
        else:
            normal = change
    return tangential, normal


@kernel()
def is_contact(fast, slow, band, sign, aside):  # type: ignore[no-untyped-def]
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
