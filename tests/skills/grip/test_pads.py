"""Loads from wrenches: frames of both pads, place of the contact."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from pomona.skills.grip.pads import MIRROR, loads_of_finger

APPROACH = np.array([0.0, 0.0, -1.0])


def wrench_on_pad(
    normal: np.ndarray, point: np.ndarray, force: np.ndarray, torque: np.ndarray
) -> np.ndarray:
    """Return the wrench of a force at a point and a free torque on a pad with this normal, in its frame."""
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
    tangential, moment, place = (
        np.array([across, 0.0, down]),
        np.array([0.0, twist, 0.0]),
        np.array([x, 0.0, z]),
    )
    first = wrench_on_pad(n, place, tangential - press * n, moment)
    second = wrench_on_pad(-n, place, tangential + press * n, moment)
    for f_n, f_x, f_y, tau_n in (loads_of_finger(first), loads_of_finger(MIRROR * second)):
        assert f_n == pytest.approx(press)
        assert np.hypot(f_x, f_y) == pytest.approx(np.hypot(across, down))
        assert tau_n == pytest.approx(twist, abs=1e-12)


def test_the_moment_is_about_the_contact_and_not_about_the_pads_centre() -> None:
    n = np.array([0.0, 1.0, 0.0])
    wrench = wrench_on_pad(n, np.array([0.005, 0.0, 0.0]), np.array([0.0, -3.0, -2.0]), np.zeros(3))
    assert abs(wrench[5]) == pytest.approx(0.01)
    assert loads_of_finger(wrench)[3] == pytest.approx(0.0, abs=1e-12)
