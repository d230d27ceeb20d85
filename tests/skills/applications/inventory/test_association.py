"""Sightings of one frame among the fruit that is known."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from pomona.applications.inventory.book import GATE, MISPLACED, associate

MM = 1e-3
SMALL = (2 * MM) ** 2 * np.eye(3)


def at(x: float, y: float = 0.0, z: float = 1.0, covariance: np.ndarray = SMALL):
    return np.array([x, y, z]), covariance


@given(st.integers(1, 8), st.integers(0, 2**32 - 1))
def test_solid_fruit_seen_again_from_anywhere_is_distinguished_in_any_order(
    count: int, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    places = np.column_stack(
        [np.arange(count) * 0.09, rng.uniform(0, 0.1, count), rng.uniform(0.9, 1.1, count)]
    )
    order = rng.permutation(count)
    seen = [(places[k] + rng.normal(0.0, 2 * MM, 3), SMALL) for k in order]
    assert associate([(p, SMALL) for p in places], seen, 0.09) == order.tolist()


def test_an_object_farther_away_than_a_fruit_is_new() -> None:
    assert associate([at(0.0)], [at(0.09)], 0.09) == [None]
    assert associate([at(0.0)], [at(0.03)], 0.09) == [0]
    assert associate([], [at(0.0)], 0.09) == [None]
    assert associate([at(0.0)], [], 0.09) == []


def test_a_fruit_is_given_once_and_the_sum_of_distances_is_least() -> None:
    # the nearest of both is the first fruit for both; taken greedily by the first, the second would be left alone
    known = [at(0.0), at(0.03)]
    assert associate(known, [at(0.012), at(-0.01)], 0.09) == [1, 0]
    assert associate([at(0.0)], [at(0.01), at(0.0)], 0.09) == [None, 0]


def test_a_place_that_is_uncertain_along_the_line_of_sight_reaches_far_along_it_and_not_beside_it() -> (
    None
):
    long = np.diag([(2 * MM) ** 2, (2 * MM) ** 2, 0.1**2])
    assert associate([at(0.0)], [at(0.0, 0.0, 1.2, long)], 0.09) == [0]
    assert associate([at(0.0)], [at(0.09, 0.0, 1.2, long)], 0.09) == [None]


def test_the_gate_is_narrower_than_two_solid_fruit_can_be_near() -> None:
    reach = MISPLACED * np.sqrt(2.0 * GATE)
    assert reach == pytest.approx(0.476, abs=0.001)
