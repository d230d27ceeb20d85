"""Fruit that touches, in a crate, is put into the tray by the shipped detector and refinement; none is left."""

from __future__ import annotations

import pytest

from pomona.executive.execute import RunOrder, execute
from pomona.executive.files import find_cell, find_tree
from pomona.executive.running.events import Event, Published
from pomona.executive.views import TableView

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(
    "fruit",
    [pytest.param(1, marks=pytest.mark.landmark), 2, pytest.param(6, marks=pytest.mark.long)],
)
def test_a_crate_is_emptied_into_the_tray(fruit: int) -> None:
    received: list[Event] = []
    settings = {"looks": "1", "others": str(fruit - 1)}
    executed = execute(
        RunOrder(find_tree("empty_crate"), find_cell("sim_crate"), 1, settings), [received.append]
    )
    assert executed.result.outcome == "success", executed.result.reason
    truth = executed.result.truth
    assert truth is not None
    assert truth["put_away"] == fruit
    assert truth["drops"] == 0
    assert truth["collided_with"] == []
    tables = [
        event.value
        for event in received
        if isinstance(event, Published) and isinstance(event.value, TableView)
    ]
    assert tables[-1].caption == f"{fruit} of {fruit} fruit put away"


@pytest.mark.long
def test_a_fruit_that_one_pose_does_not_show_is_found_from_the_next_one() -> None:
    """Its cells block the way up of its neighbours until then: five of eight were put away."""
    executed = execute(
        RunOrder(find_tree("empty_crate"), find_cell("sim_heap"), 4201, {"others": "7"})
    )
    truth = executed.result.truth
    assert truth is not None
    assert truth["put_away"] == 8
