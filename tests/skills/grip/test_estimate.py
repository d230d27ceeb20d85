"""The estimate of a grip from noisy wrenches: bias, filters, reserve and pushes."""

from __future__ import annotations

import numpy as np
import pytest

from pomona.skills.grip.estimate import Estimator
from pomona.skills.grip.limit_surface import SoftContact
from pomona.skills.grip.settings import GripSettings


def estimator(reserve: float = 0.0) -> Estimator:
    return Estimator(GripSettings(contact=SoftContact(mu=0.6), offset=0.0, reserve=reserve))


def calibrated(noise: float = 0.0, seed: int = 0) -> tuple[Estimator, np.random.Generator]:
    rng = np.random.default_rng(seed)
    made = estimator()
    made.calibrate(0.1 + rng.normal(0.0, noise, (100, 2, 6)) * [1, 1, 1, 0.005, 0.005, 0.005])
    return made, rng


def test_the_bias_is_removed() -> None:
    made, _ = calibrated()
    for _ in range(200):
        made.advance(np.full((2, 6), 0.1))
    assert made.estimate.f_n == pytest.approx(0.0, abs=1e-12)
    assert made.estimate.f_least == pytest.approx(0.0, abs=1e-9)


def test_the_grasp_force_is_twice_the_smaller_fingers() -> None:
    made, _ = calibrated()
    wrenches = np.full((2, 6), 0.1)
    wrenches[:, 2] -= [1.5, 1.2]
    for _ in range(400):
        made.advance(wrenches)
    assert (made.estimate.left, made.estimate.right) == pytest.approx((1.5, 1.2), abs=1e-6)
    assert made.estimate.f_n == pytest.approx(2.4, abs=1e-6)


def test_noise_hides_a_steady_load_by_less_than_a_twentieth() -> None:
    made, rng = calibrated(noise=0.2)
    wrenches = np.full((2, 6), 0.1)
    wrenches[:, 2] -= 2.0
    wrenches[:, 0] -= 0.8
    seen = []
    for i in range(1500):
        made.advance(wrenches + rng.normal(0.0, 0.2, (2, 6)) * [1, 1, 1, 0.005, 0.005, 0.005])
        if i > 500:
            seen.append((made.estimate.f_n, made.estimate.f_least))
    f_n, least = np.array(seen).T
    assert f_n.mean() == pytest.approx(4.0, rel=0.05)
    assert least.mean() == pytest.approx(2.0 * 0.8 / 0.6, rel=0.05)
    assert least.std() < 0.15


def test_a_jump_shows_within_ten_milliseconds_in_spite_of_noise() -> None:
    made, rng = calibrated(noise=0.2)
    noise = [1, 1, 1, 0.005, 0.005, 0.005]
    quiet, loaded = np.full((2, 6), 0.1), np.full((2, 6), 0.1)
    quiet[:, 2] -= 2.0
    loaded[:, 2] -= 2.0
    loaded[:, 0] -= 1.0
    for _ in range(300):
        made.advance(quiet + rng.normal(0.0, 0.2, (2, 6)) * noise)
    for _ in range(5):
        made.advance(loaded + rng.normal(0.0, 0.2, (2, 6)) * noise)
    assert made.estimate.f_t > 1.2


def follow_closing_fingers(told: float, noise: float = 0.0) -> float:
    """Return the largest error of the estimated grip force [N] while it rises with 20 N/s and `told` of that is
    expected.
    """
    made, rng = calibrated(noise)
    wrenches, worst = np.full((2, 6), 0.1), 0.0
    wrenches[:, 2] -= 2.0
    for i in range(600):
        closing = 20.0 if i > 400 else 0.0
        wrenches[:, 2] -= 0.5 * closing * 0.002
        measured = wrenches + rng.normal(0.0, noise, (2, 6)) * [1, 1, 1, 0.005, 0.005, 0.005]
        made.advance(measured, 1, told * closing * 0.002)
        if i > 300:
            worst = max(worst, abs(made.estimate.f_n + wrenches[:, 2].sum() - 0.2))
    return worst


