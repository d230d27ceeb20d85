"""The compiled parts of the estimate, one call each, against figures worked out by hand."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from benchmarks.grasp_mujoco import cone_contact
from pomona.skills.grip.estimate import Allowance, Estimator, Memory, NoiseModel, Rates
from pomona.skills.grip.estimate_kernel import (
    calm_load,
    is_contact,
    jumps_of_one_finger,
    loads_in_noise,
    observe_finger_loads,
    remaining_reserve,
)
from pomona.skills.grip.limit_surface import SoftContact, surface_table
from pomona.skills.grip.observer import DynamicSettings, ObserverSettings
from pomona.skills.grip.settings import FilterSettings, GripSettings

FILTERS = FilterSettings()
RATES = Rates(
    fast=0.3,
    normal=0.03,
    load=0.02,
    centre=0.25,
    rise=0.06,
    calm=0.1,
    period=0.002,
    substeps=4,
    step=0.0005,
)
MU = 0.5
CONE = cone_contact(MU, 0.004)  # least force: hypot(f_t / mu, tau / 4 mm)
TABLE = surface_table(CONE)


def least(f_t: float, tau: float) -> float:
    return math.hypot(f_t / MU, tau / 0.004)


# ------------------------------------------------------------------------------------------- reserve


@pytest.mark.parametrize(
    ("reserve", "memory", "expected"),
    [
        (0.0, Memory(f_t_calm=2.0, tau_calm=0.01), (0.0, 0.005)),  # none: the given lever
        (2.0, Memory(f_t_calm=0.29, tau_calm=0.01), (2.0, 0.005)),  # the lever is unknown
        (2.0, Memory(f_t_calm=0.3, tau_calm=0.003), (2.0, 0.01)),  # known from 0.3 N on
        (2.0, Memory(f_t_calm=2.0, tau_calm=0.01, f_t=3.0), (2.0, 0.005)),  # no push
        (2.0, Memory(f_t_calm=2.0, tau_calm=0.02, f_t=3.5, push_left=0.1), (0.5, 0.01)),
        (2.0, Memory(f_t_calm=2.0, tau_calm=0.02, f_t=1.5, push_left=0.1), (2.0, 0.01)),
        (2.0, Memory(f_t_calm=2.0, tau_calm=0.02, f_t=9.0, push_left=0.1), (0.0, 0.01)),
    ],
)
def test_a_measured_push_is_taken_off_the_reserve(
    reserve: float, memory: Memory, expected: tuple[float, float]
) -> None:
    left = remaining_reserve(memory, Allowance(0.005, reserve))
    assert left == pytest.approx(expected)


@pytest.mark.parametrize(
    ("f_t", "push_now", "push_left", "expected"),
    [
        (3.0, 0.0, 0.0, (2.1, 0.019, 0.0)),  # a tenth of the way, as RATES.calm says
        (3.0, 0.5, 0.0, (2.0, 0.02, 0.996)),  # a push: the averages wait, its second begins
        (3.0, 0.5, 0.4, (2.0, 0.02, 0.996)),  # … anew while it goes on
        (3.0, 0.0, 0.4, (2.0, 0.02, 0.396)),  # the load is not back
        (2.19, 0.0, 0.4, (2.019, 0.019, 0.0)),  # it is, to a tenth
        (2.2, 0.0, 0.4, (2.0, 0.02, 0.396)),
    ],
)
def test_the_calm_load_waits_while_something_pushes(
    f_t: float, push_now: float, push_left: float, expected: tuple[float, float, float]
) -> None:
    memory = Memory(f_t_calm=2.0, tau_calm=0.02, push_left=push_left)
    found = calm_load(f_t, -0.01, push_now, 2, memory, RATES._replace(calm=0.05), FILTERS)
    assert found == pytest.approx(expected)


def test_an_average_over_a_long_gap_is_the_new_load() -> None:
    memory = Memory(f_t_calm=2.0, tau_calm=0.02)
    assert calm_load(3.0, 0.01, 0.0, 50, memory, RATES, FILTERS) == pytest.approx((3.0, 0.01, 0.0))


# --------------------------------------------------------------------------------------------- loads


def loads(
    wrench: list[float],
    variance: list[float] | None = None,
    unknown: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.02),
    contact: SoftContact = CONE,
) -> Any:
    return loads_in_noise(
        np.array(wrench), np.array(variance or [0.0] * 6), surface_table(contact), unknown
    )


def test_loads_of_a_finger_without_noise() -> None:
    found = loads([0.6, -0.8, -4.0, 0.0, 0.0, -0.006])
    assert (found.f_n, found.f_x, found.f_y) == (4.0, 0.6, -0.8)
    assert (found.f_t, found.tau_n) == pytest.approx((1.0, -0.006))
    assert found.least == pytest.approx(least(1.0, 0.006), rel=1e-4)
    assert found.cautious == pytest.approx(found.least)
    assert found.reserved == pytest.approx(found.least)
    assert found.least_variance == pytest.approx(0.0, abs=1e-12)


def test_noise_is_taken_off_the_squares_and_gives_the_variance_of_the_least_force() -> None:
    variance = [0.04, 0.05, 0.0, 0.0, 1e-6, 2e-6]
    found = loads([0.6, 0.8, -4.0, 0.0, 0.0, 0.004], variance)
    f_t = math.sqrt(1.0 - 0.09)
    tau_variance = 2e-6 + (f_t / 4.0) ** 2 * 1e-6
    tau = math.sqrt(0.004**2 - tau_variance)
    assert (found.f_t, found.tau_n) == pytest.approx((f_t, tau))
    assert found.least == pytest.approx(least(f_t, tau), rel=1e-4)
    by_force = least(f_t + 0.2, tau) - least(f_t, tau)
    by_moment = least(f_t, tau + math.sqrt(tau_variance)) - least(f_t, tau)
    assert found.least_variance == pytest.approx(by_force**2 + by_moment**2, rel=1e-3)


def test_what_is_less_than_noise_is_nothing() -> None:
    found = loads([0.1, 0.1, -4.0, 0.0, 0.0, 1e-4], [0.1, 0.1, 0.0, 0.0, 0.0, 1e-6])
    assert (found.f_t, found.tau_n, found.least) == (0.0, 0.0, 0.0)


def test_half_of_a_push_comes_to_each_finger_at_its_lever() -> None:
    found = loads([1.0, 0.0, -4.0, 0.0, 0.0, -0.002], unknown=(0.005, 0.6, 0.01, 0.02))
    assert found.reserved == pytest.approx(least(1.3, 0.005), rel=1e-4)
    assert found.cautious == pytest.approx(least(1.3, 0.005), rel=1e-4)  # 1 N at 5 mm
    found = loads([1.0, 0.0, -4.0, 0.0, 0.0, -0.008], unknown=(0.005, 0.6, 0.0, 0.02))
    assert found.reserved == pytest.approx(least(1.3, 0.008), rel=1e-4)
    assert found.cautious == pytest.approx(least(1.3, 0.008), rel=1e-4)


def test_the_centre_of_an_ellipsoid_is_that_of_its_normal() -> None:
    found = loads([1.0, 0.0, -4.0, 0.0, 0.0, 0.003])
    # f / mu and tau / 4 mm on the circle: c = (tau_max / (mu f_n)) tan, tan = (f / mu) / (tau / 4 mm)
    assert found.centre == 0.02  # 21 mm, beyond the farthest
    found = loads([0.25, 0.0, -4.0, 0.0, 0.0, 0.003])
    tangent = 0.5 / 0.75
    assert found.centre == pytest.approx(0.008 * tangent, rel=1e-3)
    size = math.hypot(0.5, 0.75)
    assert found.friction_torque == pytest.approx(0.016 * 0.75 / size, rel=1e-3)
    assert found.friction_force == pytest.approx(2.0 * 0.5 / size, rel=1e-3)


def test_the_centre_of_a_soft_contact_is_in_its_radius() -> None:
    contact = SoftContact(mu=0.4)
    found = loads([1.0, 0.0, -5.0, 0.0, 0.0, 0.005], contact=contact)
    # The published centre of rotation of this load, over the contact's radius: 0.588550.
    assert found.centre == pytest.approx(0.588550 * contact.delta * 5.0**contact.gamma, rel=1e-3)
    least_force = 4.240889
    assert found.least == pytest.approx(least_force, rel=1e-4)
    torsion = contact.torsion * 5.0 ** (contact.gamma + 1.0)
    at_least = contact.torsion * least_force ** (contact.gamma + 1.0)
    assert found.friction_torque == pytest.approx(torsion * 0.005 / at_least, rel=1e-3)
    assert found.friction_force == pytest.approx(5.0 / least_force, rel=1e-3)


def test_the_centre_of_a_load_without_a_moment_is_the_farthest() -> None:
    for contact in (CONE, SoftContact()):
        assert loads([1.0, 0.0, -4.0, 0.0, 0.0, 0.0], contact=contact).centre == 0.02
    assert loads([1.0, 0.0, -4.0, 0.0, 0.0, 1e-7]).centre == 0.02


def test_a_finger_that_hardly_presses_counts_with_a_twentieth_of_a_newton() -> None:
    found = loads([0.0, 0.0, -0.01, 0.0, 0.0, 0.001])
    assert found.f_n == 0.01
    assert found.friction_torque == pytest.approx(0.05 * 0.004)
    assert found.friction_force == pytest.approx(0.0, abs=1e-12)
    assert found.centre == pytest.approx(0.0, abs=1e-12)


# ------------------------------------------------------------------------------------------ observer


def test_the_observer_starts_at_rest_under_the_first_load() -> None:
    left, right = (
        loads([0.25, 0.0, -4.0, 0.0, 0.0, tau])._replace(centre=centre)
        for tau, centre in ((0.003, 0.004), (-0.002, 0.008))
    )
    settings, dynamic = ObserverSettings(), DynamicSettings()
    omega, z, integral, centre, f_nd = observe_finger_loads(
        left, right, 1, RATES, settings, dynamic, Memory()
    )
    assert centre == pytest.approx(0.006)
    y = 0.005 + 0.006 * 0.5
    # Under a load far below the friction nothing moves: the bristles bear it.
    assert z == pytest.approx(y / settings.sigma0, rel=1e-3)
    assert (omega, integral, f_nd) == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)


def test_the_centre_of_rotation_is_averaged_and_a_load_beyond_friction_slips() -> None:
    heavy = loads([3.0, 0.0, -1.0, 0.0, 0.0, 0.03])._replace(centre=0.008)
    memory = Memory(is_started=True, z=0.0, centre=0.004)
    found = [
        observe_finger_loads(
            heavy, heavy, periods, RATES, ObserverSettings(), DynamicSettings(), memory
        )
        for periods in (1, 2, 5)
    ]
    assert [centre for _, _, _, centre, _ in found] == pytest.approx([0.005, 0.006, 0.008])
    speeds = [omega for omega, _, _, _, _ in found]
    assert 0.0 < speeds[0] < speeds[1]
    for omega, _, integral, _, f_nd in found:
        dynamic = DynamicSettings()
        assert f_nd == pytest.approx(min(dynamic.kp * omega + integral, dynamic.bound))
        assert integral > 0.0


# -------------------------------------------------------------------------------------------- jumps


def modes(left: list[float], right: list[float]) -> np.ndarray:
    """Both fingers' forces as common and differential mode."""
    a, b = np.zeros(6), np.zeros(6)
    a[:3], b[:3] = left, right
    return 0.5 * np.array([a + b, a - b])


