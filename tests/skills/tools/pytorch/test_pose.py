"""Poses from keypoints, against exact projections and against scatter."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from pomona.executive.values.rotations import is_rigid
from pomona.skills.perception.detection.instances import CuboidConvention, cuboid_keypoints
from pomona.tools.pytorch.pose import PoseUnsolved, solve_pose

K = np.array([[610.6, 0.0, 317.7], [0.0, 610.6, 238.1], [0.0, 0.0, 1.0]])
APPLE = (0.09756, 0.08539, 0.09590)


def pose(quaternion: tuple[float, ...], translation: tuple[float, ...]) -> np.ndarray:
    x, y, z, w = np.asarray(quaternion) / np.linalg.norm(quaternion)
    T = np.eye(4)
    T[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    T[:3, 3] = translation
    return T


def project(T: np.ndarray, convention: CuboidConvention = CuboidConvention.CAMERA) -> np.ndarray:
    points = cuboid_keypoints(APPLE, convention) @ T[:3, :3].T + T[:3, 3]
    return points[:, :2] / points[:, 2:] * (K[0, 0], K[1, 1]) + (K[0, 2], K[1, 2])


QUATERNION = st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: np.linalg.norm(q) > 0.2)
PLACE = st.tuples(st.floats(-0.15, 0.15), st.floats(-0.1, 0.1), st.floats(0.3, 0.9))


@settings(max_examples=60)
@given(QUATERNION, PLACE, st.sampled_from(list(CuboidConvention)))
def test_exact_keypoints_give_back_the_pose(
    q: tuple[float, ...], p: tuple[float, ...], convention: CuboidConvention
) -> None:
    T = pose(q, p)
    solved = solve_pose(project(T, convention), APPLE, K, convention)
    assert np.allclose(solved.T_camera_object, T, atol=2e-4)
    assert solved.residual < 1e-2
    assert is_rigid(solved.T_camera_object, 1e-6)


def test_missing_keypoints_are_left_out() -> None:
    T = pose((0.2, 0.4, -0.1, 0.8), (0.03, -0.02, 0.5))
    keypoints = project(T)
    keypoints[[1, 6, 8]] = np.nan
    assert np.allclose(solve_pose(keypoints, APPLE, K).T_camera_object, T, atol=1e-4)


def test_eight_corners_without_centroid_are_enough() -> None:
    T = pose((0.2, 0.4, -0.1, 0.8), (0.03, -0.02, 0.5))
    assert np.allclose(solve_pose(project(T)[:8], APPLE, K).T_camera_object, T, atol=1e-4)


def test_covariance_agrees_with_the_scatter_of_noisy_solutions() -> None:
    rng = np.random.default_rng(0)
    T = pose((0.3, 0.5, -0.1, 0.8), (0.03, -0.02, 0.5))
    keypoints = project(T)
    solved = [solve_pose(keypoints + rng.normal(0.0, 1.0, (9, 2)), APPLE, K) for _ in range(400)]
    places = np.array([s.T_camera_object[:3, 3] for s in solved])
    scatter = places.std(axis=0)
    expected = np.sqrt(np.mean([np.diag(s.covariance)[3:] for s in solved], axis=0))
    assert np.all(expected > 0.7 * scatter)
    assert np.all(expected < 1.4 * scatter)
    angles = np.array([_rotation_vector(s.T_camera_object[:3, :3] @ T[:3, :3].T) for s in solved])
    expected_angle = np.sqrt(np.mean([np.diag(s.covariance)[:3] for s in solved], axis=0))
    assert np.all(np.abs(np.log(expected_angle / angles.std(axis=0))) < 0.4)


def _rotation_vector(R: np.ndarray) -> np.ndarray:
    return 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])


@pytest.mark.parametrize(
    "keypoints",
    [
        np.full((9, 2), np.nan),
        np.full((9, 2), 100.0),
        np.stack([np.arange(9.0), np.arange(9.0)], axis=1) * 10.0,
        np.zeros((7, 2)),
        np.vstack([np.random.default_rng(0).uniform(0, 400, (3, 2)), np.full((6, 2), np.nan)]),
    ],
    ids=["none", "one point", "a line", "wrong count", "three"],
)
def test_hopeless_keypoints_are_refused(keypoints: np.ndarray) -> None:
    with pytest.raises(PoseUnsolved):
        solve_pose(keypoints, APPLE, K)


@settings(max_examples=60)
@given(st.lists(st.tuples(st.floats(-2000, 2000), st.floats(-2000, 2000)), min_size=9, max_size=9))
def test_any_keypoints_give_a_pose_before_the_camera_or_a_typed_error(
    points: list[tuple[float, float]],
) -> None:
    try:
        solved = solve_pose(np.array(points), APPLE, K)
    except PoseUnsolved:
        return
    assert is_rigid(solved.T_camera_object, 1e-6)
    assert solved.T_camera_object[2, 3] > 0.0
    assert np.isfinite(solved.covariance).all()
