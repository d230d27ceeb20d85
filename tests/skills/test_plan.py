from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from py_trees.common import Status

from pomona.drivers.trajectory import check_trajectory
from pomona.executive.skill_testing import drive
from pomona.executive.views import SceneView
from pomona.skills.motion.collision import CollisionWorld
from pomona.skills.motion.grasp import GraspCandidates
from pomona.skills.motion.occupancy import OccupancyMap
from pomona.skills.motion.occupancy.occupancy_map import OCCUPIED
from pomona.skills.plan import Plan
from tests.skills.picking_scene import (
    OBSERVE,
    ROBOT_MODEL,
    WORKSPACE,
    PickingScene,
    RealTimeClock,
    a_grasp,
    seen_map,
)

GRASPS = (a_grasp(1, 3), a_grasp(1, 3, theta=np.pi / 6.0))


def candidates(*grasps) -> GraspCandidates:
    return GraspCandidates(tuple(grasps), (), 1)


def plan(scene: PickingScene | None = None, skill: Plan | None = None, **inputs: Any):
    scene = scene or PickingScene()
    given = {"to": candidates(*GRASPS), "map": seen_map(), **inputs}
    return drive(skill or Plan(), given, scene.devices, clock=scene.clock)


def test_the_path_leads_to_the_grasp_that_it_names():
    scene = PickingScene()
    outcome = plan(scene)
    assert outcome.status is Status.SUCCESS
    path, grasp = outcome.outputs["path"], outcome.outputs["grasp"]
    assert grasp in GRASPS
    np.testing.assert_allclose(path.q[0], OBSERVE)
    np.testing.assert_allclose(ROBOT_MODEL.tcp(path.q[-1]), grasp.T_base_pre_grasp, atol=1e-6)
    check_trajectory(path, scene.arm.limits)
    world = CollisionWorld.build(ROBOT_MODEL, WORKSPACE)
    assert world.check_trajectory(path, scene.width) is None
    assert isinstance(dict(outcome.published)["path"], SceneView)


def test_a_seed_gives_the_same_path_in_every_run():
    one, other = (plan(planner="RRTConnect", direct=False) for _ in range(2))
    np.testing.assert_array_equal(one.outputs["path"].q, other.outputs["path"].q)


def test_the_papers_way_is_a_choice():
    outcome = plan(
        to=candidates(GRASPS[0]), planner="RRTstar", improve="none", direct=False, budget=0.1
    )
    assert outcome.status is Status.SUCCESS


def test_no_candidate_is_unreachable():
    assert plan(to=candidates()).reason.code == "GOAL_UNREACHABLE"


def test_candidates_in_collision_are_named_with_link_and_obstacle():
    grasp = GRASPS[0]
    seen = seen_map()
    states = seen.states.copy()
    i, j, k = seen.cell_of(grasp.T_base_pre_grasp[:3, 3])
    states[i - 3 : i + 3, j - 3 : j + 3, k - 3 : k + 3] = OCCUPIED
    outcome = plan(to=candidates(grasp), map=replace(seen, states=states))
    assert outcome.reason.code == "GOAL_IN_COLLISION"
    assert outcome.reason.data["obstacle"] == "map"
    assert outcome.reason.data["link"]
    assert outcome.reason.data["candidates"] == [grasp.index]


def test_a_start_in_collision_names_the_place():
    seen = seen_map()
    states = seen.states.copy()
    i, j, k = seen.cell_of(ROBOT_MODEL.tcp(OBSERVE)[:3, 3])
    states[i - 2 : i + 2, j - 2 : j + 2, k - 2 : k + 2] = OCCUPIED
    outcome = plan(map=replace(seen, states=states))
    assert outcome.reason.code == "START_IN_COLLISION"
    assert outcome.reason.data["obstacle"] == "map"


def test_a_budget_that_is_used_up_is_no_path_and_the_next_planner_may_find_one():
    outcome = plan(planner="RRT", improve="none", direct=False, budget=1e-3)
    assert outcome.reason.code == "NO_PATH"
    assert outcome.reason.data["planner"] == "RRT"
    assert plan(planner="RRTConnect", direct=False, budget=0.2).status is Status.SUCCESS


@pytest.mark.slow
@pytest.mark.parametrize("seen", [None, 0.0])
def test_a_map_that_is_empty_or_old_is_not_planned_in(seen):
    scene = PickingScene()
    scene.clock.advance(300.0)
    old = (
        OccupancyMap.empty(WORKSPACE.lower, WORKSPACE.upper, 0.02)
        if seen is None
        else seen_map(seen)
    )
    outcome = plan(scene, map=old)
    assert outcome.reason.code == "MAP_STALE"


def test_planning_that_takes_too_long_is_cancelled_and_reported():
    scene = PickingScene(clock=RealTimeClock())
    given = {"to": candidates(*GRASPS), "map": seen_map(), "budget": 0.2}
    outcome = drive(Plan(), given, scene.devices, clock=scene.clock, computing=10**9)
    assert outcome.reason.code == "TIMEOUT"
    assert outcome.cancelled == 1
    assert 5.0 < outcome.duration < 5.5  # the budget and a cold start


def test_interrupted_planning_is_cancelled_and_leaves_nothing_behind():
    scene = PickingScene()
    given = {"to": candidates(*GRASPS), "map": seen_map()}
    skill = Plan()
    outcome = drive(skill, given, scene.devices, clock=scene.clock, computing=10, interrupt_after=5)
    assert outcome.status is Status.INVALID
    assert outcome.cancelled == 1
    assert outcome.outputs == {}
    assert outcome.published == ()
    assert (
        drive(skill, given, scene.devices, clock=scene.clock, computing=10).status is Status.SUCCESS
    )
