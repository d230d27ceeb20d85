"""A table is cleared on the simulated cell: every fruit ends in the crate, nothing is dropped or bumped into."""

from __future__ import annotations

import pytest

from pomona.executive.execute import RunOrder, execute
from pomona.executive.files import find_cell, find_tree
from pomona.executive.running.events import Event, Published
from pomona.executive.views import TableView

pytestmark = pytest.mark.slow


@pytest.mark.landmark
def test_two_apples_are_put_into_the_crate():
    received: list[Event] = []
    settings = {"others": "1", "distractors": "0", "fruit": "apple_4", "place": "2", "looks": "1"}
    executed = execute(
        RunOrder(find_tree("pick_and_place"), find_cell("sim"), 3, settings), [received.append]
    )
    assert executed.result.outcome == "success", executed.result.reason
    truth = executed.result.truth
    assert truth is not None
    assert truth["put_away"] == 2
    assert truth["lifted"] is None, "it was put down on purpose"
    assert truth["position_error_mm"] < 10.0, "of its place on the table, not in the crate"
    assert truth["drops"] == 0
    assert truth["collided_with"] == []
    tables = [
        event.value
        for event in received
        if isinstance(event, Published) and isinstance(event.value, TableView)
    ]
    assert tables[-1].caption == "2 of 2 fruit put away"


def test_a_fruit_that_cannot_be_lifted_is_left_and_named_and_the_task_ends():
    settings = {
        "distractors": "0",
        "friction": "0.06",
        "tries": "1",
        "looks": "1",
    }  # nothing so slippery can be lifted
    executed = execute(RunOrder(find_tree("pick_and_place"), find_cell("sim"), 0, settings))
    assert executed.result.outcome == "partial"
    assert "DONE_IN_PART" in executed.result.reason.codes()
    tally = executed.summary.facts["tally"]
    assert tally["done"] == 0
    assert [left["outcome"] for left in tally["left"]] == ["left"]
    assert tally["left"][0]["why"]
    assert executed.result.truth is not None
    assert executed.result.truth["put_away"] == 0
