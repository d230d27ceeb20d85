import numpy as np
import pytest
from hypothesis import given, strategies as st

from pomona.applications.crates.insertion import ENOUGH, FARTHEST, STOPS, FeltByHand, Insertion
from pomona.skills.geometry import rot_x, rot_z, transform

FREE = FeltByHand(np.zeros((2, 3)), 0.0)
"""Pads that feel nothing."""
HEIGHT = -0.08


def law(crowded: float = 0.0, turn: float = 0.0, blocked=lambda _p: False) -> Insertion:
    """A hand 100 mm over its lowest place, at a limit of 2 N."""
    return Insertion(
        transform(rot_z(turn) @ rot_x(np.pi), [0.1, -0.4, 0.02]), HEIGHT, 2.0, crowded, blocked
    )


def over(left: float = 0.05, x: float = 0.1, y: float = -0.4) -> np.ndarray:
    """A place a distance over the lowest one [m]."""
    return np.array([x, y, HEIGHT + left])


def pressed(left: float = 0.0, right: float = 0.0) -> FeltByHand:
    """Pads that the fruit between them presses [N]."""
    return FeltByHand(np.array([[0.0, 0.0, -left], [0.0, 0.0, -right]]), 0.0)


def test_hands_that_feel_nothing_go_straight_to_the_lowest_place():
    kind, place, _ = law().next(over(), FREE, False)
    assert kind == "down"
    np.testing.assert_allclose(place, over(0.0))


def test_a_hand_at_its_lowest_place_has_arrived():
    insertion = law()
    assert insertion.next(over(1e-4), FREE, False) is None
    assert insertion.arrived


@given(st.floats(1.1, 1.7), st.floats(-np.pi, np.pi))
def test_the_hand_gives_way_along_the_force_on_a_pad_and_not_down(force, turn):
    along = (rot_z(turn) @ rot_x(np.pi))[:, 1]
    for felt, sign in ((pressed(left=force), 1.0), (pressed(right=force), -1.0)):
        kind, place, _ = law(turn=turn).next(over(), felt, True)
        moved = place - over()
        assert kind == "aside"
        assert sign * moved @ along == pytest.approx(np.linalg.norm(moved))
        assert 0.0 < np.linalg.norm(moved) < 2e-3


@pytest.mark.parametrize("crowded", [1.0, -1.0])
def test_a_push_from_outside_moves_the_hand_away_from_the_crowded_side(crowded):
    _, place, _ = law(crowded).next(over(), FeltByHand(np.zeros((2, 3)), 1.5), True)
    along = rot_x(np.pi)[:, 1]
    assert crowded * (place - over()) @ along < 0.0


def test_a_force_beyond_the_limit_moves_the_hand_up():
    kind, place, _ = law().next(over(), pressed(left=2.5), True)
    assert kind == "up"
    assert place[2] > over()[2]


def test_a_hand_never_gives_way_towards_a_wall_nor_farther_than_allowed():
    kind, place, stop = law(blocked=lambda _p: True).next(over(), pressed(left=1.5), True)
    assert (kind, stop) == ("down", 2.0)  # the fruit shall give way then
    np.testing.assert_allclose(place[:2], over()[:2])
    far = over(y=-0.4 - FARTHEST)
    _, place, _ = law().next(
        far, pressed(left=1.5), True
    )  # a turn of 180° about x: to the side of -y
    np.testing.assert_allclose(place[:2], far[:2])


@pytest.mark.parametrize(("left", "arrived"), [(0.03, False), (0.5 * ENOUGH, True)])
def test_a_hand_that_gains_nothing_ends_and_has_arrived_if_the_pads_are_beside_the_fruit(
    left, arrived
):
    insertion, stops = law(), 0
    while insertion.next(over(left), pressed(left=1.5), True) is not None:
        stops += 1
        assert stops < 50
    assert stops >= STOPS
    assert insertion.arrived is arrived
    assert insertion.most == pytest.approx(1.5)
