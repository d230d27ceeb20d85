"""Loads from wrenches: frames of both pads, place of the contact, filters."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from pomona.skills.grip.dynamic_term import DynamicSettings
from pomona.skills.grip.limit_surface import SoftContact
from pomona.skills.grip.observer import ObserverSettings
from pomona.skills.grip.pads import pad_loads
from pomona.skills.grip.slip_sense import SlipSense

APPROACH = np.array([0.0, 0.0, -1.0])


def wrench_on_pad(normal: np.ndarray, point: np.ndarray, force: np.ndarray, torque: np.ndarray) -> np.ndarray:
    """What a pad with this outward normal feels, in its own frame, of a force at a point and a free torque."""
    R = np.column_stack([APPROACH, np.cross(normal, APPROACH), normal])
    return np.concatenate([R.T @ force, R.T @ (np.cross(point, force) + torque)])


@given(
    across=st.floats(-2.0, 2.0),
    down=st.floats(-3.0, 3.0),
    press=st.floats(0.5, 10.0),
    twist=st.floats(-0.02, 0.02),
    x=st.floats(-0.008, 0.008),
    z=st.floats(-0.008, 0.008),
)
@settings(max_examples=80)
def test_both_pads_feel_the_same_load_of_a_fruit(
    across: float, down: float, press: float, twist: float, x: float, z: float
) -> None:
    """Half of a fruit's weight and moment on each pad, wherever the contacts are, is the same load on both."""
    n = np.array([0.0, 1.0, 0.0])
    tangential, moment, place = np.array([across, 0.0, down]), np.array([0.0, twist, 0.0]), np.array([x, 0.0, z])
    first = wrench_on_pad(n, place, tangential - press * n, moment)
    second = wrench_on_pad(-n, place, tangential + press * n, moment)
    f_n, f_t, tau_n = pad_loads(np.array([first, second]))
    assert f_n == pytest.approx([press, press])
    assert f_t == pytest.approx(np.full(2, np.hypot(across, down)))
    assert tau_n == pytest.approx(np.full(2, twist), abs=1e-12)


def test_the_moment_is_about_the_contact_and_not_about_the_pads_centre() -> None:
    n = np.array([0.0, 1.0, 0.0])
    wrench = wrench_on_pad(n, np.array([0.005, 0.0, 0.0]), np.array([0.0, -3.0, -2.0]), np.zeros(3))
    assert abs(wrench[5]) == pytest.approx(0.01)
    assert pad_loads(np.array([wrench, wrench]))[2][0] == pytest.approx(0.0, abs=1e-12)


def sense(noise: float = 0.0, seed: int = 0) -> tuple[SlipSense, np.random.Generator]:
    rng = np.random.default_rng(seed)
    made = SlipSense(SoftContact(mu=0.6), ObserverSettings(), DynamicSettings())
    made.calibrate_bias(0.1 + rng.normal(0.0, noise, (100, 2, 6)) * [1, 1, 1, 0.005, 0.005, 0.005])
    return made, rng


def test_the_bias_is_removed() -> None:
    made, _ = sense()
    for _ in range(200):
        made.advance(np.full((2, 6), 0.1))
    assert made.f_n == pytest.approx(0.0, abs=1e-12)
    assert made.least == pytest.approx(0.0, abs=1e-9)


def test_the_grasp_force_is_twice_the_smaller_fingers() -> None:
    made, _ = sense()
    wrenches = np.full((2, 6), 0.1)
    wrenches[:, 2] -= [1.5, 1.2]
    for _ in range(400):
        made.advance(wrenches)
    assert made.finger_forces == pytest.approx((1.5, 1.2), abs=1e-6)
    assert made.f_n == pytest.approx(2.4, abs=1e-6)


def test_noise_hides_a_steady_load_by_less_than_a_twentieth() -> None:
    made, rng = sense(noise=0.2)
    wrenches = np.full((2, 6), 0.1)
    wrenches[:, 2] -= 2.0
    wrenches[:, 0] -= 0.8
    seen = []
    for i in range(1500):
        made.advance(wrenches + rng.normal(0.0, 0.2, (2, 6)) * [1, 1, 1, 0.005, 0.005, 0.005])
        if i > 500:
            seen.append((made.f_n, made.least))
    f_n, least = np.array(seen).T
    assert f_n.mean() == pytest.approx(4.0, rel=0.05)
    assert least.mean() == pytest.approx(2.0 * 0.8 / 0.6, rel=0.05)
    assert least.std() < 0.15