BAND = np.zeros((2, 6))
BAND[0, :3], BAND[1, :3] = 0.02, 0.01


def jumps(
    before: tuple[list[float], list[float]],
    after: tuple[list[float], list[float]],
    memory: Memory | None = None,
    periods: int = 1,
) -> Any:
    noise = NoiseModel(np.zeros((2, 6)), BAND, np.zeros(6), 0.0, 0.0, 0.0, 0.0)
    return jumps_of_one_finger(
        memory or Memory(), modes(*after), modes(*before), periods, noise, RATES, FILTERS
    )


STEADY = [0.0, 1.0, -4.0]


@pytest.mark.parametrize("side", [0, 1])
def test_a_jump_of_one_fingers_shear_is_its_excess_over_both_bands(side: int) -> None:
    after = [STEADY, STEADY]
    after[side] = [0.8, 1.0, -4.0]
    (tangential, normal, contact), left, right = jumps((STEADY, STEADY), (after[0], after[1]))
    assert (tangential, normal, contact) == pytest.approx((0.77, 0.0, 0.0))
    assert (left, right)[side] == pytest.approx(0.77)
    assert (left, right)[1 - side] == 0.0


@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("change", [0.6, -0.6])
def test_a_jump_of_one_fingers_press_counts_either_way(side: int, change: float) -> None:
    base = [0.0, 3.0, -1.0]  # pressed across its load
    after = [base, base]
    after[side] = [0.0, 3.0, -1.0 + change]
    (tangential, normal, contact), *_ = jumps((base, base), (after[0], after[1]))
    assert (tangential, normal, contact) == pytest.approx((0.0, 0.57, 0.0))