def test_the_fingers_own_motion_is_felt_without_lag() -> None:
    assert follow_closing_fingers(told=1.0) < 1e-3
    assert follow_closing_fingers(told=1.0, noise=0.1) < 0.5 * follow_closing_fingers(
        told=0.0, noise=0.1
    )


def test_pads_half_as_stiff_as_configured_are_measured_no_worse_than_without_a_value() -> None:
    assert follow_closing_fingers(told=2.0, noise=0.1) < 1.1 * follow_closing_fingers(
        told=0.0, noise=0.1
    )


def test_a_push_that_is_reserved_for_has_the_lever_of_the_load() -> None:
    plumb, aside = (estimator(reserve=2.0) for _ in "12")
    for made, tau in ((plumb, 0.0), (aside, 0.005)):
        made.calibrate(np.zeros((100, 2, 6)))
        wrenches = np.zeros((2, 6))
        wrenches[:, 2] = -4.0
        wrenches[:, 0] = 0.5
        wrenches[:, 5] = [tau, -tau]
        for _ in range(500):
            made.advance(wrenches)
    assert plumb.estimate.f_reserved == pytest.approx(3.0 * plumb.estimate.f_least, rel=1e-3)
    assert aside.estimate.f_reserved > 2.2 * aside.estimate.f_least
    assert aside.estimate.f_reserved - plumb.estimate.f_reserved > 2.0 * (
        aside.estimate.f_least - plumb.estimate.f_least
    )


def test_a_push_that_has_come_is_not_reserved_for_twice_until_it_lasts() -> None:
    made = estimator(reserve=2.0)
    made.calibrate(np.zeros((100, 2, 6)))
    wrenches = np.zeros((2, 6))
    wrenches[:, 2] = -8.0

    def bear(f_t: float, seconds: float) -> None:
        wrenches[:, 0] = 0.5 * f_t
        for _ in range(round(500 * seconds)):
            made.advance(wrenches, is_carried=True)

    bear(1.0, 2.5)
    calm = made.estimate.f_reserved
    assert calm == pytest.approx(3.0 * made.estimate.f_least, rel=1e-3)
    bear(2.5, 0.02)
    assert made.estimate.push > 0.5
    assert made.estimate.f_reserved == pytest.approx(calm, rel=0.05)
    bear(2.5, 3.0)  # a load after all
    assert made.estimate.push == 0.0
    assert made.estimate.f_reserved == pytest.approx(4.5 / 2.5 * made.estimate.f_least, rel=1e-3)


def test_a_lift_is_no_push() -> None:
    made = estimator(reserve=2.0)
    made.calibrate(np.zeros((100, 2, 6)))
    wrenches = np.zeros((2, 6))
    wrenches[:, 2] = -8.0
    hits = []
    for t in np.arange(1000) / 500:
        wrenches[:, 0] = 0.5 * (
            1.0 + 0.3 * min(max((t - 1.0) / 0.2, 0.0), 1.0)
        )  # 3 m/s² within 0.2 s
        made.advance(wrenches, is_carried=True)
        hits.append(made.estimate.push)
    assert max(hits[400:]) == 0.0


def test_an_estimate_depends_on_the_last_one_and_the_sample_alone() -> None:
    """The same estimate and sample give the same result, and nothing that went in is changed."""
    first, rng = calibrated(noise=0.1)
    samples = rng.normal(0.0, 1.0, (50, 2, 6))
    for wrenches in samples[:25]:
        first.advance(wrenches)
    start = first.estimate
    kept = start.memory.fast.copy()
    once = [first.advance(wrenches).f_least for wrenches in samples[25:]]
    first.estimate = start
    assert [first.advance(wrenches).f_least for wrenches in samples[25:]] == once
    assert (start.memory.fast == kept).all()
