import numpy as np

from pomona.skills.motion.grasp import Tried, direction
from tests.skills.picking_scene import a_grasp, apple_at


def test_attempts_at_one_fruit_add_up_and_a_new_fruit_starts_afresh():
    tried = Tried()
    tried.begin(apple_at(1, 3))
    tried.add(a_grasp(1, 3))
    tried.begin(apple_at(1, 3))
    assert tried.attempt == 2
    assert tried.directions == {direction(a_grasp(1, 3))}
    tried.begin(apple_at(1, 4))
    assert tried.attempt == 1
    assert tried.directions == frozenset()


def test_a_second_look_at_the_same_fruit_is_no_new_fruit():
    tried = Tried()
    tried.begin(apple_at(1, 3))
    tried.add(a_grasp(1, 3))
    again = apple_at(1, 3)
    again.T_base_fruit[:3, 3] += np.array([0.004, -0.006, 0.002])
    tried.begin(again)
    assert tried.directions == {direction(a_grasp(1, 3))}


def test_the_candidate_of_another_fruit_does_not_count():
    tried = Tried()
    tried.begin(apple_at(1, 5))
    tried.add(a_grasp(1, 3))
    assert tried.directions == frozenset()