def test_a_jump_along_the_load_is_a_contact() -> None:
    (tangential, normal, contact), *_ = jumps((STEADY, STEADY), ([0.0, 0.5, -2.0], STEADY))
    assert (tangential, normal) == (0.0, 0.0)
    assert contact == pytest.approx(1.97)


@pytest.mark.parametrize(("other", "alone"), [(0.075, True), (0.09, False)])
def test_a_jump_counts_while_the_other_finger_is_quiet(other: float, alone: bool) -> None:
    after = ([0.8, 1.0, -4.0], [other, 1.0, -4.0])
    (tangential, _, _), *_ = jumps((STEADY, STEADY), after)
    assert bool(tangential > 0.0) is alone


@pytest.mark.parametrize(
    ("recent", "alone"), [(0.04, True), (0.125, True), (0.13, False), (2.0, False)]
)
def test_a_finger_that_swung_lately_is_not_quiet(recent: float, alone: bool) -> None:
    after = ([0.8, 1.0, -4.0], STEADY)  # 0.77 beyond noise, of which the other may swing 15 %
    memory = Memory(change_left=3.0, change_right=recent)
    (tangential, _, _), left, right = jumps((STEADY, STEADY), after, memory)
    assert bool(tangential > 0.0) is alone
    kept = math.exp(-0.002 / FILTERS.swing_memory)
    assert (left, right) == pytest.approx((3.0 * kept, recent * kept))
    _, left, right = jumps((STEADY, STEADY), after, memory, periods=5)
    assert right == pytest.approx(recent * kept**5)


