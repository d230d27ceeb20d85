"""Fruit that touches, in a crate, is put into the tray by the shipped detector and refinement; none is left."""

from __future__ import annotations

import pytest

from pomona.executive.execute import RunOrder, execute
from pomona.executive.files import find_cell, find_tree
from pomona.executive.running.events import Event, Published
from pomona.executive.views import TableView

pytestmark = pytest.mark.slow


def test_a_crate_of_six_is_emptied_into_the_tray():
    received: list[Event] = []
    executed = execute(RunOrder(find_tree("empty_crate"), find_cell("sim_crate"), 1, {"looks": "1"}), [received.append])
    assert executed.result.outcome == "success", executed.result.reason
    truth = executed.result.truth
    assert truth is not None
    assert truth["put_away"] == 6
    assert truth["drops"] == 0
    assert truth["collided_with"] == []
    tables = [event.value for event in received if isinstance(event, Published) and isinstance(event.value, TableView)]
    assert tables[-1].caption == "6 of 6 fruit put away"
