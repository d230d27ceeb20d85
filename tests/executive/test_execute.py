"""Orders: what is set before a run begins."""

from __future__ import annotations

import pytest

from executive.errors import UsageError
from executive.execute import RunOrder, execute
from executive.files import find_cell, find_tree
from executive.running.breakpoints import Side
from executive.running.events import Event, StateChanged
from executive.running.runner import Runner


def order(*breaks: tuple[str, Side]) -> RunOrder:
    return RunOrder(find_tree("pick_apple"), find_cell("sim"), dry=True, breaks=breaks)


def test_a_breakpoint_at_no_node_is_refused_with_what_is_near() -> None:
    with pytest.raises(UsageError, match="no node 'Refin' to break at: did you mean 'Refine'"):
        execute(order(("Refin", "after")))


def test_breakpoints_of_an_order_hold_the_run_from_its_start() -> None:
    runners: list[Runner] = []
    held: list[str] = []

    def resume_when_paused(event: Event) -> None:
        if isinstance(event, StateChanged) and event.state == "pausing":
            held.append(event.because)
        if isinstance(event, StateChanged) and event.state == "paused":
            runners[0].resume("ada")

    executed = execute(order(("Refine", "before"), ("Refine", "after")), [resume_when_paused], on_ready=runners.append)
    assert executed.result.outcome == "success"
    assert [because.split()[1] for because in held] == ["before", "after"]
    assert all(because.endswith("Refine") for because in held)
