from dataclasses import replace

import numpy as np
import pytest
from py_trees.common import Status

from pomona.applications.crates import fruit_scene
from pomona.applications.crates.fruit_scene import SeenFruit, in_the_air, measure_all
from pomona.applications.crates.refine_all import RefineAll
from pomona.drivers.interfaces import Box, Frame, Workspace
from pomona.executive.skill_testing import SkillEnd, drive
from pomona.skills.geometry import rot_x, rot_y, transform
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
    return drive(
        RefineAll(), {"detections": all}, {Workspace: WORKSPACE}, clock=scene.clock, **settings
    )


def test_every_fruit_is_measured_and_a_failed_one_keeps_its_reason(monkeypatch):
    outcome = refine_all(monkeypatch, seen(0.0, 0.0), seen(0.1, 0.0, failed=True), seen(0.2, 0.0))
    assert outcome.status is Status.SUCCESS, outcome.reason
    scene = outcome.outputs["scene"]
    assert [one.measured is not None for one in scene.fruit] == [True, False, True]
    assert scene.fruit[1].why
    assert scene.sentence.startswith("2 of 3 fruit measured; ")


def test_without_any_measurement_it_fails_and_gives_each_reason_once(monkeypatch):
    outcome = refine_all(monkeypatch, seen(0.0, 0.0, failed=True), seen(0.1, 0.0, failed=True))
    assert outcome.reason.code == "NOTHING_MEASURED"
    assert outcome.reason.data["found"] == 2
    assert outcome.reason.message.count("; ") == 1
    assert "2 times: " in outcome.reason.message


@pytest.mark.parametrize("worse", [0, 1])
def test_of_two_fruit_that_overlap_the_one_with_the_worse_depth_is_not_measured(monkeypatch, worse):
    fruit = [seen(0.0, 0.0), seen(0.03, 0.0), seen(0.2, 0.0)]
    for k, one in enumerate(fruit):
        assert one.measured is not None
        fruit[k] = replace(
            one, measured=replace(one.measured, inlier_ratio=0.5 if k == worse else 0.9)
        )
    scene = refine_all(monkeypatch, *fruit).outputs["scene"]
    assert [one.measured is None for one in scene.fruit] == [k == worse for k in range(3)]
    assert "another fruit" in scene.fruit[worse].why


def test_fruit_that_touches_does_not_overlap(monkeypatch):
    assert (
        len(refine_all(monkeypatch, seen(0.0, 0.0), seen(0.088, 0.0)).outputs["scene"].measured)
        == 2
    )


def raised(one: SeenFruit, height: float, whole: bool = False) -> SeenFruit:
    """A fruit that was measured higher [m], partly hidden or seen whole."""
    assert one.measured is not None
    T_base_fruit = one.measured.T_base_fruit.copy()
    T_base_fruit[2, 3] += height
    return replace(
        one,
        measured=replace(
            one.measured, T_base_fruit=T_base_fruit, inlier_ratio=0.98 if whole else 0.6
        ),
    )


def test_a_hidden_fruit_with_the_depth_of_the_one_above_it_is_not_measured(monkeypatch):
    below, above = seen(0.0, 0.0), raised(seen(0.05, 0.0), 0.065, whole=True)
    wrong = raised(seen(0.14, 0.0), 0.087)
    scene = refine_all(monkeypatch, below, above, wrong).outputs["scene"]
    assert [one.measured is not None for one in scene.fruit] == [True, True, False]
    assert "another fruit" in scene.fruit[2].why


@pytest.mark.parametrize("whole", [False, True])
def test_a_fruit_on_others_is_measured_and_one_that_is_seen_whole_needs_none(monkeypatch, whole):
    below = () if whole else (seen(0.0, 0.0),)
    scene = refine_all(monkeypatch, *below, raised(seen(0.05, 0.0), 0.065, whole)).outputs["scene"]
    assert len(scene.measured) == len(scene.fruit)


def test_a_box_of_the_cell_carries_fruit_where_it_is_and_not_beside_it():
    fruit = raised(seen(0.0, 0.0), 0.1).measured
    assert fruit is not None
    stand = Box("stand", transform(None, [*fruit.T_base_fruit[:2, 3], -0.07]), (0.1, 0.1, 0.05))
    beside = replace(stand, T_base_box=transform(None, [0.3, -0.5, -0.07]))
    table_z = WORKSPACE.table_z
    assert table_z is not None
    assert in_the_air(fruit, (), table_z)
    assert not in_the_air(fruit, (), table_z, (stand,))
    assert in_the_air(fruit, (), table_z, (beside,))


TRUE = transform(rot_x(2.8), (-0.04, -0.25, 0.60))
"""A camera's pose above the table, (4, 4)."""


@pytest.mark.parametrize(
    ("turned", "mirrored", "code"),
    [
        (0.0, False, "NOTHING_MEASURED"),
        (2.0, False, "POSE_MISMATCH"),
        (6.0, True, "DEPTH_MISMATCH"),
    ],
)
def test_a_look_that_does_not_fit_the_cell_is_refused(camera, turned, mirrored, code):
    T_base_camera = TRUE @ transform(
        rot_y(np.radians(turned)), (0.0, 0.0, 0.004 if turned else 0.0)
    )
    v, u = np.indices((camera.height, camera.width))
    rays = np.stack(
        [(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones(u.shape)], axis=-1
    )
    seen_from = TRUE if not mirrored else T_base_camera
    depth = ((seen_from[2, 3] + 0.12) / -(rays @ seen_from[2, :3])).astype(np.float32)
    depth = depth[:, ::-1].copy() if mirrored else depth
    frame = Frame(
        1.0,
        0,
        np.zeros((camera.height, camera.width, 3), np.uint8),
        depth,
        camera,
        None,
        T_base_camera,
    )
    workspace = Workspace(-0.12, np.full(3, -1.0), np.full(3, 1.0))
    outcome = drive(
        RefineAll(), {"detections": AllDetections((), frame, T_base_camera)}, {Workspace: workspace}
    )
    assert outcome.reason.code == code
    assert outcome.outputs == {}


def test_interrupted_it_gives_nothing(monkeypatch):
    outcome = refine_all(monkeypatch, seen(0.0, 0.0), computing=10, interrupt_after=5)
    assert outcome.status is Status.INVALID
    assert outcome.outputs == {}


def test_no_detections_are_an_empty_scene():
    assert measure_all((), -0.12).measured == ()
