import pickle
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pomona.drivers.trajectory import check_trajectory
from pomona.skills.motion.planning.plan import PLANNERS, PlanRequest, plan
from pomona.skills.motion.planning.space import BadRequest, PlanningFailed
from tests.skills.motion.planning.disc_world import LIMITS, DiscWorld, closed_wall, wall_with_gap

START = np.array([-1.5, -1.0])
GOALS = np.array([[1.5, -1.0], [1.5, 0.0], [0.8, -1.5]])


def request(space: DiscWorld, goals: np.ndarray = GOALS, **changes: Any) -> PlanRequest:
    return replace(PlanRequest(space, START, goals, LIMITS), **changes)


def clearance_of(space: DiscWorld, q: np.ndarray) -> float:
    """By brute force, independent of the space's own segment test."""
    return float(
        (np.linalg.norm(q[:, None] - space.discs[:, :2], axis=2) - space.discs[:, 2]).min()
    )


@pytest.mark.parametrize("planner", PLANNERS)
def test_every_planner_finds_the_gap_and_its_trajectory_is_free_and_within_limits(planner):
    space = wall_with_gap(0.4)
    result = plan(request(space, planner=planner, improve="", direct=False))
    check_trajectory(result.path, LIMITS)
    np.testing.assert_allclose(result.path.q[0], START)
    np.testing.assert_allclose(result.path.q[-1], GOALS[result.goal])
    assert clearance_of(space, result.path.q) > 0.0
    assert result.found_by == planner


def test_a_straight_way_is_taken_without_a_planner():
    result = plan(request(DiscWorld(np.array([[0.0, 1.5, 0.2]]))))
    assert result.found_by == "straight"
    assert result.iterations == 0
    assert result.goal == 2  # the nearest one


def test_the_rest_of_the_budget_makes_the_path_no_slower():
    space = wall_with_gap(0.5)
    first = plan(request(space, improve="", seed=3))
    better = plan(request(space, improve="InformedRRTstar", seed=3))
    assert better.path.duration <= first.path.duration
    assert better.iterations > first.iterations


def test_a_seed_gives_the_same_path_whatever_was_planned_before():
    space = wall_with_gap(0.4)
    first = plan(request(space, seed=11))
    plan(request(space, seed=12, planner="RRTstar"))
    again = plan(request(space, seed=11))
    np.testing.assert_array_equal(first.path.q, again.path.q)
    other = plan(request(space, seed=12))
    assert not np.array_equal(first.waypoints, other.waypoints)


def test_a_blocked_goal_is_left_out_of_the_set():
    space = wall_with_gap(0.4)
    blocked = np.array([[0.0, 0.0], [1.5, 1.0]])
    assert plan(request(space, blocked)).goal == 1


def failure(request_: PlanRequest) -> PlanningFailed:
    with pytest.raises(PlanningFailed) as failed:
        plan(request_)
    assert str(pickle.loads(pickle.dumps(failed.value))) == str(
        failed.value
    )  # it comes out of another process
    return failed.value


def test_start_in_collision_names_the_obstacle():
    failed = failure(request(DiscWorld(np.array([[0.5, 0.5, 0.1], [-1.5, -1.0, 0.2]]))))
    assert failed.code == "START_IN_COLLISION"
    assert failed.data["obstacle"] == "disc 1"


def test_no_goal_in_reach_is_found_before_anything_is_planned():
    space = wall_with_gap(0.4)
    assert failure(request(space, np.empty((0, 2)))).code == "GOAL_UNREACHABLE"
    assert failure(request(space, np.array([[5.0, 0.0]]))).code == "GOAL_UNREACHABLE"
    assert space.asked <= 2


def test_goals_in_collision_fail_at_once():
    space = DiscWorld(np.array([[1.5, -0.5, 0.8], [0.8, -1.5, 0.2]]))
    failed = failure(request(space, budget=5.0))
    assert failed.code == "GOAL_IN_COLLISION"
    assert failed.data["goals"] == 3
    assert space.asked <= 20  # no tree was grown


def test_a_closed_wall_uses_up_the_budget():
    failed = failure(request(closed_wall(), GOALS[:2], budget=0.02))
    assert failed.code == "NO_PATH"
    assert failed.data["planner"] == "RRTConnect"


def test_patience_is_the_last_resort():
    failed = failure(request(closed_wall(), GOALS[:2], budget=100.0, patience=0.05))
    assert failed.code == "TIMEOUT"


def test_joints_that_are_no_joints_and_unknown_planners_are_refused():
    with pytest.raises(BadRequest, match="finite"):
        plan(request(wall_with_gap(0.4), np.array([[np.nan, 0.0]])))
    with pytest.raises(BadRequest, match="the arm's 2 joints"):
        plan(request(wall_with_gap(0.4), np.array([[0.1, 0.0, 0.3]])))
    with pytest.raises(BadRequest, match="RRTConnect"):
        plan(request(wall_with_gap(0.4), planner="AORRTC"))


FREE = np.array([[9.0, 9.0, 0.1]])


@pytest.mark.parametrize(("start", "goal", "reached"), [
    (3.1, 3.2, 3.2), (4.0, 4.2, 4.2), (7.0, 6.9, 6.9), (3.0, -3.0, 2 * np.pi - 3.0), (-40.0, -40.1 + 4 * np.pi, -40.1),
])  # fmt: skip
def test_a_joint_without_limits_goes_by_the_short_way(
    start: float, goal: float, reached: float
) -> None:
    endless = np.array([True, False])
    turn = np.array([2.0 * np.pi, 2.0])
    space = DiscWorld(FREE, lower=-turn, upper=turn, endless=endless)
    limits = replace(LIMITS, lower=np.array([-100.0, -2.0]), upper=np.array([100.0, 2.0]))
    result = plan(PlanRequest(space, np.array([start, 0.5]), np.array([[goal, -0.5]]), limits))
    assert (result.goal, result.found_by) == (0, "straight")
    assert result.path.q[0] == pytest.approx([start, 0.5])
    assert result.path.q[-1] == pytest.approx([reached, -0.5])
    assert result.waypoints[-1] == pytest.approx([reached, -0.5])
    assert np.ptp(result.path.q[:, 0]) == pytest.approx(abs(reached - start), abs=1e-6)


def test_a_joint_without_limits_goes_the_long_way_where_the_arm_has_limits() -> None:
    turn = np.full(2, 2.0 * np.pi)
    space = DiscWorld(FREE, lower=-turn, upper=turn, endless=np.array([True, False]))
    limits = replace(LIMITS, lower=np.full(2, -3.1), upper=np.full(2, 3.1))
    result = plan(PlanRequest(space, np.array([3.0, 0.0]), np.array([[-3.0, 0.0]]), limits))
    assert result.path.q[-1] == pytest.approx([-3.0, 0.0])
