"""Rotations in files and messages, against their closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, strategies as st

from pomona.executive.values.rotations import from_quaternion, from_rpy, is_rigid, to_quaternion

ANGLES = st.floats(-np.pi, np.pi)
QUATERNIONS = st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=4).filter(
    lambda q: np.linalg.norm(q) > 1e-3
)


def about(axis: int, angle: float) -> np.ndarray:
    i, j = (axis + 1) % 3, (axis + 2) % 3
    R = np.eye(3)
    R[i, i] = R[j, j] = np.cos(angle)
    R[j, i], R[i, j] = np.sin(angle), -np.sin(angle)
    return R


@given(ANGLES, ANGLES, ANGLES)
def test_roll_pitch_yaw_turn_about_the_fixed_axes_x_y_z_in_this_order(
    roll: float, pitch: float, yaw: float
) -> None:
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


def test_a_matrix_of_no_rotation_is_refused() -> None:
    with pytest.raises(ValueError, match="norm"):
        from_quaternion((0.0, 0.0, 0.0, 0.0))
    with pytest.raises(ValueError, match="determinant"):
        to_quaternion(np.diag((1.0, 1.0, -1.0)))


def pose(rpy: tuple[float, float, float] = (0.3, -1.2, 2.0)) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = from_rpy(rpy), (1.0, -2.0, 1e6)
    return T


@given(ANGLES, ANGLES, ANGLES)
def test_a_rotation_and_a_translation_are_rigid(roll: float, pitch: float, yaw: float) -> None:
    assert is_rigid(pose((roll, pitch, yaw)))


def test_a_rotation_may_be_written_with_four_digits() -> None:
    near, off = np.eye(4), np.eye(4)
    near[0, 1], off[0, 1] = 0.9e-4, 1.1e-4
    assert is_rigid(near)
    assert not is_rigid(off)


@pytest.mark.parametrize(
    ("where", "value"),
    [
        ((3, 0), 1e-9), ((3, 3), 1.001), ((3, 3), 0.0), ((0, 3), np.nan), ((1, 3), np.inf), ((0, 0), np.nan),
    ],
)  # fmt: skip
def test_another_last_row_and_values_that_are_not_finite_are_not_rigid(
    where: tuple[int, int], value: float
) -> None:
    T = pose()
    T[where] = value
    assert not is_rigid(T)


def test_another_shape_is_not_rigid() -> None:
    assert not is_rigid(pose()[:3])


def test_the_axes_are_judged_to_a_tolerance() -> None:
    off = pose()
    off[:3, :3] *= 1.00002
    assert is_rigid(off)
    assert not is_rigid(off, 1e-6)


def test_mirroring_stretching_and_flattening_are_not_rigid() -> None:
    for scale in (
        (-1.0, 1.0, 1.0),
        (-1.0, -1.0, -1.0),
        (1.001, 1.001, 1.001),
        (0.999, 1.0, 1.0),
        (1.0, 1.0, 0.0),
    ):
        T = pose()
        T[:3, :3] = T[:3, :3] @ np.diag(scale)
        assert not is_rigid(T), scale
