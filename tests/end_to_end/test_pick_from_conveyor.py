"""An apple is picked from the running belt by the tree that a user runs, with the shipped detector, and put away."""

from __future__ import annotations

import pytest

from pomona.applications.inventory.tally import Tally
from pomona.executive.execute import RunOrder, execute
from pomona.executive.files import find_cell, find_tree
from pomona.executive.running.events import Event, PortWritten

pytestmark = pytest.mark.slow


@pytest.mark.landmark
def test_an_apple_is_picked_from_the_running_belt_and_put_into_a_crate() -> None:
    settings = {"most": "1", "belt": "0.15 m/s", "fruit": "apple_4"}
    tallies: list[Tally] = []

    def note(event: Event) -> None:
        if isinstance(event, PortWritten) and isinstance(event.value, Tally):
            tallies.append(event.value)

    executed = execute(
        RunOrder(find_tree("pick_from_conveyor"), find_cell("conveyor"), 4, settings), [note]
    )
    assert executed.result.outcome == "success", executed.result.reason
    truth = executed.result.truth
    assert truth is not None
    assert (truth["lifted"], truth["put_away"], truth["drops"], truth["collisions"]) == (1, 1, 0, 0)
    slip = truth["slip_mm"]
    assert isinstance(slip, float)
    assert slip < 1.0
    (entry,) = tallies[-1].entries
    assert entry.outcome == "done"
    assert entry.felt is not None


@pytest.mark.long
def test_a_fruit_of_the_belt_is_put_down_without_a_bruise() -> None:
    settings = {"most": "1", "belt": "0.15 m/s", "fruit": "apple_4"}
    executed = execute(
        RunOrder(find_tree("pick_from_conveyor"), find_cell("conveyor"), 4, settings)
    )
    assert executed.result.outcome == "success"
    truth = executed.result.truth
    assert truth is not None
    assert truth["bruised"] == 0
