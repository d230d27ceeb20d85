"""The outcome for every fruit: one entry a fruit, for any number of tries; those that are left are named."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from py_trees.common import Status

from pomona.applications.inventory.keep_tally import KeepTally
from pomona.applications.inventory.tally import Tally
from pomona.drivers.interfaces import Frame
from pomona.executive.skill_testing import drive
from pomona.executive.views import TableView
from pomona.skills.geometry import transform
from pomona.skills.grip.closing import PadTouch, TouchRecorder
from pomona.skills.grip.hold import Hold
from pomona.skills.perception.detection.detection import Detection
from tests.skills.picking_scene import apple_at


def seen(x: float, y: float, frame: Frame | None = None) -> Detection:
    apple = apple_at(1, 3)
    look = frame or apple.frame
    return Detection(
        apple.fruit, look, np.eye(4), transform(None, [x, y, -0.08]), np.zeros((9, 2)), 0.9, np.eye(6), 0, 1
    )  # fmt: skip


def keep(detection: Detection, so_far: Tally | None = None, **inputs: Any):
    return drive(KeepTally(), {"detection": detection, "so_far": so_far, **inputs})


def test_fruit_are_listed_with_size_and_place_and_those_left_by_name():
    apple = apple_at(5, 1)
    first = keep(seen(-0.12, -0.35, apple.frame), measured=apple)
    second = keep(
        seen(0.1, -0.5), first.outputs["tally"], outcome="left", why="too wide for the gripper"
    )
    assert second.status is Status.SUCCESS
    tally, table = second.outputs["tally"], dict(second.published)["tally"]
    assert (
        tally.sentence == "1 of 2 fruit put away; left at (100, -500) mm: too wide for the gripper"
    )
    assert tally.facts["done"] == 1
    assert [left["tries"] for left in tally.facts["left"]] == [1]
    assert isinstance(table, TableView)
    assert table.rows == (
        ("1", "(-120, -350) mm", "62 × 47 × 62 mm", "", "1", "done", ""),
        ("2", "(100, -500) mm", "not measured", "", "1", "left", "too wide for the gripper"),
    )


def gripped(*widths: float | None) -> Hold:
    """A grip whose pads first touched at these openings [m]."""
    hold = object.__new__(Hold)
    hold._touches = TouchRecorder(2000.0)
    hold._touches.touches = [
        None if width is None else PadTouch(1.0, width, 0.5) for width in widths
    ]
    return hold


def test_a_fruit_that_was_put_away_has_the_width_that_the_pads_felt():
    apple = apple_at(5, 1)
    detection = seen(-0.12, -0.35, apple.frame)
    kept = keep(detection, measured=apple, hold=gripped(0.0663, 0.0612)).outputs["tally"]
    assert kept.facts["felt_m"] == [0.0612]
    assert (
        dict(keep(detection, measured=apple, hold=gripped(0.0663, 0.0612)).published)["tally"].rows[
            0
        ][3]
        == "61.2 mm"
    )


@pytest.mark.parametrize(("widths", "outcome"), [((0.066, None), "done"), ((0.066, 0.061), "left")])
def test_one_pad_alone_and_a_grip_that_came_to_nothing_show_no_width(
    widths: tuple[float | None, ...], outcome: str
):
    kept = keep(seen(0.1, -0.5), hold=gripped(*widths), outcome=outcome).outputs["tally"]
    assert kept.facts["felt_m"] == [None]


def test_fruit_that_still_lie_on_the_table_count_as_well():
    five = replace(seen(0.1, -0.5), found=5)
    tally = keep(five).outputs["tally"]
    assert tally.sentence == "1 of 5 fruit put away"
    tally = keep(replace(seen(-0.1, -0.4), found=4), tally, outcome="left", why="slipped").outputs[
        "tally"
    ]
    assert tally.sentence.startswith("1 of 5 fruit put away; left at")


def test_another_try_of_a_fruit_that_was_left_is_the_same_fruit():
    tally = keep(seen(0.1, -0.5), outcome="left", why="slipped").outputs["tally"]
    tally = keep(seen(0.12, -0.49), tally).outputs["tally"]
    assert [(entry.outcome, entry.tries) for entry in tally.entries] == [("done", 2)]


def test_a_fruit_where_one_was_put_away_before_is_another_one():
    tally = keep(seen(0.1, -0.5)).outputs["tally"]
    tally = keep(seen(0.1, -0.5), tally, outcome="left").outputs["tally"]
    assert [entry.outcome for entry in tally.entries] == ["done", "left"]


def test_a_measurement_from_another_look_is_not_this_fruits():
    entry = keep(seen(0.1, -0.5), measured=apple_at(5, 1)).outputs["tally"].entries[0]
    assert entry.size is None
    assert entry.p_base == pytest.approx([0.1, -0.5, -0.08])


def test_fruit_that_moves_is_known_by_its_number_not_by_its_place():
    apple = apple_at(5, 1)
    passed = {"measured": apple, "outcome": "passed", "why": "out of reach"}
    first = drive(KeepTally(), {**passed, "number": 1})
    second = drive(KeepTally(), {**passed, "number": 2, "so_far": first.outputs["tally"]})
    again = drive(KeepTally(), {**passed, "number": 2, "so_far": second.outputs["tally"]}).outputs[
        "tally"
    ]
    assert [entry.tries for entry in again.entries] == [1, 2]
    assert again.sentence.startswith(
        "0 of 2 fruit put away; passed at (-120, -350) mm: out of reach; "
    )


def test_fruit_that_was_not_seen_is_listed_without_a_place():
    first = drive(KeepTally(), {"outcome": "left", "why": "lost"}).outputs["tally"]
    second = drive(KeepTally(), {"outcome": "left", "why": "lost", "so_far": first}).outputs[
        "tally"
    ]
    assert (
        second.sentence
        == "0 of 2 fruit put away; left at an unknown place: lost; left at an unknown place: lost"
    )
