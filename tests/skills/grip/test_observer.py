"""The observer against a general solver and its steady states; C_d against its transfer function."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import bilinear, lfilter

from pomona.skills.grip.observer import (
    FASTEST,
    LEAST_G,
    STEP,
    STIFFEST,
    DynamicSettings,
    ObserverSettings,
    answer_slip,
    observe,
    steps_in_a_sample,
)
from tests.skills.grip.observer_arrays import dynamic_force, observe_slip

SETTINGS = ObserverSettings()
INERTIA = 7.4e-4 + 0.35 * 0.01**2


def by_general_solver(y: np.ndarray, g: float) -> np.ndarray:
    """The observer's equations as they are published, with a stiff solver, sample by sample."""
    s = SETTINGS
    state, result = np.array([0.0, y[0] / s.sigma0]), []
    for torque in y:

        def rates(_t: float, x: np.ndarray, u: float = torque) -> list[float]:
            omega, z = x
            y_hat = s.sigma0 * z + s.beta * omega
            force = -s.beta * omega - s.sigma0 * z + u + INERTIA * s.gain * (u - y_hat)
            return [force / INERTIA, omega - s.sigma0 / g * abs(omega) * z]

        state = solve_ivp(rates, (0.0, 0.002), state, method="Radau", rtol=1e-9, atol=1e-12).y[
            :, -1
        ]
        result.append(state[0])
    return np.array(result)


def test_the_observer_solves_its_published_equations() -> None:
    t = np.arange(60) * 0.002
    y = 0.02 + 0.01 * np.clip((t - 0.02) / 0.05, 0.0, 1.0) + 0.002 * np.sin(40.0 * t)
    ours = observe_slip(y, 0.05, INERTIA, SETTINGS)
    assert np.abs(ours - by_general_solver(y, 0.05)).max() < 5e-4 * np.abs(ours).max()


def test_a_constant_load_below_friction_shows_no_slip() -> None:
    assert np.abs(observe_slip(np.full(500, 0.03), 0.05, INERTIA, SETTINGS)).max() < 1e-12


def test_a_load_beyond_friction_shows_the_viscous_sliding_speed() -> None:
    y = np.concatenate([np.full(50, 0.01), np.full(1000, 0.06)])
    omega = observe_slip(y, 0.05, INERTIA, SETTINGS)
    assert omega[-1] == pytest.approx((0.06 - 0.05) / SETTINGS.beta, rel=1e-6)


def test_a_rising_load_shows_before_anything_slides() -> None:
    y = np.linspace(0.0, 0.02, 250)
    omega = observe_slip(y, 1.0, INERTIA, SETTINGS)
    assert omega[-1] == pytest.approx((y[1] - y[0]) / 0.002 / SETTINGS.sigma0, rel=0.05)


def test_the_observer_reproduces_itself() -> None:
    rng = np.random.default_rng(4)
    y, g = rng.uniform(0.0, 0.1, 2000), rng.uniform(0.001, 0.1, 2000)
    first, again = observe_slip(y, g, INERTIA, SETTINGS), observe_slip(y, g, INERTIA, SETTINGS)
    assert np.abs(first - again).max() < 1e-9
    assert np.isfinite(first).all()


@pytest.mark.parametrize("settings", [DynamicSettings(), DynamicSettings(kp=1.3, ki=5.0, kdc=7.0)])
def test_the_dynamic_term_is_its_transfer_function_by_tustin(settings: DynamicSettings) -> None:
    rng = np.random.default_rng(1)
    omega = np.cumsum(rng.normal(0.0, 1e-3, 400))
    leak = settings.ki / settings.kdc
    b, a = bilinear([settings.kp, settings.kp * leak + settings.ki], [1.0, leak], fs=2000.0)
    expected = np.abs(lfilter(b, a, np.repeat(omega, 4)))[3::4]
    assert dynamic_force(omega, settings) == pytest.approx(expected, abs=1e-9)


