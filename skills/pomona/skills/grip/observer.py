"""Slip velocity by a LuGre observer on the limit surface of a planar slider, and the grasp force that answers it.

    J dω/dt = -β ω - σ0 z + u + J l (y - ŷ),   dz/dt = ω - (σ0 / g) |ω| z,   ŷ = σ0 z + β ω,   u = y

y is the generalised torque that the fruit puts on the pads about its centre of rotation [N·m], g the largest that
friction can bear, J the fruit's inertia about that centre. Integrated with Runge-Kutta 4 at about 2 kHz, input held
over a sample. It starts at rest under the first load: z = y / σ0, ω = 0.

The dynamic term is f_nd = |C_d ω̂| with C_d(s) = kp + ki / (s + ki / kdc), the paper's eq. (fnd): a proportional
part and a leaky integrator (Tustin, at the observer's step) whose gain at rest is kdc. The integrator is
clamped to the same bound as the sum, so it never winds up.
"""

from __future__ import annotations

from typing import NamedTuple

from pomona.executive.values.numba_kernel import kernel

STEP = 5e-4  # step of the integration [s], rounded to a whole number of steps in a sample
LEAST_G = 1e-3  # lower bound of the friction [N·m]

STIFFEST = 2.0  # bound of the bristles' relaxation in a step: the explicit integration stays stable
FASTEST = 50.0  # bound of the estimate [rad/s]


class ObserverSettings(NamedTuple):
    """Constants of the observer; general values of the controller's authors."""

    sigma0: float = 50.0  # stiffness of the bristles [N·m/rad]
    beta: float = 0.02  # viscous friction [N·m·s/rad]
    inertia: float = 7.4e-4  # of the fruit about its own centre [kg·m²]
    mass: float = 0.35  # assumed mass of the fruit [kg]
    offset: float = 0.0  # b, distance from the contact's centre to the fruit's centre [m]
    gain: float = 1000.0  # l, of the output's error [1/s]


@kernel()
def _rates(omega, z, y, g, J, settings, stiffest):  # type: ignore[no-untyped-def]
    y_hat = settings.sigma0 * z + settings.beta * omega
    relaxation = min(settings.sigma0 / g * abs(omega), stiffest)
    return (y - y_hat) * (1.0 / J + settings.gain), omega - relaxation * z


@kernel()
def observe(omega, z, y, g, J, settings, step):  # type: ignore[no-untyped-def]
    """Return (omega, z) one step [s] later; -βω - σ0 z + u is y - ŷ since u = y."""
    g = max(g, LEAST_G)
    stiffest = STIFFEST / step
    a1, b1 = _rates(omega, z, y, g, J, settings, stiffest)
    a2, b2 = _rates(omega + 0.5 * step * a1, z + 0.5 * step * b1, y, g, J, settings, stiffest)
    a3, b3 = _rates(omega + 0.5 * step * a2, z + 0.5 * step * b2, y, g, J, settings, stiffest)
    a4, b4 = _rates(omega + step * a3, z + step * b3, y, g, J, settings, stiffest)
    omega += step / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
    z += step / 6.0 * (b1 + 2.0 * b2 + 2.0 * b3 + b4)
    return min(max(omega, -FASTEST), FASTEST), z


def steps_in_a_sample(rate: float) -> int:
    """Return the number of steps of about `STEP` between two samples of a rate [Hz]; at least one."""
    return max(round(1.0 / (rate * STEP)), 1)


class DynamicSettings(NamedTuple):
    """Gains from slip velocity [rad/s] to grasp force [N]."""

    kp: float = 13.0  # proportional [N·s/rad]
    ki: float = 50.0  # integral [N/rad]
    kdc: float = 35.0  # of the integrator at rest [N·s/rad]
    bound: float = 10.0  # largest dynamic term [N]


@kernel()
def answer_slip(integral, omega_before, omega, settings, step):  # type: ignore[no-untyped-def]
    """Return (integral, f_nd) one step [s] later."""
    ki = settings.ki
    bound = settings.bound
    half_leak = 0.5 * step * ki / settings.kdc
    integral = ((1.0 - half_leak) * integral + 0.5 * step * ki * (omega_before + omega)) / (
        1.0 + half_leak
    )
    integral = min(max(integral, -bound), bound)
    return integral, min(abs(settings.kp * omega + integral), bound)
