"""Centre, size and stem axis of a fruit are its pose; their uncertainties are the pose's covariance."""

from dataclasses import replace

import numpy as np
from hypothesis import given, settings, strategies as st

from pomona.skills.perception.detection.close_look import REFERENCE_LENGTH
from pomona.skills.perception.detection.cuboid import cuboid_keypoints
from pomona.skills.perception.detection.found_fruit import FoundFruit
from pomona.skills.perception.detection.pose import solve_pose
from pomona.skills.perception.detection.rigid_pose import cuboid_in_picture, pose_covariance, pose_of
from pomona.skills.perception.detection.symmetry import STEM_AXIS, label_rotation

K = np.array([[610.6, 0.0, 317.7], [0.0, 610.6, 238.1], [0.0, 0.0, 1.0]])
APPLE = np.array([0.09756, 0.08539, 0.09590])


def seen(T: np.ndarray, visibility: float = 1.0) -> FoundFruit:
    """Return a perfect close look at a CAD-sized fruit."""
    p = T[:3, 3]
    centre = p[:2] / p[2] * (K[0, 0], K[1, 1]) + (K[0, 2], K[1, 2])
    size = K[0, 0] * REFERENCE_LENGTH / p[2]
    return FoundFruit(p, T[:3, :3] @ STEM_AXIS, centre, size, np.array([1.0, 0.02, 0.1]), 0.9, visibility)


def posed(stem: tuple[float, ...], p: tuple[float, ...]) -> np.ndarray:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = label_rotation(stem, p), p
    return T


@settings(max_examples=30)
@given(
    st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-1, 1)).filter(lambda v: np.linalg.norm(v) > 0.2),
    st.tuples(st.floats(-0.15, 0.15), st.floats(-0.1, 0.1), st.floats(0.3, 0.9)),
)
def test_a_perfect_look_gives_the_labels_pose_and_keypoints(stem: tuple[float, ...], p: tuple[float, ...]) -> None:
    T = posed(stem, p)
    assert np.allclose(pose_of(seen(T)), T, atol=1e-9)
    keypoints = cuboid_in_picture(T, APPLE, K)
    corners = cuboid_keypoints(APPLE) @ T[:3, :3].T + T[:3, 3]
    assert np.allclose(keypoints, corners[:, :2] / corners[:, 2:] * (K[0, 0], K[1, 1]) + (K[0, 2], K[1, 2]), atol=1e-9)
    assert np.allclose(solve_pose(keypoints, APPLE, K).T_camera_object, T, atol=1e-3)  # another way to the same pose


def test_the_covariance_is_the_scatter_of_the_errors_of_a_look() -> None:
    rng = np.random.default_rng(0)
    T = posed((0.1, -0.7, -0.6), (0.12, -0.08, 0.6))
    truth = seen(T)
    covariance = pose_covariance(truth, K)
    # The scales turn expected errors into deviations: read them off where each acts alone.
    z = truth.p_camera[2]
    only = [pose_covariance(replace(truth, spreads=np.eye(3)[k]), K) for k in range(3)]
    across = np.sqrt(only[0][3, 3]) * K[0, 0] / z
    along = np.sqrt(np.trace(only[1][3:, 3:])) / np.linalg.norm(truth.p_camera)
    places = []
    for _ in range(3000):
        centre = truth.centre + rng.normal(0.0, across * truth.spreads[0], 2)
        far = z * np.exp(rng.normal(0.0, along * truth.spreads[1]))
        places.append(far * np.array([*((centre - K[:2, 2]) / (K[0, 0], K[1, 1])), 1.0]))
    assert np.allclose(covariance[3:, 3:], np.cov(np.array(places).T), rtol=0.12, atol=2e-8)
    assert np.all(np.linalg.eigvalsh(covariance) > 0.0)
    assert only[2][0, 0] > 0.0


def test_a_hidden_fruit_is_placed_less_surely_than_the_network_says() -> None:
    T = posed((0.0, -1.0, -0.2), (0.0, 0.0, 0.6))
    clear, hidden = (np.diag(pose_covariance(seen(T, visibility), K)) for visibility in (1.0, 0.3))
    assert np.all(hidden[3:] > 2.0 * clear[3:])