@pytest.mark.parametrize(
    ("sign", "step", "contact"),
    [
        (1.0, (0.0, 0.5, -2.0), True),  # half of the left finger's load has gone
        (1.0, (0.0, -0.5, 2.0), True),  # … or come
        (1.0, (0.6, 0.0, 0.0), False),  # across it
        (-1.0, (0.0, 0.5, -2.0), False),  # the right finger has not changed
    ],
)
def test_a_contact_breaks_along_its_own_load(
    sign: float, step: tuple[float, float, float], contact: bool
) -> None:
    left = np.array([0.0, 1.0, -4.0])
    slow = modes(list(left), [0.3, 0.0, -4.0])
    fast = modes(list(left + np.array(step)), [0.3, 0.0, -4.0])
    if sign < 0.0:  # the right finger jumps across
        fast = modes(list(left), [0.3, 1.0, -4.0])
    assert bool(is_contact(fast, slow, BAND, sign, FILTERS.aside)) is contact


@pytest.mark.parametrize(("across", "contact"), [(0.17, True), (0.19, False)])
def test_a_contact_may_jump_aside_by_a_share_and_by_noise(across: float, contact: bool) -> None:
    slow = modes([0.0, 0.0, -4.0], [0.0, 0.0, -4.0])
    fast = modes([across, 0.0, -3.0], [0.0, 0.0, -4.0])
    # 0.15 of a jump of 1 N and 0.03 N of noise: 0.182
    assert bool(is_contact(fast, slow, BAND, 1.0, FILTERS.aside)) is contact


