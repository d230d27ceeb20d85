import numpy as np
import pytest

from pomona.skills.motion.planning.plan import time_free_path
from pomona.skills.motion.planning.space import PlanningFailed
from pomona.skills.motion.planning.timing import time_polyline
from tests.skills.motion.planning.disc_world import LIMITS, DiscWorld

CORNER = np.array([[-1.0, 0.0], [0.0, 1.0], [1.0, 0.0]])


def test_a_corner_is_sharpened_until_it_clears_the_obstacle():
    rounded = time_polyline(CORNER, LIMITS)
    space = DiscWorld(
        np.array([[0.0, 0.6, 0.2]])
    )  # the polyline passes it, the rounded corner goes through it
    assert not all(space.free(q) for q in rounded.q)
    sharpened = time_free_path(space, CORNER, LIMITS)
    assert all(space.free(q) for q in sharpened.q)
    assert sharpened.duration > rounded.duration


def test_a_free_corner_is_left_as_round_as_it_is():
    free = time_free_path(DiscWorld(np.array([[0.0, -1.0, 0.1]])), CORNER, LIMITS)
    np.testing.assert_array_equal(free.q, time_polyline(CORNER, LIMITS).q)


def test_a_polyline_that_is_not_free_is_refused():
    with pytest.raises(PlanningFailed, match="NO_PATH"):
        time_free_path(DiscWorld(np.array([[0.5, 0.5, 0.1]])), CORNER, LIMITS)
