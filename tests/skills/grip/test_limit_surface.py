"""The limit surface against independent quadrature, published values and a sum over contact elements."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.integrate import quad
from scipy.optimize import brentq

from benchmarks.grasp_mujoco import cone_contact
from benchmarks.grasp_patch import pressure_shares
from pomona.skills.grip.limit_surface import (
    NODES,
    SoftContact,
    least_force,
    least_force_of_finger,
    limit_surface,
    nu,
    surface_table,
    xi,
    xi_nu,
)

SURFACE = limit_surface(np.geomspace(1e-4, 1e4, 4000), 4.0)
FIRST_SET = SoftContact(mu=0.4, delta=0.004353, gamma=0.2569, k=4.0)


def by_adaptive_quadrature(c: float, k: float) -> tuple[float, float]:
    """Both integrals as they are written down, angle inside, with an adaptive rule and no elliptic function."""

    def angular(r: float, numerator: str) -> float:
        def integrand(theta: float) -> float:
            distance = math.sqrt(max(r * r + c * c - 2.0 * r * c * math.cos(theta), 1e-300))
            over = r * math.cos(theta) - c if numerator == "f" else r - c * math.cos(theta)
            return over / distance

        return 2.0 * quad(integrand, 0.0, math.pi, limit=400, epsabs=1e-10, epsrel=1e-10)[0]

    def radial(power: int, numerator: str) -> float:
        def integrand(r: float) -> float:
            return r**power * (1.0 - r**k) ** (1.0 / k) * angular(r, numerator)

        points = [c] if 0.0 < c < 1.0 else None
        return quad(integrand, 0.0, 1.0, points=points, limit=200, epsabs=1e-8, epsrel=1e-8)[0]

    return abs(xi(k) / math.pi * radial(1, "f")), radial(2, "tau") / (2.0 * math.pi * nu(k))


def test_the_factors_of_the_pressure_are_the_published_ones() -> None:
    assert xi(4.0) == pytest.approx(1.1441396, abs=1e-7)
    assert nu(4.0) == pytest.approx(0.2776802, abs=1e-7)
    assert xi_nu(4.0) == pytest.approx(0.3177049, abs=1e-7)
    assert xi(4.0) * nu(4.0) == pytest.approx(xi_nu(4.0), rel=1e-12)


@pytest.mark.parametrize(("c", "f", "tau"), [(0.5, 0.509432, 0.803746), (2.0, 0.970490, 0.183837)])
def test_the_surface_has_the_published_points(c: float, f: float, tau: float) -> None:
    assert limit_surface(c, 4.0) == (pytest.approx(f, abs=1e-6), pytest.approx(tau, abs=1e-6))


@pytest.mark.parametrize(
    ("c", "k"), [(0.05, 2.0), (0.5, 4.0), (0.97, 3.0), (1.0, 4.0), (1.3, 1.5), (4.0, 8.0)]
)
def test_the_integrals_agree_with_adaptive_quadrature(c: float, k: float) -> None:
    f, tau = limit_surface(c, k)
    expected_f, expected_tau = by_adaptive_quadrature(c, k)
    assert float(f) == pytest.approx(expected_f, abs=1e-6)
    assert float(tau) == pytest.approx(expected_tau, abs=1e-6)


@given(c=st.floats(0.0, 200.0), k=st.sampled_from([1.0, 1.3, 2.0, 4.0, 7.7, 31.0, 100.0]))
@settings(max_examples=100)
def test_the_table_is_within_a_ten_thousandth_for_any_pressure(c: float, k: float) -> None:
    table = surface_table(SoftContact(k=k))
    s = np.linspace(0.0, 1.0, NODES)
    f, tau = (np.interp(c / (1.0 + c), s, each) for each in (table.f, table.tau))
    exact_f, exact_tau = limit_surface(c, k)
    assert abs(f - exact_f) < 1e-4
    assert abs(tau - exact_tau) < 1e-4


@pytest.mark.parametrize("k", [1.0, 2.0, 4.0, 30.0, 100.0])
def test_the_table_is_monotone(k: float) -> None:
    table = surface_table(SoftContact(k=k))
    assert (np.diff(table.f) > 0.0).all()
    assert (np.diff(table.tau) < 0.0).all()
    assert (np.diff(table.load[:-1]) > 0.0).all()


def test_the_least_force_of_the_published_load() -> None:
    f_n = float(least_force(1.0, 0.005, FIRST_SET))
    assert f_n == pytest.approx(4.240889, abs=1e-4)
    s = least_force_of_finger(1.0, 0.005, surface_table(FIRST_SET))[1]
    assert s / (1.0 - s) == pytest.approx(
        0.588550, abs=1e-4
    )  # distance of the centre of rotation, over the radius


@given(
    f_t=st.floats(0.01, 10.0),
    tau_n=st.floats(1e-5, 0.05),
    mu=st.floats(0.2, 1.2),
    gamma=st.floats(0.0, 0.4),
    ellipsoid=st.booleans(),
)
@settings(max_examples=150)
def test_the_least_force_puts_the_load_onto_the_surface(
    f_t: float, tau_n: float, mu: float, gamma: float, ellipsoid: bool
) -> None:
    contact = SoftContact(mu=mu, gamma=gamma, ellipsoid=ellipsoid)
    f_n = float(least_force(f_t, tau_n, contact))
    f, tau = f_t / (mu * f_n), tau_n / (contact.torsion * f_n ** (gamma + 1.0))
    if ellipsoid:
        assert math.hypot(f, tau) == pytest.approx(1.0, abs=1e-4)
    else:
        assert np.hypot(SURFACE[0] - f, SURFACE[1] - tau).min() < 2e-3


def test_a_force_alone_needs_coulombs_force_and_a_moment_alone_the_torsional_one() -> None:
    assert float(least_force(1.2, 0.0, FIRST_SET)) == pytest.approx(1.2 / 0.4)
    f_n = float(least_force(0.0, 0.004, FIRST_SET))
    assert FIRST_SET.torsion * f_n**1.2569 == pytest.approx(0.004)
    assert float(least_force(0.0, 0.0, FIRST_SET)) == 0.0


@given(mu=st.floats(0.3, 1.0), f_t=st.floats(0.0, 5.0), tau_n=st.floats(0.0, 0.02))
@settings(max_examples=60)
def test_linear_torsion_is_the_simulators_elliptic_cone(
    mu: float, f_t: float, tau_n: float
) -> None:
    contact = cone_contact(mu, 0.003)
    cone = math.hypot(f_t / mu, tau_n / 0.003)
    assert float(least_force(f_t, tau_n, contact)) == pytest.approx(cone, rel=1e-4, abs=1e-9)


@given(f_t=st.floats(0.01, 3.0), tau_n=st.floats(1e-4, 0.01), more=st.floats(1.01, 2.0))
@settings(max_examples=60)
def test_more_load_needs_more_force(f_t: float, tau_n: float, more: float) -> None:
    assert least_force(f_t * more, tau_n, FIRST_SET) > least_force(f_t, tau_n, FIRST_SET)
    assert least_force(f_t, tau_n * more, FIRST_SET) > least_force(f_t, tau_n, FIRST_SET)
    assert least_force(-f_t, -tau_n, FIRST_SET) == least_force(f_t, tau_n, FIRST_SET)


def test_elements_of_a_contact_slide_on_the_surface() -> None:
    x, z, share = pressure_shares(4.0)
    for c in (0.5, 1.0, 2.0):
        speed = np.hypot(z, x - c)
        f = np.sum(share * (x - c) / speed)
        tau = np.sum(share * (z * z + x * (x - c)) / speed)
        exact_f, exact_tau = limit_surface(c, 4.0)
        assert abs(f) == pytest.approx(float(exact_f), abs=4e-3)
        assert tau == pytest.approx(2.0 * xi_nu(4.0) * float(exact_tau), abs=4e-3)


def test_friction_that_makes_no_sense_is_refused() -> None:
    with pytest.raises(ValueError, match="mu of a soft contact"):
        SoftContact(mu=-0.1)
    with pytest.raises(ValueError, match="k of a soft contact"):
        SoftContact(k=float("nan"))


def test_the_table_agrees_with_a_root_finder_on_the_exact_integrals() -> None:
    """Newton or bisection: the same point of the surface."""
    sigma = 2.0 * xi_nu(4.0) * FIRST_SET.delta / 0.4**0.2569 * 1.0 / 0.005

    def residual(c: float) -> float:
        f, tau = limit_surface(c, 4.0)
        return float(f) ** 1.2569 / float(tau) - sigma

    c = brentq(residual, 1e-3, 10.0, xtol=1e-12)
    f, _ = limit_surface(c, 4.0)
    assert float(least_force(1.0, 0.005, FIRST_SET)) == pytest.approx(
        1.0 / (0.4 * float(f)), rel=1e-4
    )
