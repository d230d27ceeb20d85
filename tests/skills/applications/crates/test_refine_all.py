from dataclasses import replace

import numpy as np
import pytest
from py_trees.common import Status

from pomona.applications.crates import fruit_scene
from pomona.applications.crates.fruit_scene import SeenFruit, measure_all
from pomona.applications.crates.refine_all import RefineAll
from pomona.drivers.interfaces import Workspace
from pomona.executive.skill_testing import SkillEnd, drive
from pomona.skills.perception.detection.detection import AllDetections
from pomona.skills.perception.refinement.errors import NoDepth
from tests.skills.applications.crates.test_choose_fruit import seen
from tests.skills.picking_scene import WORKSPACE, PickingScene


def refine_all(monkeypatch, *fruit: SeenFruit, **settings) -> SkillEnd:
    """Refine the detections of fruit whose measurements are known."""
    known = {id(one.detection): one.measured for one in fruit}

    def measure(detection, table_z):
        found = known[id(detection)]
        if found is None:
            raise NoDepth(0, 0)
        return found

    monkeypatch.setattr(fruit_scene, "measure", measure)
    detections = tuple(one.detection for one in fruit)
    all = AllDetections(detections, detections[0].frame, np.eye(4))
    scene = PickingScene()
    return drive(RefineAll(), {"detections": all}, {Workspace: WORKSPACE}, clock=scene.clock, **settings)


def test_every_fruit_is_measured_and_a_failed_one_keeps_its_reason(monkeypatch):
    outcome = refine_all(monkeypatch, seen(0.0, 0.0), seen(0.1, 0.0, failed=True), seen(0.2, 0.0))
    assert outcome.status is Status.SUCCESS, outcome.reason
    scene = outcome.outputs["scene"]
    assert [one.measured is not None for one in scene.fruit] == [True, False, True]
    assert scene.fruit[1].why
    assert scene.sentence.startswith("2 of 3 fruit measured; ")


def test_without_any_measurement_it_fails_and_gives_the_reason(monkeypatch):
    outcome = refine_all(monkeypatch, seen(0.0, 0.0, failed=True))
    assert outcome.reason.code == "NOTHING_MEASURED"
    assert outcome.reason.data["found"] == 1


@pytest.mark.parametrize("worse", [0, 1])
def test_of_two_fruit_that_overlap_the_one_with_the_worse_depth_is_not_measured(monkeypatch, worse):
    fruit = [seen(0.0, 0.0), seen(0.03, 0.0), seen(0.2, 0.0)]
    for k, one in enumerate(fruit):
        assert one.measured is not None
        fruit[k] = replace(one, measured=replace(one.measured, inlier_ratio=0.5 if k == worse else 0.9))
    scene = refine_all(monkeypatch, *fruit).outputs["scene"]
    assert [one.measured is None for one in scene.fruit] == [k == worse for k in range(3)]
    assert "another fruit" in scene.fruit[worse].why


def test_fruit_that_touches_does_not_overlap(monkeypatch):
    assert len(refine_all(monkeypatch, seen(0.0, 0.0), seen(0.088, 0.0)).outputs["scene"].measured) == 2


def test_interrupted_it_gives_nothing(monkeypatch):
    outcome = refine_all(monkeypatch, seen(0.0, 0.0), computing=10, interrupt_after=5)
    assert outcome.status is Status.INVALID
    assert outcome.outputs == {}


def test_no_detections_are_an_empty_scene():
    assert measure_all((), -0.12).measured == ()
