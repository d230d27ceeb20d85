"""Centre, size and stem axis of a fruit give back its pose and cuboid."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from skills.perception.detection.close_look import REFERENCE_LENGTH
from skills.perception.detection.compact_detector import FoundFruit
from skills.perception.detection.cuboid import cuboid_keypoints
from skills.perception.detection.pose import solve_pose
from skills.perception.detection.rigid_pose import cuboid_in_picture, pose_covariance
from skills.perception.detection.symmetry import STEM_AXIS, label_rotation

K = np.array([[610.6, 0.0, 317.7], [0.0, 610.6, 238.1], [0.0, 0.0, 1.0]])
APPLE = np.array([0.09756, 0.08539, 0.09590])


def seen(T: np.ndarray, **changes: float) -> FoundFruit:
    """What a perfect close look would say about a CAD-sized fruit."""
    p = T[:3, 3]
    stem = T[:3, :3] @ STEM_AXIS
    centre = p[:2] / p[2] * (K[0, 0], K[1, 1]) + (K[0, 2], K[1, 2])
    size = K[0, 0] * REFERENCE_LENGTH / p[2]
    spreads = np.array([changes.get("centre", 1.0), changes.get("size", 0.02), changes.get("axis", 0.1)])
    return FoundFruit(centre, size, stem, spreads, 0.9, 1.0)


@settings(max_examples=80, deadline=None)
@given(
    st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1)).filter(lambda v: np.linalg.norm(v) > 0.2),
    st.tuples(st.floats(-0.15, 0.15), st.floats(-0.1, 0.1), st.floats(0.3, 0.9)),
)
def test_a_perfect_look_gives_the_labels_pose_and_keypoints(stem: tuple[float, ...], p: tuple[float, ...]) -> None:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = label_rotation(stem, p), p
    keypoints = cuboid_in_picture(seen(T), APPLE, K)
    corners = cuboid_keypoints(APPLE) @ T[:3, :3].T + T[:3, 3]
    assert np.allclose(keypoints, corners[:, :2] / corners[:, 2:] * (K[0, 0], K[1, 1]) + (K[0, 2], K[1, 2]), atol=1e-3)
    assert np.allclose(solve_pose(keypoints, APPLE, K).T_camera_object, T, atol=1e-3)


def test_covariance_agrees_with_the_scatter_of_what_the_look_is_unsure_of() -> None:
    rng = np.random.default_rng(0)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = label_rotation((0.1, -0.7, -0.6), (0.12, -0.08, 0.6)), (0.12, -0.08, 0.6)
    truth = seen(T)
    places = []
    for _ in range(3000):
        # A spread of 1 px is the deviation of the distance: its two directions share it.
        centre = truth.centre + rng.normal(0.0, 1.0 / np.sqrt(2.0), 2)
        size = truth.size * np.exp(rng.normal(0.0, 0.02))
        z = K[0, 0] * REFERENCE_LENGTH / size
        places.append(z * np.array([(centre[0] - K[0, 2]) / K[0, 0], (centre[1] - K[1, 2]) / K[1, 1], 1.0]))
    scatter = np.cov(np.array(places).T)
    covariance = pose_covariance(truth, T, K, residual=0.0)
    assert np.allclose(covariance[3:, 3:], scatter, rtol=0.12, atol=2e-8)
    assert np.all(np.linalg.eigvalsh(covariance) > 0.0)


def test_a_larger_residual_widens_the_place_across_the_line_of_sight() -> None:
    T = np.eye(4)
    T[:3, 3] = (0.0, 0.0, 0.6)
    small, large = (pose_covariance(seen(T), T, K, residual) for residual in (0.0, 4.0))
    assert large[3, 3] > 5.0 * small[3, 3]
    assert np.isclose(large[5, 5], small[5, 5])
