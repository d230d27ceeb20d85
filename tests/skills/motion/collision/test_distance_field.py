"""The distance field never promises more room than there is, and little less."""

import numpy as np
from hypothesis import given, settings, strategies as st
from scipy.ndimage import distance_transform_edt

from pomona.skills.motion.collision import DistanceField
from pomona.skills.motion.collision.distance_field import INTERPOLATION_ERROR

RESOLUTION, LIMIT = 0.02, 0.30
ORIGIN = np.array([-0.2, 0.1, 0.3])


def grid(seed: int, shape: tuple[int, int, int] = (17, 13, 15), share: float = 0.01) -> np.ndarray:
    blocked = np.random.default_rng(seed).uniform(size=shape) < share
    blocked[3, 4, 5] = True
    return blocked


def distance_to_cubes(points: np.ndarray, blocked: np.ndarray) -> np.ndarray:
    lower = ORIGIN + np.argwhere(blocked) * RESOLUTION
    outside = np.maximum(np.maximum(lower[None] - points[:, None], points[:, None] - lower[None] - RESOLUTION), 0.0)
    return np.linalg.norm(outside, axis=2).min(axis=1)


@settings(max_examples=25)
@given(st.integers(0, 10_000))
def test_inside_the_grid_the_field_bounds_the_distance_from_below_and_closely(seed: int) -> None:
    blocked = grid(seed)
    field = DistanceField.of_blocked(blocked, ORIGIN, RESOLUTION, LIMIT)
    upper = ORIGIN + np.array(blocked.shape) * RESOLUTION
    points = np.random.default_rng(seed).uniform(ORIGIN, upper, (400, 3))
    told, true = field.distance(points), distance_to_cubes(points, blocked)
    assert np.all(told <= true + 1e-6)
    assert np.all(told >= true - (INTERPOLATION_ERROR + np.sqrt(0.75)) * RESOLUTION)  # half a diagonal of a cell


@settings(max_examples=10)
@given(st.integers(0, 10_000))
def test_outside_the_grid_the_field_still_bounds_from_below(seed: int) -> None:
    blocked = grid(seed)
    field = DistanceField.of_blocked(blocked, ORIGIN, RESOLUTION, LIMIT)
    points = np.random.default_rng(seed).uniform(ORIGIN - 0.3, ORIGIN + 0.8, (400, 3))
    assert np.all(field.distance(points) <= distance_to_cubes(points, blocked) + 1e-6)


def test_the_worst_interpolation_error_is_beside_a_corner_and_within_its_bound() -> None:
    blocked = np.zeros((4, 4, 4), dtype=bool)
    blocked[0, 0, 0] = True
    field = DistanceField.of_blocked(blocked, np.zeros(3), 1.0, 100.0)
    shares = np.linspace(0.0, 1.0, 41)
    points = np.stack(np.meshgrid(shares, shares, shares), axis=-1).reshape(-1, 3) + 1.0
    true = np.linalg.norm(points - 1.0, axis=1)
    worst = float((field.distance(points) + INTERPOLATION_ERROR - true).max())
    assert 0.25 < worst < INTERPOLATION_ERROR


def test_the_field_equals_scipys_transform_at_the_corners() -> None:
    blocked = grid(5, (30, 25, 20), 0.003)
    corners = np.zeros(np.add(blocked.shape, 1), dtype=bool)
    for i, j, k in np.argwhere(blocked):
        corners[i : i + 2, j : j + 2, k : k + 2] = True
    expected = np.minimum(distance_transform_edt(~corners) * RESOLUTION, LIMIT)
    field = DistanceField.of_blocked(blocked, ORIGIN, RESOLUTION, LIMIT)
    assert np.allclose(field.values, expected, atol=1e-6)


def test_an_empty_grid_is_as_far_as_the_limit() -> None:
    field = DistanceField.of_blocked(np.zeros((5, 6, 7), dtype=bool), ORIGIN, RESOLUTION, LIMIT)
    assert np.allclose(field.values, LIMIT)
