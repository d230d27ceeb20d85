from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, strategies as st

from pomona.applications.crates.hooks import STEP, WALL_AIR, Beside, behind, pull_of, rolled_height
from pomona.applications.crates.pull import (
    DOWNWARDS,
    FARTHEST_OFF,
    HARDER,
    HITS,
    HookPull,
    bears_below,
    weight_of,
)
from pomona.drivers.fruit_body import HARD_MODULUS
from pomona.drivers.interfaces import Box
from pomona.skills.geometry import transform
from pomona.skills.motion.grasp import Grasp
from pomona.skills.motion.grasps.gripper_shape import gripper_shape
from pomona.skills.shared.held_fruit import bruising
from tests.skills.applications.crates.wall_scene import AT_WALL, WALL, apple, hooks_at
from tests.skills.picking_scene import ROBOT_MODEL, WORKSPACE


def corners(hook: Grasp, shift: float = 0.0) -> np.ndarray:
    """Corners of the fingers at the lowest place of a hook, or a way along the pull further."""
    fingers = gripper_shape(ROBOT_MODEL)
    points = fingers.points + (hook.width - fingers.closed) * fingers.slides
    return points @ hook.T_base_grasp[:3, :3].T + hook.T_base_grasp[:3, 3] + shift * pull_of(hook)


def test_the_straightest_hook_pulls_away_from_the_wall_with_a_finger_behind_the_fruit():
    hook = hooks_at(apple()).grasps[0]
    np.testing.assert_allclose(pull_of(hook), [0.0, 1.0, 0.0], atol=1e-9)
    relative = corners(hook)[:, 1] - hook.fruit.T_base_fruit[1, 3]
    wall = WALL.T_base_box[1, 3] + WALL.half_extents[1] - hook.fruit.T_base_fruit[1, 3]
    assert (
        wall + WALL_AIR - 1e-9 <= relative.min() < wall + 4e-3
    )  # as far behind as the wall allows
    assert relative[relative < 0.0].max() < -0.012  # its inner face, behind the middle
    assert len(hook.q_pre_grasp) > 0


def test_a_fruit_in_the_open_needs_no_hook():
    assert Beside.of(apple(), WORKSPACE).away == ()
    assert not hooks_at(apple(), WORKSPACE).grasps


def test_in_a_corner_the_pull_leads_away_from_both_walls():
    side = Box("source", transform(None, [-0.085, -0.52, -0.06]), (0.004, 0.3, 0.06))
    (away,) = Beside.of(apple(), replace(AT_WALL, obstacles=(*AT_WALL.obstacles, side))).away
    np.testing.assert_allclose(away, [np.sqrt(0.5), np.sqrt(0.5), 0.0], atol=1e-9)


def test_between_two_neighbours_in_the_open_the_pull_leads_away_from_both():
    """Five apples of a crate lay so close that no grasp was free, two of them at no wall (crate of 8, seed 4226)."""
    enclosed = apple((-0.063, -0.065), (0.063, -0.065))
    (away,) = Beside.of(enclosed, WORKSPACE).away
    np.testing.assert_allclose(away, [0.0, 1.0, 0.0], atol=0.05)
    hook = hooks_at(enclosed, WORKSPACE).grasps[0]
    np.testing.assert_allclose(pull_of(hook), away, atol=1e-9)
    assert behind(hook) > 0.025


FRONT = (0.08, 0.045), (-0.02, 0.095)
"""Places of two neighbours in front of an apple at a wall, the first to its right."""


