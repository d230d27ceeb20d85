"""Dynamic term of the grasp force: f_nd = |C_d ω̂| with C_d(s) = kp + ki / (s + ki / kdc), the paper's eq. (fnd).

A proportional part and a leaky integrator (Tustin, at the observer's step) whose gain at rest is kdc. The integrator is
clamped to the same bound as the sum, so it never winds up.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from pomona.executive.values.arrays import Float64
from pomona.skills.grip.observer import steps_in_a_sample


class DynamicSettings(NamedTuple):
    """Gains from slip velocity [rad/s] to grasp force [N]."""

    kp: float = 13.0  # proportional [N·s/rad]
    ki: float = 50.0  # integral [N/rad]
    kdc: float = 35.0  # of the integrator at rest [N·s/rad]
    bound: float = 10.0  # largest dynamic term [N]


GENTLE = DynamicSettings(kp=1.3, ki=5.0, kdc=7.0)  # for fruit that bruises easily


@njit(cache=True)
def answer_slip(integral, omega_before, omega, settings, step):  # type: ignore[no-untyped-def]
    """Return (integral, f_nd) one step [s] later."""
    ki, bound = settings.ki, settings.bound
    half_leak = 0.5 * step * ki / settings.kdc
    integral = ((1.0 - half_leak) * integral + 0.5 * step * ki * (omega_before + omega)) / (1.0 + half_leak)
    integral = min(max(integral, -bound), bound)
    return integral, min(abs(settings.kp * omega + integral), bound)


@njit(cache=True)
def _answer_all(omega, settings, substeps, step, result):  # type: ignore[no-untyped-def]
    integral, before = 0.0, 0.0
    for i in range(omega.size):
        for _ in range(substeps):
            integral, result[i] = answer_slip(integral, before, omega[i], settings, step)
            before = omega[i]


def dynamic_force(omega: ArrayLike, settings: DynamicSettings, rate: float = 500.0) -> Float64:
    """Return f_nd [N], shape (n,), for slip velocities [rad/s] that are held over each sample of `rate`, from rest."""
    velocities = np.ascontiguousarray(omega, np.float64)
    result = np.empty(velocities.size)
    substeps = steps_in_a_sample(rate)
    step = 1.0 / rate / substeps
    _answer_all(velocities, settings, substeps, step, result)
    return result
