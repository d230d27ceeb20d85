"""The table of measured fruit, and the pictures with their outlines."""

from dataclasses import replace

import numpy as np
from py_trees.common import Status

from executive.skill_testing import drive
from executive.views import ImageView, TableView
from skills.perception.detection.detection import Detection
from skills.tabulate import Tabulate
from tests.skills.picking_scene import apple_at


def measured(number: int, label: str):
    apple = apple_at(number, 3)
    contour = np.array([[10.0, 20.0], [30.0, 40.0]]) * number
    return replace(apple, contour=contour, frame=replace(apple.frame, label=label))


def found(apple, keypoints=np.arange(18.0).reshape(9, 2)) -> Detection:
    return Detection(apple.fruit, apple.frame, np.eye(4), np.eye(4), keypoints, 0.91, np.eye(6), 0, 1)


def test_every_fruit_gets_a_row_and_its_frames_picture_an_outline():
    skill, last = Tabulate(), None
    for fruit in (measured(1, "a"), measured(5, "a"), measured(3, "b")):
        last = drive(skill, {"detection": found(fruit), "measured": fruit})
        assert last.status is Status.SUCCESS
    views = dict(last.published)
    table, picture = views["measured"], views["overlay"]
    assert isinstance(table, TableView)
    assert [row[:7] for row in table.rows] == [
        ("a", "1", "20", "30", "0.91", "89.0", "81.0"),
        ("a", "2", "100", "150", "0.91", "62.0", "47.0"),
        ("b", "1", "60", "90", "0.91", "93.0", "73.0"),
    ]
    assert table.caption == "3 of 3 fruit measured"
    sizes = views["sizes"]
    assert sizes.columns == (
        *("frame", "found", "measured"),
        *(f"{low}-{low + 5} mm" for low in range(60, 95, 5)),
    )
    assert sizes.rows == (
        ("a", "2", "2", "1", "0", "0", "0", "0", "1", "0"),
        ("b", "1", "1", "0", "0", "0", "0", "0", "0", "1"),
        ("all", "3", "3", "1", "0", "0", "0", "0", "1", "1"),
    )
    assert isinstance(picture, ImageView)
    assert [line.label for line in picture.lines] == ["1"]
    assert picture.caption == "b: 1 found"


def test_a_fruit_that_was_not_measured_keeps_its_row_with_the_reason():
    skill, fruit = Tabulate(), measured(1, "a")
    drive(skill, {"detection": found(fruit), "measured": fruit})
    views = dict(
        drive(skill, {"detection": found(fruit), "measured": fruit, "why": "12 % of the depth agrees"}).published
    )
    table, picture = views["measured"], views["overlay"]
    assert table.caption == "1 of 2 fruit measured"
    assert table.rows[1] == ("a", "2", "16", "17", "0.91", "", "", "", "", "", "12 % of the depth agrees")
    assert all(len(row) == len(table.columns) for row in table.rows)
    assert [(line.label, line.style) for line in picture.lines] == [("1", "refined"), ("2", "muted")]
    assert picture.lines[1].points.tolist() == [[0, 1], [14, 1], [14, 15], [0, 15]]


def test_a_fruit_without_an_outline_is_told_all_the_same():
    fruit = measured(1, "a")
    nowhere = found(fruit, np.full((9, 2), np.nan))
    outcome = drive(Tabulate(), {"detection": nowhere, "measured": replace(fruit, contour=np.empty((0, 2)))})
    table = dict(outcome.published)["measured"]
    assert table.rows[0][2:4] == ("nan", "nan")
    views = dict(drive(Tabulate(), {"detection": nowhere}).published)
    assert views["measured"].rows[0][2:4] == ("nan", "nan")
    assert views["sizes"].rows == (("a", "1", "0"), ("all", "1", "0"))
