import pytest
from py_trees.common import Status

from pomona.applications.crates.sample_hook import SampleHook
from pomona.executive.skill_testing import drive
from tests.skills.applications.crates.wall_scene import AT_WALL, apple
from tests.skills.picking_scene import WORKSPACE, PickingScene, seen_map


def test_hooks_are_given_as_goals_of_plan_and_nothing_moves():
    scene = PickingScene(workspace=AT_WALL)
    outcome = drive(
        SampleHook(), {"around": apple(), "map": seen_map()}, scene.devices, clock=scene.clock
    )
    assert outcome.status is Status.SUCCESS
    assert outcome.outputs["candidates"].grasps[0].alpha == 0.0
    assert outcome.published[-1][0] == "candidates"
    assert not scene.arm.followed


@pytest.mark.parametrize("code", ["NO_WALL", "NO_CANDIDATE", "MAP_STALE"])
def test_every_failure(code):
    scene = PickingScene(workspace=WORKSPACE if code == "NO_WALL" else AT_WALL)
    around = (
        [(0.093, 0.0), (-0.093, 0.0), (0.0, 0.093), (0.07, 0.07), (-0.07, 0.07)]
        if code == "NO_CANDIDATE"
        else []
    )
    stamp = -1000.0 if code == "MAP_STALE" else 0.0
    outcome = drive(
        SampleHook(),
        {"around": apple(*around), "map": seen_map(stamp)},
        scene.devices,
        clock=scene.clock,
    )
    assert outcome.reason.code == code
    assert not scene.arm.followed


def test_interrupted_it_gives_nothing():
    scene = PickingScene(workspace=AT_WALL)
    inputs = {"around": apple(), "map": seen_map()}
    outcome = drive(
        SampleHook(), inputs, scene.devices, clock=scene.clock, computing=10, interrupt_after=5
    )
    assert outcome.status is Status.INVALID
    assert outcome.outputs == {}
