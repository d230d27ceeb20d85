"""Friction from two slides: results, and refusals."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, strategies as st

from pomona.skills.grip.pads import MIRROR
from pomona.skills.grip.slide import NoSlideError, friction_of_slides


def slid(mu, f_n=(0.4, 0.6), way=1.0, load=0.0, bias=0.0, samples=60, noise=0.0, seed=0):
    """Wrenches of pads that rub along x, the fruit standing; `load` hangs on the fingers besides [N]."""
    rng = np.random.default_rng(seed)
    wrenches = np.zeros((samples, 2, 6))
    for finger in range(2):
        wrenches[:, finger, 2] = -f_n[finger]
        wrenches[:, finger, 0] = way * mu * f_n[finger] + 0.5 * load
    wrenches[:, 1] *= MIRROR
    noises = noise * np.array([1.0, 1.0, 1.0, 0.005, 0.005, 0.005])
    return (
        wrenches
        + bias * np.array([1.0, 1.0, 0.0, 0.0, 0.0, 0.0])
        + rng.normal(0.0, 1.0, wrenches.shape) * noises
    )


@given(
    mu=st.floats(0.2, 2.0),
    first=st.floats(0.2, 3.0),
    second=st.floats(0.2, 3.0),
    bias=st.floats(-0.01, 0.01),
)
def test_friction_is_found_at_any_forces_and_bias(mu, first, second, bias):
    assume(
        abs(bias) < 0.15 * mu * min(first, second)
    )  # beyond, the fruit counts as lifted by the pads
    up, down = (slid(mu, (first, second), way, bias=bias) for way in (1.0, -1.0))
    found = friction_of_slides(up, down)
    assert found.mu == pytest.approx(mu, rel=1e-9)
    assert found.fingers == pytest.approx((mu, mu), rel=1e-9)
    assert found.uncertainty == pytest.approx(0.03)


def test_noise_and_fingers_that_differ_make_it_less_certain():
    up, down = (slid(0.8, way=way, noise=0.04, seed=k) for k, way in enumerate((1.0, -1.0)))
    noisy = friction_of_slides(up, down, bias_std=0.01)
    assert noisy.mu == pytest.approx(0.8, rel=0.03)
    assert 0.03 < noisy.uncertainty < 0.08
    up[:, 0, 0] *= 1.3
    down[:, 0, 0] *= 1.3
    assert friction_of_slides(up, down).uncertainty > 0.1


def test_a_twist_adds_no_friction_since_its_part_is_unknown():
    up, down = slid(0.5), slid(0.5, way=-1.0)
    for wrenches, way in ((up, 1.0), (down, -1.0)):
        wrenches[:, :, 5] += way * 1e-3 * np.array([1.0, -1.0])
    assert friction_of_slides(up, down).mu == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("up", "down", "words"),
    [
        (slid(0.7, samples=18), slid(0.7, way=-1.0), "only 18 and 60 samples"),
        (
            slid(0.7, f_n=(0.05, 0.6)),
            slid(0.7, f_n=(0.05, 0.6), way=-1.0),
            "presses with 0.05 N, at least",
        ),
        (
            np.concatenate([slid(0.3, samples=30), slid(0.7, samples=30)]),
            np.concatenate([slid(0.3, way=-1.0, samples=30), slid(0.7, way=-1.0, samples=30)]),
            "still changed from 0.30 to 0.70",
        ),
    ],
)
def test_where_the_pads_did_not_slide_nothing_is_said(up, down, words):
    with pytest.raises(NoSlideError, match=words):
        friction_of_slides(up, down)


@given(
    mu=st.floats(0.3, 1.2),
    tilt=st.floats(-0.04, 0.04),
    f_up=st.floats(0.3, 1.0),
    f_down=st.floats(0.3, 2.0),
)
def test_pads_that_are_not_square_to_the_skin_cancel_whatever_presses_on_either_way(
    mu, tilt, f_up, f_down
):
    up, down = slid(mu + tilt, (f_up, f_up)), slid(mu - tilt, (f_down, f_down), way=-1.0)
    found = friction_of_slides(up, down)
    assert found.mu == pytest.approx(mu, rel=1e-9)
    assert not found.came_along


def test_of_a_fruit_that_came_along_the_way_down_counts_and_is_less_certain():
    up, down = slid(0.25), slid(0.8, way=-1.0)
    found = friction_of_slides(up, down)
    assert found.came_along
    assert found.mu == pytest.approx(0.8)
    assert found.uncertainty == pytest.approx(0.05)