def test_a_jump_shows_within_ten_milliseconds_in_spite_of_noise() -> None:
    made, rng = sense(noise=0.2)
    noise = [1, 1, 1, 0.005, 0.005, 0.005]
    quiet, loaded = np.full((2, 6), 0.1), np.full((2, 6), 0.1)
    quiet[:, 2] -= 2.0
    loaded[:, 2] -= 2.0
    loaded[:, 0] -= 1.0
    for _ in range(300):
        made.advance(quiet + rng.normal(0.0, 0.2, (2, 6)) * noise)
    for _ in range(5):
        made.advance(loaded + rng.normal(0.0, 0.2, (2, 6)) * noise)
    assert made.f_t > 1.2


def follow_closing_fingers(told: float, noise: float = 0.0) -> float:
    """Largest error of the sensed grasp force [N] while it rises with 20 N/s and `told` of that is expected."""
    made, rng = sense(noise)
    wrenches, worst = np.full((2, 6), 0.1), 0.0
    wrenches[:, 2] -= 2.0
    for i in range(600):
        closing = 20.0 if i > 400 else 0.0
        wrenches[:, 2] -= 0.5 * closing * 0.002
        measured = wrenches + rng.normal(0.0, noise, (2, 6)) * [1, 1, 1, 0.005, 0.005, 0.005]
        made.advance(measured, 1, told * closing * 0.002)
        if i > 300:
            worst = max(worst, abs(made.f_n + wrenches[:, 2].sum() - 0.2))
    return worst


def test_the_fingers_own_motion_is_felt_without_lag() -> None:
    assert follow_closing_fingers(told=1.0) < 1e-3
    assert follow_closing_fingers(told=1.0, noise=0.1) < 0.5 * follow_closing_fingers(told=0.0, noise=0.1)


def test_pads_that_are_half_as_stiff_as_told_are_felt_no_worse_than_with_no_word() -> None:
    assert follow_closing_fingers(told=2.0, noise=0.1) < 1.1 * follow_closing_fingers(told=0.0, noise=0.1)


def test_a_push_that_is_reserved_for_has_the_lever_of_the_load() -> None:
    plumb, aside = (SlipSense(SoftContact(mu=0.6), ObserverSettings(), DynamicSettings(), reserve=2.0) for _ in "12")
    for made, tau in ((plumb, 0.0), (aside, 0.005)):
        made.calibrate_bias(np.zeros((100, 2, 6)))
        wrenches = np.zeros((2, 6))
        wrenches[:, 2] = -4.0
        wrenches[:, 0] = 0.5
        wrenches[:, 5] = [tau, -tau]
        for _ in range(500):
            made.advance(wrenches)
    assert plumb.reserved == pytest.approx(3.0 * plumb.least, rel=1e-3)
    assert aside.reserved > 2.2 * aside.least
    assert aside.reserved - plumb.reserved > 2.0 * (aside.least - plumb.least)


def test_a_push_that_has_come_is_not_reserved_for_twice_until_it_lasts() -> None:
    sense = SlipSense(SoftContact(mu=0.6), ObserverSettings(), DynamicSettings(), reserve=2.0)
    sense.calibrate_bias(np.zeros((100, 2, 6)))
    sense.carries = True
    wrenches = np.zeros((2, 6))
    wrenches[:, 2] = -8.0

    def bear(f_t: float, seconds: float) -> None:
        wrenches[:, 0] = 0.5 * f_t
        for _ in range(round(500 * seconds)):
            sense.advance(wrenches)

    bear(1.0, 2.5)
    calm = sense.reserved
    assert calm == pytest.approx(3.0 * sense.least, rel=1e-3)
    bear(2.5, 0.02)
    assert sense.hit > 0.5
    assert sense.reserved == pytest.approx(calm, rel=0.05)
    bear(2.5, 3.0)  # a load after all
    assert sense.hit == 0.0
    assert sense.reserved == pytest.approx(4.5 / 2.5 * sense.least, rel=1e-3)


def test_a_lift_is_no_push() -> None:
    sense = SlipSense(SoftContact(mu=0.6), ObserverSettings(), DynamicSettings(), reserve=2.0)
    sense.calibrate_bias(np.zeros((100, 2, 6)))
    sense.carries = True
    wrenches = np.zeros((2, 6))
    wrenches[:, 2] = -8.0
    hits = []
    for t in np.arange(1000) / 500:
        wrenches[:, 0] = 0.5 * (1.0 + 0.3 * min(max((t - 1.0) / 0.2, 0.0), 1.0))  # 3 m/s² within 0.2 s
        sense.advance(wrenches)
        hits.append(sense.hit)
    assert max(hits[400:]) == 0.0
