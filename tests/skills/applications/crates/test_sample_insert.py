import numpy as np
import pytest
from py_trees.common import Status

from pomona.applications.crates.sample_insert import SampleInsert
from pomona.executive.skill_testing import drive
from tests.skills.applications.crates.wall_scene import apple
from tests.skills.picking_scene import PickingScene, seen_map

RING = [(0.091 * np.cos(a), 0.091 * np.sin(a)) for a in np.arange(0.0, 2.0 * np.pi, np.pi / 3.0)]
"""Six neighbours around a fruit."""


def test_inserts_are_given_as_goals_of_plan_and_nothing_moves():
    scene = PickingScene()
    around = apple((0.104, 0.0), (-0.104, 0.0))
    outcome = drive(
        SampleInsert(), {"around": around, "map": seen_map()}, scene.devices, clock=scene.clock
    )
    assert outcome.status is Status.SUCCESS
    assert len(outcome.outputs["candidates"].grasps[0].q_pre_grasp) > 0
    assert outcome.published[-1][0] == "candidates"
    assert not scene.arm.followed


@pytest.mark.parametrize("code", ["NO_CANDIDATE", "MAP_STALE"])
def test_every_failure(code):
    scene = PickingScene()
    around = apple(*RING) if code == "NO_CANDIDATE" else apple()
    stamp = -1000.0 if code == "MAP_STALE" else 0.0
    outcome = drive(
        SampleInsert(), {"around": around, "map": seen_map(stamp)}, scene.devices, clock=scene.clock
    )
    assert outcome.reason.code == code
    assert not scene.arm.followed


def test_interrupted_it_gives_nothing():
    scene = PickingScene()
    inputs = {"around": apple((0.104, 0.0), (-0.104, 0.0)), "map": seen_map()}
    outcome = drive(
        SampleInsert(), inputs, scene.devices, clock=scene.clock, computing=10, interrupt_after=5
    )
    assert outcome.status is Status.INVALID
    assert outcome.outputs == {}