def test_away_from_neighbours_a_fruit_goes_along_the_wall_beside_it_and_not_into_it():
    walls, others = Beside.of(apple(*FRONT), AT_WALL).away
    np.testing.assert_allclose(walls, [0.0, 1.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(others, [-1.0, 0.0, 0.0], atol=1e-9)


def test_where_neighbours_are_in_front_of_every_pull_from_the_wall_pulls_lead_along_it():
    found = hooks_at(apple(*FRONT))
    assert found.grasps
    assert all(pull_of(hook)[0] < -0.5 for hook in found.grasps)
    assert any("neighbour" in out.reason for out in found.ruled_out)


def test_beside_one_neighbour_at_a_wall_a_small_fruit_is_drawn_away_from_both():
    """At the wall alone the finger stood 14 mm behind an apple of 61 mm, pressed it down (crate, seed 4224)."""
    small = apple((0.074, 0.0))
    small = replace(
        small, dimensions=0.68 * small.dimensions, T_base_fruit=small.T_base_fruit.copy()
    )
    small.T_base_fruit[1, 3] -= 0.014
    walls, others = Beside.of(small, AT_WALL).away
    found = hooks_at(small).grasps
    assert pull_of(found[0]) @ others > 0.99
    assert pull_of(found[0]) @ walls < 0.9
    assert behind(found[0]) > 0.018


def test_the_fruit_is_not_drawn_against_a_wall_that_the_other_finger_is_beyond():
    fruit = apple(*FRONT)
    side = Box(
        "source",
        transform(None, [fruit.T_base_fruit[0, 3] - 0.0665, -0.52, -0.06]),
        (0.0015, 0.3, 0.06),
    )
    found = hooks_at(fruit, replace(AT_WALL, obstacles=(*AT_WALL.obstacles, side)))
    assert not found.grasps
    assert any("the fruit would touch the source" in out.reason for out in found.ruled_out)


def test_in_a_corner_no_hook_is_given_whose_finger_is_nearer_than_that_of_the_straightest():
    """Plan took the nearest of ten: its finger met the fruit's flat shoulder and slid over it (corner, seed 531)."""
    side = Box("source", transform(None, [-0.085, -0.52, -0.06]), (0.004, 0.3, 0.06))
    found = hooks_at(apple(), replace(AT_WALL, obstacles=(*AT_WALL.obstacles, side))).grasps
    assert found[0].alpha == 0.0
    assert min(map(behind, found)) > behind(found[0]) - STEP


def test_a_neighbour_in_front_rules_the_straight_pull_out_and_one_beside_does_not():
    turns = [hook.alpha for hook in hooks_at(apple((0.0, 0.092))).grasps]
    assert 0.0 not in turns
    reasons = [out.reason for out in hooks_at(apple((0.0, 0.092))).ruled_out]
    assert any("neighbour" in reason for reason in reasons)
    assert 0.0 in [hook.alpha for hook in hooks_at(apple((0.093, 0.0))).grasps]


def test_a_wall_in_front_rules_a_hook_out():
    front = Box("source", transform(None, [-0.03, -0.43, -0.06]), (0.3, 0.004, 0.06))
    found = hooks_at(apple(), replace(AT_WALL, obstacles=(*AT_WALL.obstacles, front)))
    assert not found.grasps
    assert any("would touch the source" in out.reason for out in found.ruled_out)


@pytest.mark.slow
@given(
    radius=st.floats(0.03, 0.05), behind=st.floats(0.0, 0.9), share=st.floats(0.05, 1.0)
)  # fmt: skip
def test_a_point_of_a_rolling_ball_rises_as_its_motion_about_the_support_gives_it(
    radius, behind, share
):
    way, point, middle, steps = share * radius, np.array([-behind * radius, 0.0]), 0.0, 4000
    point[1] = radius * np.sqrt(1.0 - behind**2)
    begin = point.copy()
    turn = (
        1.2 * share / steps
    )  # each turn moves the point at right angles to the line from the support
    while point[0] - begin[0] < way and point[0] < middle:
        arm = point - [middle, -radius]
        point += turn * np.array([arm[1], -arm[0]])
        middle += turn * radius
    expected = point[1] - begin[1]
    assert rolled_height(point[0] - begin[0], radius, behind * radius) == pytest.approx(
        expected, abs=3e-4
    )


def test_a_pull_ends_when_its_force_is_reached_in_succession_or_the_finger_cannot_rise():
    hook = hooks_at(apple()).grasps[0]
    start = hook.T_base_grasp[:3, 3]
    pull = HookPull(hook, start, limit=1.0)
    place = next(pull.places(0.03))
    np.testing.assert_allclose((place - start) @ pull_of(hook), 0.003)
    assert not pull.ends(place, at_limit=False, change=0.5, down=0.2)
    assert pull.limit == 1.0
    for hit in range(1, HITS):
        assert not pull.ends(place, at_limit=True, change=2.1, down=0.2)
        assert pull.limit == pytest.approx(min(1.0 + hit * HARDER, bears_below(hook)))
    assert pull.came == pytest.approx(0.003)
    assert pull.ends(place, at_limit=True, change=2.2, down=0.2)
    assert (pull.came, pull.most) == (pytest.approx(0.003), 2.2)
    follows = HookPull(hook, start, limit=1.0)
    for place in follows.places(0.045):
        assert not follows.ends(place, at_limit=True, change=1.1, down=0.2), "the fruit follows"
    assert (follows.way, follows.came) == (pytest.approx(0.045), 0.0)
    pressed = HookPull(hook, start, limit=2.0)
    pressed.off = FARTHEST_OFF
    assert pressed.ends(start, at_limit=False, change=1.5, down=2.0 * DOWNWARDS)


def test_weight_and_finger_together_bruise_no_fruit_on_a_hard_floor():
    hook = hooks_at(apple()).grasps[0]
    bears = bruising(hook.fruit, HARD_MODULUS)
    assert 2.5 < weight_of(hook) < 3.5
    assert np.hypot(weight_of(hook) + DOWNWARDS, bears_below(hook)) == pytest.approx(bears)
    assert HookPull(hook, hook.T_base_grasp[:3, 3], limit=5.0).limit == bears_below(hook)
    heavy = replace(hook, fruit=replace(hook.fruit, fruit=replace(hook.fruit.fruit, mass=None)))
    assert weight_of(heavy) == bears / 2.0


def test_a_step_that_the_fruit_follows_sets_the_limit_back_and_the_first_steps_are_slow():
    hook = hooks_at(apple()).grasps[0]
    start = hook.T_base_grasp[:3, 3]
    pull = HookPull(hook, start, limit=1.0)
    held = []
    for place in pull.places(0.012):
        first = not held
        held.append(pull.is_held)
        pull.ends(start if first else place, at_limit=first, change=1.0, down=0.0)
        assert (pull.limit > 1.0) is first
        assert place[2] < start[2] + 0.01
    assert pull.off == 0.0, "a finger that presses into the flank keeps the fruit from tipping"
    assert held == [True, True, True, False, False]
