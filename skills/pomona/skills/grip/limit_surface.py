"""Limit surface of a soft finger: tangential force and torsional moment that a contact can bear together.

The contact is a disc of radius rho = delta * f_n**gamma with the pressure p(r) ~ (1 - r**k)**(1/k), r in units of rho.
It slides about an instantaneous centre of rotation at the distance c from its centre; c_tilde = c / rho. Friction then
bears the fractions f_tilde(c_tilde) of mu * f_n and tau_tilde(c_tilde) of tau_max(f_n), where

    tau_max = 2 * mu * xi_nu * delta * f_n**(gamma + 1).

Both are exact (elliptic integrals in the angle, quadrature in the radius). Signs are left out: f_tilde and tau_tilde
are magnitudes, rising from 0 to 1 and falling from 1 to 0 with c_tilde. With gamma = 0 tau_max is linear in f_n.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from pomona.executive.values.arrays import Float64
from pomona.executive.values.later import Later
from pomona.executive.values.numba_kernel import kernel

special: Any = Later("scipy.special")

# nodes of the table, uniform in c_tilde / (1 + c_tilde), within 1e-5 of the exact surface
NODES = 1025


@dataclass(frozen=True, slots=True)
class SoftContact:
    """Friction between one finger's pad and a fruit.

    Attributes:
        mu: friction coefficient.
        delta: contact radius at 1 N [m / N**gamma].
        gamma: exponent of the radius over the normal force; 0 makes the torsional limit linear in the force.
        k: shape of the pressure: 2 is Hertz's, larger is flatter.
        ellipsoid: True for the ellipsoidal approximation of the limit surface.
    """

    mu: float = 0.8
    delta: float = 0.004353
    gamma: float = 0.2569
    k: float = 4.0
    ellipsoid: bool = False

    def __post_init__(self) -> None:
        for name, value, low, high in (
            ("mu", self.mu, 1e-3, 10.0),
            ("delta", self.delta, 1e-6, 1.0),
            ("gamma", self.gamma, 0.0, 1.0),
            ("k", self.k, 1.0, 100.0),
        ):
            if not low <= value <= high:
                raise ValueError(
                    f"{name} of a soft contact must lie in {low:g} … {high:g}, not {value:g}"
                )

    @property
    def torsion(self) -> float:
        """tau_max at 1 N [N·m / N**(gamma + 1)]."""
        return 2.0 * self.mu * xi_nu(self.k) * self.delta


def xi(k: float) -> float:
    """Peak pressure over mean pressure: p(0) = xi * f_n / (pi * rho**2)."""
    return float(
        1.5 * k * special.gamma(3.0 / k) / (special.gamma(1.0 / k) * special.gamma(2.0 / k))
    )


def nu(k: float) -> float:
    """Integral of r**2 * (1 - r**k)**(1/k) over 0 … 1."""
    return float(special.beta(3.0 / k, 1.0 / k + 1.0) / k)


def xi_nu(k: float) -> float:
    """xi * nu, the factor of tau_max."""
    return float(
        0.375 * special.gamma(3.0 / k) ** 2 / (special.gamma(2.0 / k) * special.gamma(4.0 / k))
    )


def limit_surface(c_tilde: ArrayLike, k: float = 4.0) -> tuple[Float64, Float64]:
    """Return (f_tilde, tau_tilde) by the exact integrals, both of the shape of `c_tilde` (which is >= 0).

    The integral of D = sqrt(r² + c² - 2 r c cos(theta)) over the angle is L = 4 (r + c) E(m), m = 4 r c / (r + c)²; the
    angular parts of the two integrals are -dL/dc and dL/dr. The radius is split at r = c, where they are not smooth.
    """
    c = np.atleast_1d(np.asarray(c_tilde, np.float64))
    c = np.where(c < 1e-12, 0.0, c)  # below, products with the radius would underflow
    u, weight = _tanh_sinh()
    inner = np.minimum(c, 1.0)[:, None]
    f = np.zeros_like(c)
    tau = np.zeros_like(c)
    for low, span in ((0.0 * inner, inner), (inner, 1.0 - inner)):
        r = low + span * u
        pressure = np.maximum(1.0 - r**k, 0.0) ** (1.0 / k)
        dL_dc, dL_dr = _angular(r, c[:, None])
        f += np.sum(weight * span * r * pressure * dL_dc, axis=1)
        tau += np.sum(weight * span * r**2 * pressure * dL_dr, axis=1)
    shape = np.shape(c_tilde)
    f = xi(k) / np.pi * f
    tau = tau / (2.0 * np.pi * nu(k))
    return np.clip(f, 0.0, 1.0).reshape(shape), np.clip(tau, 0.0, 1.0).reshape(shape)


def _angular(r: Float64, c: Float64) -> tuple[Float64, Float64]:
    """dL/dc and dL/dr of L = 4 (r + c) E(m), exact also where m is near 0 or 1."""
    with np.errstate(divide="ignore", invalid="ignore"):
        one_minus_m = ((r - c) / (r + c)) ** 2
        m = np.minimum(4.0 * (r / (r + c)) * (c / (r + c)), 1.0)
        E = special.ellipe(m)
        K = special.ellipkm1(np.maximum(one_minus_m, 1e-300))
        difference = np.where(m > 1e-6, E - K, -np.pi / 4.0 * m * (1.0 + 3.0 / 8.0 * m))
        dL_dc = np.where(c > 0.0, 4.0 * E + 2.0 * difference * (r - c) / c, 0.0)
        dL_dr = np.where(r > 0.0, 4.0 * E + 2.0 * difference * (c - r) / r, 0.0)
    return dL_dc, dL_dr


@lru_cache(maxsize=1)
def _tanh_sinh() -> tuple[Float64, Float64]:
    """Nodes in (0, 1) and weights of the double exponential rule, which is exact with singularities at the ends."""
    t = np.linspace(-3.1, 3.1, 125)
    a = 0.5 * np.pi * np.sinh(t)
    node = 1.0 / (1.0 + np.exp(-2.0 * a))
    weight = (t[1] - t[0]) * 0.25 * np.pi * np.cosh(t) / np.cosh(a) ** 2
    return node, weight


class SurfaceTable(NamedTuple):
    """Contact with its limit surface over s = c_tilde / (1 + c_tilde), uniform in 0 … 1, as compiled code takes it.

    Attributes:
        mu, gamma, delta, is_ellipsoid: of the contact.
        torsion: tau_max at 1 N [N·m / N**(gamma + 1)].
        f, tau: f_tilde, rising from 0 to 1, and tau_tilde, falling from 1 to 0, shape (NODES,).
        load: f**(gamma + 1) / tau, rising from 0 to infinity, shape (NODES,).
    """

    mu: float
    torsion: float
    gamma: float
    delta: float
    is_ellipsoid: bool
    f: Float64
    tau: Float64
    load: Float64


@lru_cache(maxsize=32)
def _unit_surface(k: float, ellipsoid: bool) -> tuple[Float64, Float64]:
    s = np.linspace(0.0, 1.0, NODES)
    if ellipsoid:
        f = np.sin(0.5 * np.pi * s)
        tau = np.cos(0.5 * np.pi * s)
    else:
        f = np.ones(NODES)
        tau = np.zeros(NODES)
        f[:-1], tau[:-1] = limit_surface(s[:-1] / (1.0 - s[:-1]), k)
    f[0], tau[0], f[-1], tau[-1] = 0.0, 1.0, 1.0, 0.0
    return f, tau


def surface_table(contact: SoftContact) -> SurfaceTable:
    """Return the table of a contact; the surface of each k is integrated once.

    The ellipsoid f² + tau² = 1 is tabulated over s too; sliding normal to it puts the centre of rotation at
    c = (tau_max / (mu * f_n)) * f / tau.
    """
    f, tau = _unit_surface(contact.k, contact.ellipsoid)
    load = np.full(NODES, np.inf)
    load[:-1] = f[:-1] ** (contact.gamma + 1.0) / tau[:-1]
    shape = (contact.torsion, contact.gamma, contact.delta, contact.ellipsoid)
    return SurfaceTable(float(contact.mu), *shape, f, tau, load)


@kernel()
def place_on_surface(load, table):  # type: ignore[no-untyped-def]
    """Return (s, f_tilde, tau_tilde) where f**(gamma + 1) / tau = `load`, between the nodes of a table."""
    if load == math.inf:
        return 1.0, 1.0, 0.0
    f = table.f
    tau = table.tau
    exponent = table.gamma + 1.0
    i = min(max(np.searchsorted(table.load, load) - 1, 0), f.size - 2)
    low = 0.0
    high = 1.0
    for _ in range(40):
        u = 0.5 * (low + high)
        if (f[i] + u * (f[i + 1] - f[i])) ** exponent < load * (tau[i] + u * (tau[i + 1] - tau[i])):
            low = u
        else:
            high = u
    u = 0.5 * (low + high)
    return (i + u) / (f.size - 1), f[i] + u * (f[i + 1] - f[i]), tau[i] + u * (tau[i + 1] - tau[i])


@kernel()
def least_force_of_finger(f_t, tau_n, table):  # type: ignore[no-untyped-def]
    """Return (minimum normal force [N], s on the surface) of one finger that bears f_t [N] and tau_n [N·m]."""
    f_t = abs(f_t)
    tau_n = abs(tau_n)
    if f_t <= 1e-12 and tau_n <= 1e-12:
        return 0.0, 0.0
    mu = table.mu
    torsion = table.torsion
    gamma = table.gamma
    load = math.inf
    if tau_n > 1e-12:
        load = torsion / mu ** (gamma + 1.0) * f_t ** (gamma + 1.0) / tau_n
    s, f_tilde, tau_tilde = place_on_surface(load, table)
    if f_tilde > 0.1:
        return f_t / (mu * f_tilde), s
    return (tau_n / (torsion * tau_tilde)) ** (1.0 / (gamma + 1.0)), s


@kernel()
def _least_forces(f_t, tau_n, table, result):  # type: ignore[no-untyped-def]
    for i in range(f_t.size):
        result[i] = least_force_of_finger(f_t[i], tau_n[i], table)[0]


def least_force(f_t: ArrayLike, tau_n: ArrayLike, contact: SoftContact) -> Float64:
    """Return the minimum normal force of one finger for a tangential force and a torsional moment, without margin.

    Args:
        f_t: tangential force [N], any shape and sign.
        tau_n: torsional moment about the contact's normal [N·m], same shape.
        contact: friction of the finger.

    Returns:
        Normal force [N], of the common shape. Static term of the paper's eq. (slip_avoidance_control_law).
    """
    loads, moments = np.broadcast_arrays(np.asarray(f_t, np.float64), np.asarray(tau_n, np.float64))
    result = np.empty(loads.size)
    _least_forces(loads.ravel(), moments.ravel(), surface_table(contact), result)
    return result.reshape(loads.shape)
