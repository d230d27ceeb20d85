from typing import Any

import pytest
from py_trees.common import Status

from pomona.executive.skill_testing import drive
from pomona.executive.views import SceneView
from pomona.skills.motion.occupancy import OccupancyMap
from pomona.skills.sample_grasp import SampleGrasp
from tests.skills.picking_scene import WORKSPACE, PickingScene, apple_at, seen_map


def sample(skill: SampleGrasp, scene: PickingScene, **inputs: Any):
    given = {"around": apple_at(5, 2), "map": seen_map(), "thetas": 1, "alphas": 4, **inputs}
    return drive(skill, given, scene.devices, clock=scene.clock)


def test_all_candidates_come_best_first_and_the_others_with_a_reason():
    outcome = sample(SampleGrasp(), PickingScene(), thetas=3, alphas=8)
    assert outcome.status is Status.SUCCESS
    candidates = outcome.outputs["candidates"]
    assert candidates.attempt == 1
    assert len(candidates.grasps) + len(candidates.ruled_out) == 24
    assert all(out.reason for out in candidates.ruled_out)
    topic, view = outcome.published[0]
    assert topic == "candidates"
    assert isinstance(view, SceneView)
    assert sum(len(points.points) for points in view.points) == 24


def test_every_attempt_takes_the_next_then_samples_more_finely_until_all_are_tried():
    scene, skill, seen, tried, counts = PickingScene(), SampleGrasp(), set(), None, []
    near = {"thetas": 1, "alphas": 2}
    while (outcome := sample(skill, scene, tried=tried, **near)).status is Status.SUCCESS:
        candidates = outcome.outputs["candidates"]
        tried = candidates.grasps[0]
        assert (tried.theta, tried.alpha) not in seen
        seen.add((tried.theta, tried.alpha))
        counts.append(len(candidates.grasps))
    assert outcome.reason.code == "ALL_TRIED"
    assert counts == [2, 1, 2, 1, 4, 3, 2, 1]  # 2 of 2, then the 2 new of 4, then the 4 new of 8


def test_one_at_a_time_counts_as_tried_by_itself():
    scene, skill = PickingScene(), SampleGrasp()
    first = sample(skill, scene, check=False).outputs["candidates"].grasps
    second = sample(skill, scene, check=False).outputs["candidates"].grasps
    assert [len(first), len(second)] == [1, 1]
    assert [first[0].index, second[0].index] == [0, 1]


def test_a_new_fruit_starts_afresh():
    scene, skill = PickingScene(), SampleGrasp()
    sample(skill, scene, check=False)
    other = sample(skill, scene, check=False, around=apple_at(5, 1)).outputs["candidates"]
    assert other.attempt == 1
    assert other.grasps[0].index == 0


def test_when_nothing_is_left_the_reasons_are_counted():
    far = apple_at(5, 2)
    far.T_base_fruit[0, 3] += 0.5
    outcome = sample(SampleGrasp(), PickingScene(), around=far)
    assert outcome.reason.code == "NO_CANDIDATE"
    assert "16 unreachable" in outcome.reason.message


def test_the_fingers_open_by_the_air_that_is_given():
    widths = [
        sample(SampleGrasp(), PickingScene(), air=air).outputs["candidates"].grasps[0].width
        for air in (3e-3, 6e-3)
    ]
    assert widths[1] - widths[0] == pytest.approx(6e-3, abs=1e-4)


@pytest.mark.slow
def test_a_stale_or_empty_map_is_not_free():
    scene = PickingScene()
    scene.clock.advance(500.0)
    assert sample(SampleGrasp(), scene).reason.code == "MAP_STALE"
    empty = OccupancyMap.empty(WORKSPACE.lower, WORKSPACE.upper, 0.02)
    assert sample(SampleGrasp(), PickingScene(), map=empty).reason.code == "MAP_STALE"


def test_interrupted_it_gives_up_and_the_next_start_counts_as_another_attempt():
    scene, skill = PickingScene(), SampleGrasp()
    given = {"around": apple_at(5, 2), "map": seen_map(), "thetas": 1, "alphas": 4}
    outcome = drive(skill, given, scene.devices, clock=scene.clock, computing=10, interrupt_after=5)
    assert outcome.status is Status.INVALID
    assert outcome.cancelled == 1
    assert outcome.outputs == {}
    assert outcome.published == ()
    again = drive(skill, given, scene.devices, clock=scene.clock, computing=10)
    assert again.outputs["candidates"].attempt == 2
    assert len(again.outputs["candidates"].grasps) + len(again.outputs["candidates"].ruled_out) == 4
