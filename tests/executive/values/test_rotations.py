"""Rotations in files and messages, against their closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from executive.values.rotations import from_quaternion, from_rpy, to_quaternion

ANGLES = st.floats(-np.pi, np.pi)
QUATERNIONS = st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=4).filter(lambda q: np.linalg.norm(q) > 1e-3)


def about(axis: int, angle: float) -> np.ndarray:
    i, j = (axis + 1) % 3, (axis + 2) % 3
    R = np.eye(3)
    R[i, i] = R[j, j] = np.cos(angle)
    R[j, i], R[i, j] = np.sin(angle), -np.sin(angle)
    return R


@given(ANGLES, ANGLES, ANGLES)
def test_roll_pitch_yaw_turn_about_the_fixed_axes_x_y_z_in_this_order(roll: float, pitch: float, yaw: float) -> None:
    np.testing.assert_allclose(
        from_rpy((roll, pitch, yaw)), about(2, yaw) @ about(1, pitch) @ about(0, roll), atol=1e-12
    )


@given(QUATERNIONS)
def test_a_quaternion_turns_vectors_as_its_product_does(q: list[float]) -> None:
    v, w = np.array(q[:3]) / np.linalg.norm(q), q[3] / np.linalg.norm(q)
    R = from_quaternion(q)
    for p in np.eye(3):
        np.testing.assert_allclose(R @ p, p + 2.0 * np.cross(v, np.cross(v, p) + w * p), atol=1e-12)


@given(QUATERNIONS)
def test_a_quaternion_comes_back_with_length_one_and_w_not_negative(q: list[float]) -> None:
    back = to_quaternion(from_quaternion(q))
    assert np.linalg.norm(back) == pytest.approx(1.0)
    assert back[3] >= 0.0
    assert abs(back @ q) / np.linalg.norm(q) == pytest.approx(1.0, abs=1e-12)


def test_what_is_no_rotation_is_refused() -> None:
    with pytest.raises(ValueError, match="norm"):
        from_quaternion((0.0, 0.0, 0.0, 0.0))
    with pytest.raises(ValueError, match="determinant"):
        to_quaternion(np.diag((1.0, 1.0, -1.0)))
