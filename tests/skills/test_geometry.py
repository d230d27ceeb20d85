"""Rigid transforms beside scipy's rotations, over random poses."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pomona.skills.geometry import (
    angle_between,
    apply,
    inverse,
    rot_x,
    rot_y,
    rot_z,
    rotation_about,
    transform,
)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(11)


def some_pose(rng: np.random.Generator) -> np.ndarray:
    return transform(Rotation.random(random_state=rng).as_matrix(), rng.normal(size=3))


def test_a_pose_is_its_rotation_and_its_translation_and_the_identity_where_nothing_is_said() -> (
    None
):
    np.testing.assert_array_equal(transform(), np.eye(4))
    turned = transform(rot_z(0.3), (1.0, 2.0, 3.0))
    np.testing.assert_array_equal(turned[:3, :3], rot_z(0.3))
    np.testing.assert_array_equal(turned[:, 3], (1.0, 2.0, 3.0, 1.0))
    np.testing.assert_array_equal(turned[3], (0.0, 0.0, 0.0, 1.0))


def test_the_inverse_is_numpys_for_one_pose_and_for_many(rng: np.random.Generator) -> None:
    poses = np.array([some_pose(rng) for _ in range(20)])
    np.testing.assert_allclose(inverse(poses), np.linalg.inv(poses), atol=1e-12)
    np.testing.assert_allclose(inverse(poses[0]), np.linalg.inv(poses[0]), atol=1e-12)


def test_points_are_mapped_as_homogeneous_ones_are(rng: np.random.Generator) -> None:
    T, points = some_pose(rng), rng.normal(size=(5, 7, 3))
    homogeneous = np.concatenate([points, np.ones((5, 7, 1))], axis=-1)
    np.testing.assert_allclose(apply(T, points), (homogeneous @ T.T)[..., :3], atol=1e-12)
    np.testing.assert_allclose(apply(T, points[0, 0]), (T @ homogeneous[0, 0])[:3], atol=1e-12)


def test_turns_are_scipys_rotation_vectors(rng: np.random.Generator) -> None:
    for angle in (-2.0, -1e-9, 0.0, 0.4, 3.1):
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        np.testing.assert_allclose(
            rotation_about(axis, angle), Rotation.from_rotvec(angle * axis).as_matrix(), atol=1e-12
        )
        for name, turn in (("x", rot_x), ("y", rot_y), ("z", rot_z)):
            np.testing.assert_allclose(
                turn(angle), Rotation.from_euler(name, angle).as_matrix(), atol=1e-12
            )


def test_the_angle_between_two_rotations_is_that_of_the_turn_from_one_to_the_other(
    rng: np.random.Generator,
) -> None:
    R = some_pose(rng)[:3, :3]
    for angle in (0.0, 0.2, 1.5, 3.0):
        assert angle_between(R, R @ rotation_about((0.6, 0.0, 0.8), angle)) == pytest.approx(
            angle, abs=1e-9
        )
