"""The order of rolls, and the distance of the fingers to neighbours in them."""

from __future__ import annotations

import numpy as np
import pytest

from pomona.applications.harvest.reachable import grasp_pose
from pomona.applications.harvest.roll_choice import (
    FINGER_BESIDE,
    FINGER_RADIUS,
    ordered,
    roll_clearance,
)


def test_the_clearance_of_a_roll_is_the_fingers_distance_at_its_worst():
    T = grasp_pose(np.array([0.0, -0.6, 0.4]), 0.0, 0.0, 0.0)
    side, knuckle = T[:3, 1], T[:3, 3]
    radius = 0.03
    half = 0.08 / 2.0 + FINGER_BESIDE
    beside = np.array([[*(T[:3, 3] + 0.10 * side), radius]])
    expected = 0.10 - half - radius - FINGER_RADIUS
    assert roll_clearance(T, 0.0, 0.08, knuckle, beside) == pytest.approx(expected)
    up = np.cross(T[:3, 2], side)
    above = np.array([[*(T[:3, 3] + 0.10 * up), radius]])
    assert roll_clearance(T, np.pi / 2.0, 0.08, knuckle, above) == pytest.approx(expected)
    assert roll_clearance(T, 0.0, 0.08, knuckle, above) > expected + 0.02
    assert roll_clearance(T, 1.0, 0.08, knuckle, np.zeros((0, 4))) == np.inf


def test_the_freest_roll_comes_first():
    assert ordered({2.4: 1.2, -2.4: 1.6}, {2.4: 0.03, -2.4: 0.0}) == (-2.4, 2.4)


def test_of_two_rolls_that_are_free_far_enough_the_one_further_from_neighbours_comes_first():
    assert ordered({2.4: 2.4, -2.4: 1.8}, {2.4: 0.0, -2.4: 0.02}) == (-2.4, 2.4)


def test_a_roll_that_obstacles_end_early_is_tried_only_if_the_other_one_is_no_better():
    assert ordered({2.4: 0.5, -2.4: 1.6}, {2.4: 0.03, -2.4: 0.0}) == (-2.4,)
    assert ordered({2.4: 0.5, -2.4: 0.6}, {2.4: 0.03, -2.4: 0.0}) == (-2.4, 2.4)
