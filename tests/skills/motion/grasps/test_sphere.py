import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.spatial.transform import Rotation

from pomona.executive.values.rotations import is_rigid
from pomona.skills.geometry import transform
from pomona.skills.motion.grasps.sphere import (
    Sphere,
    pre_grasp_orientation,
    pre_grasp_position,
)

angles = {"theta": st.floats(0.0, np.pi / 2.0), "alpha": st.floats(-np.pi, 2.0 * np.pi)}


@given(**angles)
def test_the_approach_runs_from_the_pre_grasp_through_the_fruits_centre(theta, alpha):
    p_fruit = np.array([0.1, -0.4, 0.05])
    for camera_above in (True, False):
        R = pre_grasp_orientation(theta, alpha, camera_above)
        p = pre_grasp_position(p_fruit, 0.12, theta, alpha)
        assert is_rigid(transform(R, p), 1e-6)
        np.testing.assert_allclose(p + 0.12 * R[:, 2], p_fruit, atol=1e-12)


@given(**angles)
def test_the_orientation_is_the_quaternion_product_of_the_paper(theta, alpha):
    q_tilde = Rotation.from_euler("z", -np.pi / 2.0) * Rotation.from_euler("x", np.pi)
    expected = q_tilde * Rotation.from_euler("z", alpha) * Rotation.from_euler("y", theta)
    np.testing.assert_allclose(
        pre_grasp_orientation(theta, alpha, camera_above=False), expected.as_matrix(), atol=1e-12
    )


@given(**angles)
def test_the_sliding_vector_stays_horizontal_and_the_camera_looks_from_above(theta, alpha):
    R = pre_grasp_orientation(theta, alpha)
    assert R[2, 1] == pytest.approx(0.0, abs=1e-12)
    assert R[2, 0] <= 1e-12  # the camera is mounted towards -x of the TCP: that side is up
    np.testing.assert_allclose(
        R,
        pre_grasp_orientation(theta, alpha, camera_above=False) @ np.diag([-1, -1, 1]),
        atol=1e-12,
    )


def test_theta_zero_is_straight_above():
    np.testing.assert_allclose(
        pre_grasp_position(np.array([1.0, 2.0, 3.0]), 0.12, 0.0, 1.0), [1.0, 2.0, 3.12]
    )
    np.testing.assert_allclose(pre_grasp_orientation(0.0, 0.7)[:, 2], [0.0, 0.0, -1.0], atol=1e-15)


def test_a_full_circle_does_not_repeat_its_start():
    attempts = Sphere(theta=(0.2, 0.4), tilts=2, turns=4).attempts()
    assert [theta for theta, _ in attempts] == [0.2] * 4 + [0.4] * 4
    np.testing.assert_allclose(
        [alpha for _, alpha in attempts[:4]], [0.0, np.pi / 2, np.pi, 3 * np.pi / 2]
    )


def test_an_arc_includes_both_ends():
    attempts = Sphere(theta=(0.0, 0.0), alpha=(-1.0, 1.0), tilts=1, turns=3).attempts()
    np.testing.assert_allclose([alpha for _, alpha in attempts], [-1.0, 0.0, 1.0])


def test_a_finer_sphere_contains_the_attempts_of_the_coarser_one():
    for sphere in (Sphere(), Sphere(theta=(0.1, 0.5), alpha=(-1.0, 1.0), tilts=3, turns=5)):
        finer = {(round(theta, 9), round(alpha, 9)) for theta, alpha in sphere.finer().attempts()}
        assert {(round(theta, 9), round(alpha, 9)) for theta, alpha in sphere.attempts()} < finer
