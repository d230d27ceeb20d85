from itertools import pairwise

import numpy as np
from hypothesis import given, settings, strategies as st

from pomona.skills.motion.planning.space import path_length, shortcut
from tests.skills.motion.planning.disc_world import DiscWorld


@settings(max_examples=30)
@given(seed=st.integers(0, 1000))
def test_a_shortcut_is_free_no_longer_and_keeps_its_ends(seed):
    rng = np.random.default_rng(seed)
    space = DiscWorld(
        np.column_stack([rng.uniform(-1.5, 1.5, (12, 2)), rng.uniform(0.05, 0.25, 12)])
    )
    path = [np.array([-1.9, -1.9])]
    while len(path) < 25:
        q = np.clip(path[-1] + rng.normal(0.0, 0.5, 2), -2.0, 2.0)
        if space.free_between(path[-1], q):
            path.append(q)
    waypoints = np.array(path)
    shorter = shortcut(space, waypoints, np.random.default_rng(seed))
    np.testing.assert_array_equal(shorter[[0, -1]], waypoints[[0, -1]])
    assert path_length(shorter) <= path_length(waypoints) + 1e-12
    assert all(space.free_between(a, b) for a, b in pairwise(shorter))


def test_without_obstacles_only_the_ends_remain():
    space = DiscWorld(np.array([[10.0, 10.0, 0.1]]))
    waypoints = np.array([[-1.0, 0.0], [0.0, 1.0], [0.5, -1.0], [1.0, 0.0]])
    np.testing.assert_array_equal(
        shortcut(space, waypoints, np.random.default_rng(0)), waypoints[[0, 3]]
    )