def test_both_together_have_the_common_noise_alone() -> None:
    slow = modes([0.0, 0.0, -4.0], [0.0, 0.0, -4.0])
    for across, contact in ((0.16, True), (0.18, False)):
        fast = modes([across, 0.0, -3.0], [across, 0.0, -3.0])
        assert bool(is_contact(fast, slow, BAND, 0.0, FILTERS.aside)) is contact


# ------------------------------------------------------------------------------------- whole samples


def test_weights_are_those_of_the_lags_and_the_rate() -> None:
    rates = Estimator(GripSettings(rate=200.0))._model.rates
    for name in ("fast", "normal", "load", "centre", "rise", "calm"):
        lag = getattr(FILTERS, f"{name}_lag")
        assert getattr(rates, name) == pytest.approx(1.0 - math.exp(-0.005 / lag))
    assert rates.period == 0.005
    assert rates.substeps == 10
    assert rates.step == pytest.approx(0.0005)


def test_calibration_learns_bias_and_noise() -> None:
    rng = np.random.default_rng(3)
    std = np.array([0.05, 0.06, 0.07, 5e-4, 6e-4, 7e-4])
    samples = 0.1 + rng.normal(0.0, 1.0, (4000, 2, 6)) * std
    estimator = Estimator(GripSettings(contact=SoftContact(mu=0.5)))
    estimator.calibrate(samples)
    noise, rates = estimator._model.noise, estimator._model.rates

    def left_of(share: float) -> float:  # variance that a low-pass leaves of white noise
        return share / (2.0 - share)

    half = std**2 / 2.0  # of each mode
    assert estimator.bias == pytest.approx(samples.mean(axis=0))
    assert noise.band == pytest.approx(
        np.tile(2.5 * np.sqrt(half * left_of(rates.fast)), (2, 1)), rel=0.05
    )
    assert noise.variance == pytest.approx(2.0 * half * left_of(rates.load), rel=0.1)
    assert noise.difference_variance == pytest.approx(
        4.0 * half[2] * left_of(rates.normal), rel=0.1
    )
    assert noise.f_n_band == pytest.approx(
        2.0 * math.sqrt(2.0 * 2.0 * std[2] ** 2 * left_of(rates.normal)), rel=0.05
    )
    of_mean = 2.0 * std**2 / 4000.0
    assert noise.bias_std == pytest.approx(
        math.sqrt(of_mean[2] + 0.5 * (of_mean[0] + of_mean[1]) / 0.25), rel=0.05
    )
    assert noise.push == pytest.approx(
        4.0 * math.sqrt((std[0] ** 2 + std[1] ** 2) * left_of(rates.load)), rel=0.05
    )
    assert estimator.estimate.f_n_band == noise.f_n_band
    assert estimator.estimate.bias_std == noise.bias_std
    assert estimator.estimate.f_n == 0.0


