"""The compiled least squares: derivatives are true, the cost never rises, hopeless input ends."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, strategies as st

from pomona.skills.perception.detection.instances import cuboid_keypoints
from pomona.tools.pytorch.pose import linearise, refine_pose

K = np.array([[610.0, 0.0, 317.0], [0.0, 605.0, 238.0], [0.0, 0.0, 1.0]])
MODEL = cuboid_keypoints(np.array([0.08, 0.07, 0.08]))


def pose(seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    rotation = np.asarray(cv2.Rodrigues(rng.normal(size=3))[0], np.float64)
    return rotation, np.array(
        [rng.uniform(-0.2, 0.2), rng.uniform(-0.15, 0.15), rng.uniform(0.3, 1.2)]
    )


def picture(R: np.ndarray, t: np.ndarray) -> np.ndarray:
    points = MODEL @ R.T + t
    pixels: np.ndarray = points[:, :2] / points[:, 2:] * (K[0, 0], K[1, 1]) + K[:2, 2]
    return pixels


def moved(R: np.ndarray, t: np.ndarray, step: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return np.asarray(cv2.Rodrigues(step[:3])[0], np.float64) @ R, t + step[3:]


@pytest.fixture(scope="module", autouse=True)
def _compiled() -> None:
    """Else the first example of the first property would be slower than hypothesis allows."""
    refine_pose(
        np.eye(3), np.array([0.0, 0.0, 1.0]), np.eye(4, 3), np.zeros((4, 2)), np.eye(3), np.ones(8)
    )


@given(st.integers(0, 10_000))
def test_the_derivative_is_that_of_the_residual(seed: int) -> None:
    R, t = pose(seed)
    seen = picture(*pose(seed + 1))
    residual, jacobian = linearise(R, t, MODEL, seen, K)
    for k in range(6):
        step = np.zeros(6)
        step[k] = 1e-6
        ahead, _ = linearise(*moved(R, t, step), MODEL, seen, K)
        behind, _ = linearise(*moved(R, t, -step), MODEL, seen, K)
        assert np.allclose((ahead - behind) / 2e-6, jacobian[:, k], rtol=1e-4, atol=1e-3)
    assert np.allclose(residual.reshape(-1, 2), picture(R, t) - seen)


@given(st.integers(0, 10_000))
def test_a_pose_near_the_true_one_becomes_it(seed: int) -> None:
    R, t = pose(seed)
    start = moved(
        R, t, np.random.default_rng(seed).normal(0.0, 1.0, 6) * [0.1, 0.1, 0.1, 0.01, 0.01, 0.02]
    )
    found_R, found_t = refine_pose(*start, MODEL, picture(R, t), K, np.ones(18))
    assert np.allclose(found_t, t, atol=1e-5)
    assert np.allclose(found_R, R, atol=1e-4)
    assert np.allclose(found_R @ found_R.T, np.eye(3), atol=1e-9)


@given(st.integers(0, 10_000), st.floats(0.0, 30.0))
def test_the_cost_never_rises(seed: int, noise: float) -> None:
    R, t = pose(seed)
    rng = np.random.default_rng(seed)
    seen, scale = (
        picture(*pose(seed)) + rng.normal(0.0, noise, (9, 2)),
        rng.uniform(0.1, 2.0, 9).repeat(2),
    )
    start = moved(R, t, rng.normal(0.0, 0.02, 6))
    before, _ = linearise(*start, MODEL, seen, K)
    after, _ = linearise(*refine_pose(*start, MODEL, seen, K, scale), MODEL, seen, K)
    assert ((after * scale) ** 2).sum() <= ((before * scale) ** 2).sum() + 1e-9


def test_missing_or_unweighted_points_leave_the_pose() -> None:
    R, t = pose(0)
    for seen, scale in ((np.full((9, 2), np.nan), np.ones(18)), (picture(R, t), np.zeros(18))):
        found_R, found_t = refine_pose(R, t, MODEL, seen, K, scale)
        assert np.array_equal(found_R, R)
        assert np.array_equal(found_t, t)
