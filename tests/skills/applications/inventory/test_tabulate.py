"""One fruit of a frame is noted."""

from dataclasses import replace

import numpy as np
from py_trees.common import Status

from pomona.applications.inventory.tabulate import Tabulate
from pomona.executive.skill_testing import drive
from pomona.skills.geometry import transform
from pomona.skills.perception.detection.detection import Detection
from tests.skills.picking_scene import apple_at


def measured(number: int, label: str):
    apple = apple_at(number, 3)
    contour = np.array([[10.0, 20.0], [30.0, 40.0]]) * number
    return replace(apple, contour=contour, frame=replace(apple.frame, label=label))


def found(apple, keypoints=np.arange(18.0).reshape(9, 2)) -> Detection:
    T_camera_object = transform(translation=(0.0, 0.0, 0.5))
    return Detection(
        apple.fruit, apple.frame, np.eye(4), T_camera_object, keypoints, 0.91, np.eye(6), 0, 1, 0.8
    )


def note(apple, so_far=None, **inputs):
    outcome = drive(
        Tabulate(), {"detection": found(apple), "measured": apple, "so_far": so_far, **inputs}
    )
    assert outcome.status is Status.SUCCESS
    return outcome.outputs["finds"]


def test_fruit_of_one_frame_are_numbered_and_another_frame_begins_anew():
    first = measured(1, "a")
    second = replace(measured(5, "a"), frame=first.frame)
    finds = note(second, note(first))
    assert [(s.frame, s.number, s.score, s.visibility) for s in finds.sightings] == [
        ("a", 1, 0.91, 0.8),
        ("a", 2, 0.91, 0.8),
    ]
    assert [1e3 * s.dimensions[0] for s in finds.sightings] == [89.0, 62.0]
    assert finds.sightings[1].centre.tolist() == [100.0, 150.0]
    assert finds.sentence == "2 of 2 fruit measured"
    other = note(measured(3, "b"), finds)
    assert [(s.frame, s.number) for s in other.sightings] == [("b", 1)]


def test_a_fruit_that_was_not_measured_is_noted_with_the_reason_and_the_box_of_its_keypoints():
    (sighting,) = note(measured(1, "a"), why="TOO_FEW_INLIERS").sightings
    assert (sighting.dimensions, sighting.why) == (None, "TOO_FEW_INLIERS")
    assert sighting.outline.tolist() == [[0, 1], [14, 1], [14, 15], [0, 15]]
    assert sighting.centre.tolist() == [16.0, 17.0]


def test_a_fruit_without_an_outline_is_noted_all_the_same():
    apple = measured(1, "a")
    nowhere = found(apple, np.full((9, 2), np.nan))
    bare = replace(apple, contour=np.empty((0, 2)))
    finds = drive(Tabulate(), {"detection": nowhere, "measured": bare}).outputs["finds"]
    assert np.isnan(finds.sightings[0].centre).all()
    finds = drive(Tabulate(), {"detection": nowhere}).outputs["finds"]
    assert finds.sightings[0].outline.shape == (0, 2)