def test_the_dynamic_term_comes_to_its_gain_at_rest() -> None:
    settings = DynamicSettings()
    force = dynamic_force(np.full(5000, 0.1), settings)
    assert force[-1] == pytest.approx((settings.kp + settings.kdc) * 0.1, rel=1e-3)


def test_the_dynamic_term_saturates_and_does_not_wind_up() -> None:
    settings = DynamicSettings(kp=1.0, ki=200.0, kdc=1000.0, bound=10.0)
    force = dynamic_force(np.concatenate([np.full(2500, 5.0), np.full(2500, -5.0)]), settings)
    assert force.max() <= 10.0
    unwound = int(np.argmax(force[2500:] < 1.0))
    assert unwound * 0.002 < 15.0 / (200.0 * 5.0) + 0.01


@pytest.mark.parametrize("seed", range(8))
def test_a_step_is_one_of_the_classical_method_of_fourth_order(seed: int) -> None:
    rng = np.random.default_rng(seed)
    s, step, g = SETTINGS, 2e-4 * (1 + seed % 3), (0.05, 0.5)[seed % 2]
    y = float(rng.normal(0.0, 0.05))

    def rates(x: np.ndarray) -> np.ndarray:
        omega, z = x
        error = y - s.sigma0 * z - s.beta * omega
        relaxation = min(s.sigma0 / g * abs(omega), STIFFEST / step)
        return np.array([error * (1.0 / INERTIA + s.gain), omega - relaxation * z])

    x = np.array([rng.normal(0.0, 0.5), rng.normal(0.0, 1e-3)])
    found = observe(x[0], x[1], y, g, INERTIA, s, step)
    stages = [rates(x)]
    for part in (0.5, 0.5, 1.0):
        stages.append(rates(x + part * step * stages[-1]))
    after = x + step * np.dot([1 / 6, 1 / 3, 1 / 3, 1 / 6], stages)
    assert found == pytest.approx((np.clip(after[0], -FASTEST, FASTEST), after[1]), rel=1e-9)


def test_the_speed_is_bounded_and_friction_has_a_least_value() -> None:
    for sign in (1.0, -1.0):
        omega, _ = observe(0.0, 0.0, sign * 1e6, 0.05, INERTIA, SETTINGS, 1e-4)
        assert omega == sign * FASTEST
    tiny = observe(0.3, 1e-3, 0.05, 0.0, INERTIA, SETTINGS, 1e-4)
    assert tiny == observe(0.3, 1e-3, 0.05, LEAST_G, INERTIA, SETTINGS, 1e-4)
    assert tiny != observe(0.3, 1e-3, 0.05, 2.0 * LEAST_G, INERTIA, SETTINGS, 1e-4)


@pytest.mark.parametrize("rate", [50.0, 500.0, 1000.0, 1e9])
def test_a_sample_has_a_whole_number_of_steps(rate: float) -> None:
    found = steps_in_a_sample(rate)
    assert found >= 1
    assert found == 1 or abs(found - 1.0 / (rate * STEP)) <= 0.5


def test_the_answer_to_slip_is_a_bounded_leaking_integral_and_a_proportion() -> None:
    s, step = DynamicSettings(), 0.002
    leak = 0.5 * step * s.ki / s.kdc
    integral, force = answer_slip(0.4, 0.1, 0.2, s, step)
    expected = ((1.0 - leak) * 0.4 + 0.5 * step * s.ki * 0.3) / (1.0 + leak)
    assert integral == pytest.approx(expected)
    assert force == pytest.approx(s.kp * 0.2 + expected)
    assert answer_slip(0.4, -0.1, -0.2, s, step)[1] == pytest.approx(
        abs(-s.kp * 0.2 + ((1.0 - leak) * 0.4 - 0.5 * step * s.ki * 0.3) / (1.0 + leak))
    )
    for sign in (1.0, -1.0):
        integral, force = answer_slip(sign * 9.99, sign * 1e3, sign * 1e3, s, step)
        assert (integral, force) == (sign * s.bound, s.bound)
