"""The motion of a pick from the belt: matched speeds, limits, rise; refusals before anything moves."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from pomona.applications.conveyor.intercepting import (
    ABOVE,
    BRAKES,
    CLOSING,
    LIFTS,
    QUICK,
    SINKING,
    InterceptPlan,
    NoPick,
    ReadyHand,
    Rise,
    ellipse_radius,
    grip_yaws,
    in_the_way,
    plan_pick,
    plumb,
    reachable,
)
from pomona.skills.motion import nearest_solution
from pomona.tools.mock.arm import SIA5F_LIMITS
from tests.skills.applications.conveyor.belt_rig import MODEL, workspace

ALONG = np.array([1.0, 0.0, 0.0])
HAND = ReadyHand(MODEL, SIA5F_LIMITS, workspace().poses["watch"], 0.15, lambda _: "")


def belt_place(x: float, speed: float, y: float = -0.36):
    return lambda t: (np.array([x + speed * t, y, -0.085]), np.array([speed, 0.0, 0.0]))


def planned(x: float, speed: float, hand: ReadyHand = HAND) -> InterceptPlan:
    """Plan at the first moment at which it is possible."""
    for now in np.arange(0.0, 4.0, 0.1):
        pick = plan_pick(hand, float(now), belt_place(x, speed), np.zeros(3), (0.0,), ALONG)
        if isinstance(pick, InterceptPlan):
            return pick
    raise AssertionError(pick.reason)


@given(st.floats(0.0, 0.3), st.floats(-0.04, 0.04))
@settings(max_examples=8, deadline=None)
def test_the_hand_starts_where_it_is_at_rest_and_ends_around_the_fruit_at_its_speed(
    speed: float, aside: float
) -> None:
    place = belt_place(-0.5 if speed > 0.03 else -0.1, speed, -0.36 + aside)
    pick = None
    for now in np.arange(0.0, 14.0, 0.2):
        pick = plan_pick(HAND, float(now), place, np.zeros(3), (0.0,), ALONG)
        if isinstance(pick, InterceptPlan):
            break
    assert isinstance(pick, InterceptPlan)
    h = 1e-4

    def velocity(t: float) -> np.ndarray:
        return (pick.pose(t + h, place)[:3, 3] - pick.pose(t, place)[:3, 3]) / h

    assert pick.pose(pick.t0, place) == pytest.approx(MODEL.tcp(HAND.q), abs=1e-9)
    assert velocity(pick.t0) == pytest.approx(np.zeros(3), abs=1e-3)
    over = pick.t0 + pick.reach
    assert pick.pose(over, place)[:3, 3] - place(over)[0] == pytest.approx(
        [0.0, 0.0, ABOVE], abs=1e-9
    )
    sinks = -SINKING * ABOVE / pick.descent
    assert velocity(over) == pytest.approx([speed, 0.0, sinks], abs=2e-3)
    h = -h  # and so it comes there
    assert velocity(over) == pytest.approx([speed, 0.0, sinks], abs=2e-3)
    assert pick.pose(pick.arrival, place)[:3, 3] == pytest.approx(place(pick.arrival)[0], abs=1e-9)
    assert velocity(pick.arrival + 0.1) == pytest.approx([speed, 0.0, 0.0], abs=1e-6)
    assert 0.0 < pick.share <= 0.8


def test_a_corrected_place_moves_the_hand_by_as_much_and_no_more() -> None:
    pick = planned(-0.5, 0.15)
    shift = np.array([0.002, -0.001, 0.0])
    at = belt_place(-0.5, 0.15)

    def moved(t: float) -> tuple[np.ndarray, np.ndarray]:
        p, v = at(t)
        return p + shift, v

    for t in np.linspace(pick.t0, pick.arrival, 7):
        assert pick.pose(t, moved)[:3, 3] - pick.pose(t, at)[:3, 3] == pytest.approx(
            shift, abs=1e-12
        )


@given(st.floats(0.0, 0.5), st.floats(0.05, 0.3))
@settings(max_examples=30, deadline=None)
def test_a_rise_starts_with_the_belt_and_ends_at_rest_above(speed: float, height: float) -> None:
    T = np.eye(4)
    rise = Rise(1.0, T, np.array([speed, 0.0, 0.0]), height)
    h = 1e-5
    first = (rise.pose(1.0 + h)[:3, 3] - T[:3, 3]) / h
    assert first == pytest.approx([speed, 0.0, 0.0], abs=1e-2)
    assert np.array_equal(rise.pose(rise.end + 0.5), rise.pose(rise.end + 1.0))
    assert rise.pose(rise.end)[2, 3] == pytest.approx(height)
    heights = [rise.pose(t)[2, 3] for t in np.linspace(1.0, rise.end, 50)]
    assert (np.diff(heights) >= -1e-12).all()


@pytest.mark.parametrize("height", [0.05, 0.15, 0.4])
def test_a_lift_of_any_height_accelerates_a_fruit_no_more_than_one_that_is_carried(
    height: float,
) -> None:
    rise = Rise(0.0, np.eye(4), np.array([0.3, 0.0, 0.0]), height)
    t = np.arange(0.0, rise.end, 1e-3)
    z = np.array([rise.pose(float(each))[2, 3] for each in t])
    assert np.abs(np.diff(z, 2)).max() / 1e-6 <= LIFTS * 1.01


@pytest.mark.parametrize("aside", [-0.045, 0.0, 0.045])
def test_the_hand_can_set_off_all_along_120_mm_of_a_belt_at_300_mm_a_second_and_descends_within_limits(
    aside: float,
) -> None:
    for x in (-0.48, -0.42, -0.36):
        place = belt_place(x, 0.3, -0.36 + aside)
        pick = plan_pick(HAND, 0.0, place, np.zeros(3), (0.0,), ALONG)
        assert isinstance(pick, InterceptPlan), f"{x}: {pick.reason}"
        t, q, way = np.arange(0.0, pick.arrival + 0.1, 0.01), HAND.q, []
        for each in t:
            solved = nearest_solution(MODEL, pick.pose(float(each), place), q)
            assert solved is not None
            q = solved
            way.append(q)
        pace = (
            np.abs(np.gradient(np.gradient(np.array(way), 0.01, axis=0), 0.01, axis=0))
            / SIA5F_LIMITS.acceleration
        )
        assert pace.max() < 1.0


def test_an_operator_is_shown_that_a_fruit_cannot_be_reached_yet_and_later_that_it_is_too_far_on() -> (
    None
):
    early = plan_pick(HAND, 0.0, belt_place(-0.9, 0.3), np.zeros(3), (0.0,), ALONG)
    assert isinstance(early, NoPick)
    assert re.fullmatch(
        r"the fruit (is not near enough|cannot be reached) yet(: it takes .*)?", early.reason
    )
    reasons = [
        plan_pick(HAND, 0.0, belt_place(x, 0.3), np.zeros(3), (0.0,), ALONG)
        for x in np.arange(-0.2, 0.3, 0.1)
    ]
    late = [pick.reason for pick in reasons if isinstance(pick, NoPick) and pick.late]
    assert late
    assert all(
        re.fullmatch(r"the fruit is too far on: it takes \d+\.\d\d times what .*", words)
        for words in late
    )


UPSTREAM = ReadyHand(MODEL, SIA5F_LIMITS, workspace().poses["watch_2"], 0.15, lambda _: "")


@pytest.mark.parametrize(("x", "speed"), [(-0.57, 0.4), (-0.57, 0.5), (-0.5, 0.5)])
def test_a_fast_belt_is_caught_from_further_upstream_with_less_time_at_the_fruit(
    x: float, speed: float
) -> None:
    pick = plan_pick(UPSTREAM, 0.0, belt_place(x, speed), np.zeros(3), (0.0,), ALONG)
    assert isinstance(pick, InterceptPlan), pick.reason
    assert pick.share <= 0.8
    rests = max(np.sqrt(5.774 * 0.15 / LIFTS), sum(BRAKES[1]))
    assert pick.times[-1] == pytest.approx(pick.arrival + QUICK + rests)


def test_at_300_mm_a_second_and_below_the_time_at_the_fruit_and_the_brakes_are_as_before() -> None:
    pick = planned(-0.5, 0.3)
    rests = max(np.sqrt(5.774 * 0.15 / LIFTS), sum(BRAKES[0]))
    assert pick.times[-1] == pytest.approx(pick.arrival + CLOSING + rests)


@pytest.mark.parametrize("brakes", BRAKES)
def test_the_brakes_of_a_rise_bring_it_to_rest_within_their_times(
    brakes: tuple[float, float],
) -> None:
    rise = Rise(0.0, np.eye(4), np.array([0.5, 0.0, 0.0]), 0.05, brakes)
    ridden = rise.pose(sum(brakes))[0, 3]
    assert ridden == pytest.approx(0.5 * (brakes[0] + brakes[1] / 2.0))
    assert rise.pose(5.0)[0, 3] == ridden


def test_a_fruit_beyond_the_reach_gives_no_pick_and_no_code_since_another_may_come() -> None:
    gone = plan_pick(HAND, 0.0, belt_place(1.2, 0.1), np.zeros(3), (0.0,), ALONG)
    assert isinstance(gone, NoPick)
    assert gone.code == ""


@pytest.mark.slow
@pytest.mark.parametrize(("speed", "aside"), [(0.15, 0.04), (0.3, -0.04), (0.3, 0.03)])
def test_a_fruit_that_is_too_far_on_is_never_caught_by_a_later_start(
    speed: float, aside: float
) -> None:
    place = belt_place(-0.75, speed, -0.36 + aside)
    picks = [
        plan_pick(HAND, float(now), place, np.zeros(3), (0.0,), ALONG)
        for now in np.arange(0.0, 0.9 / speed, 0.1)
    ]
    late = next(i for i, pick in enumerate(picks) if isinstance(pick, NoPick) and pick.late)
    assert not any(isinstance(pick, InterceptPlan) for pick in picks[late:])
    assert any(isinstance(pick, InterceptPlan) for pick in picks[:late])
    assert picks[late].code == "OUT_OF_REACH"


def test_a_way_that_is_not_free_is_blocked_with_its_reason() -> None:
    blocked = ReadyHand(
        MODEL, SIA5F_LIMITS, HAND.q, 0.15, lambda way: f"link 3 touches the roof at {len(way)}"
    )
    for now in np.arange(0.0, 4.0, 0.1):
        pick = plan_pick(blocked, float(now), belt_place(-0.5, 0.15), np.zeros(3), (0.0,), ALONG)
        assert isinstance(pick, NoPick)
        if pick.code:
            break
    assert pick.code == "OUT_OF_REACH"
    assert "touches the roof" in pick.reason


def test_the_belt_before_the_robot_is_reachable_for_more_than_half_a_metre() -> None:
    low, high = reachable(HAND, np.array([-0.4, -0.36, -0.085]), plumb(ALONG, 0.0), ALONG)
    assert -0.4 + low < -0.25
    assert -0.4 + high > 0.25


def test_a_long_fruit_is_gripped_across_and_a_round_one_without_a_turn() -> None:
    angles = np.linspace(0.0, 2.0 * np.pi, 40)
    ring = np.stack([np.cos(angles), np.zeros(40), np.sin(angles)], axis=1)
    lies = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    yaws, width = grip_yaws(0.04 * ring, lies, ALONG)
    assert yaws[0] == 0.0
    assert width == pytest.approx(0.08, abs=1e-3)
    long = ring * np.array([0.029, 1.0, 0.041])  # its long axis lies across the belt
    yaws, width = grip_yaws(long, lies, ALONG)
    assert abs(yaws[0]) > np.radians(60.0)
    assert width < 0.063


def test_the_ellipse_of_a_known_covariance() -> None:
    assert ellipse_radius(np.diag([4e-6, 1e-6, 1.0])) == pytest.approx(2.146 * 2e-3)


def test_a_neighbour_beside_the_open_finger_overlaps_and_one_behind_does_not() -> None:
    grip = plumb(ALONG, 0.0)
    fruit = np.array([0.0, -0.36, -0.085])
    beside, behind = fruit + np.array([0.0, 0.09, 0.0]), fruit + np.array([0.12, 0.0, 0.0])
    assert in_the_way([(beside, 0.04)], fruit, grip, 0.09) > 0.0
    assert in_the_way([(behind, 0.045)], fruit, grip, 0.09) < 0.0
    assert in_the_way([], fruit, grip, 0.09) < 0.0