def steady(left: list[float], right: list[float], **changes: Any) -> Any:
    """An estimate after one long gap: the filters have arrived."""
    made = Estimator(GripSettings(contact=CONE, **{"offset": 0.0, **changes}))
    made.calibrate(np.zeros((100, 2, 6)))
    made._model = made._model._replace(
        rates=made._model.rates._replace(
            fast=1.0, normal=1.0, load=1.0, centre=1.0, rise=1.0, calm=1.0, substeps=1
        )
    )
    made.advance(np.array([left, right]))
    return made.estimate


def test_an_estimate_adds_both_fingers() -> None:
    # The right pad's y, z and torques x, z point against the left one's.
    found = steady([0.6, 0.3, -4.0, 0.0, 0.0, 0.003], [0.2, 0.1, -3.0, 0.0, 0.0, 0.001])
    assert (found.left, found.right) == (4.0, 3.0)
    assert (found.stronger, found.weaker, found.force_sum) == (4.0, 3.0, 7.0)
    assert found.f_n == pytest.approx(6.0)
    assert found.load == pytest.approx((0.8, 0.2))
    assert found.f_t == pytest.approx(math.hypot(0.8, 0.2))
    assert found.tau_n == pytest.approx(0.002)
    f_left, f_right = math.hypot(0.6, 0.3), math.hypot(0.2, 0.1)
    both = least(f_left, 0.003) + least(f_right, 0.001)
    assert found.f_least == pytest.approx(both, rel=1e-4)
    coulomb = (f_left + f_right) / MU
    assert found.f_coulomb == pytest.approx(coulomb)
    assert found.twist == pytest.approx(both / coulomb - 1.0, rel=1e-3)
    assert found.f_least_rise == pytest.approx(0.0)
    assert not found.one_presses_more
    assert found.unfiltered == pytest.approx([0.4, 0.1, -3.5, 0.0, 0.0, 0.001])
    assert (found.push, found.shear_jump, found.press_jump_of_one) == (0.0, 0.0, 0.0)
    memory = found.memory
    assert memory.is_started
    assert memory.f_t == memory.f_t_before == found.f_t
    assert memory.f_least_before == found.f_least
    assert memory.f_t_calm == pytest.approx(found.f_t)
    assert memory.tau_calm == pytest.approx(0.002)


def test_the_twist_is_bounded_and_the_centre_is_taken_aside_until_the_fruit_is_carried() -> None:
    assert steady([0.1, 0.0, -4.0, 0.0, 0.0, 0.01], [0.0] * 6).twist == FILTERS.twist_bound
    found = steady([1.0, 0.0, -4.0, 0.0, 0.0, 0.0], [1.0, 0.0, -4.0, 0.0, 0.0, 0.0], offset=0.004)
    assert found.f_least == pytest.approx(4.0)
    assert found.f_cautious == pytest.approx(2.0 * least(1.0, 0.004), rel=1e-4)
    assert found.f_reserved == pytest.approx(4.0)


def test_a_carried_load_that_grows_is_a_push_beyond_a_tenth() -> None:
    made = Estimator(GripSettings(contact=CONE))
    made.calibrate(np.zeros((100, 2, 6)))
    made._model = made._model._replace(
        rates=made._model.rates._replace(fast=1.0, normal=1.0, load=1.0, rise=0.5, substeps=1)
    )
    made._model = made._model._replace(noise=made._model.noise._replace(push=0.05))
    wrenches = np.zeros((2, 6))
    wrenches[:, 2], wrenches[:, 0] = -4.0, 0.5
    made.advance(wrenches, 2)
    wrenches[:, 0] = 1.0
    assert made.advance(wrenches.copy(), is_carried=False).push == 0.0
    wrenches[:, 0] = 2.0
    # before: 1 N, then 1.5 N; half of the way to 4 N is 2.75 N
    assert made.advance(wrenches, is_carried=True).push == pytest.approx(4.0 - 1.1 * 2.75 - 0.05)
    assert made.estimate.f_least_rise == pytest.approx(0.5 * (8.0 - 3.0), rel=1e-4)
