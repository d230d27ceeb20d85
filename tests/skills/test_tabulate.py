"""The table of measured fruit, and the pictures with their outlines."""

from dataclasses import replace

import numpy as np
from py_trees.common import Status

from executive.skill_testing import drive
from executive.views import ImageView, TableView
from skills.tabulate import Tabulate
from tests.skills.picking_scene import apple_at


def measured(number: int, label: str):
    apple = apple_at(number, 3)
    contour = np.array([[10.0, 20.0], [30.0, 40.0]]) * number
    return replace(apple, contour=contour, frame=replace(apple.frame, label=label))


def test_every_fruit_gets_a_row_and_its_frames_picture_an_outline():
    skill, last = Tabulate(), None
    for fruit in (measured(1, "a"), measured(5, "a"), measured(3, "b")):
        last = drive(skill, {"measured": fruit})
        assert last.status is Status.SUCCESS
    views = dict(last.published)
    table, picture = views["measured"], views["overlay"]
    assert isinstance(table, TableView)
    assert [row[:6] for row in table.rows] == [
        ("a", "0", "20", "30", "89.0", "81.0"),
        ("a", "1", "100", "150", "62.0", "47.0"),
        ("b", "0", "60", "90", "93.0", "73.0"),
    ]
    assert table.caption == "3 fruit measured"
    assert isinstance(picture, ImageView)
    assert len(picture.lines) == 1
    assert picture.caption == "b: 1 measured"


def test_a_fruit_without_an_outline_is_told_all_the_same():
    outcome = drive(Tabulate(), {"measured": replace(apple_at(1, 3), contour=np.empty((0, 2)))})
    table = dict(outcome.published)["measured"]
    assert table.rows[0][2:4] == ("nan", "nan")
