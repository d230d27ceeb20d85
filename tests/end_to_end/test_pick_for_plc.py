"""A simulated PLC orders fruit on the simulated cell: crates are changed, and a fault stops the arm until the reset."""

from __future__ import annotations

import pytest

from pomona.executive.execute import RunOrder, execute
from pomona.executive.files import find_cell, find_tree
from pomona.executive.running.events import Event, NodeChanged
from pomona.executive.running.runner import Runner

pytestmark = pytest.mark.slow

USUAL = {"distractors": "0", "fruit": "apple_4", "place": "2", "others": "1", "orders": "2"}


def run(**settings: str) -> tuple[object, list[tuple[float, str]]]:
    """The run, and the successes of its nodes: time and name."""
    received: list[Event] = []
    executed = execute(
        RunOrder(find_tree("pick_for_plc"), find_cell("sim_plc"), 3, {**USUAL, **settings}),
        [received.append],
    )
    ended = [event for event in received if isinstance(event, NodeChanged)]
    return executed, [
        (event.t, event.path.rpartition("/")[2]) for event in ended if event.status == "SUCCESS"
    ]


def test_each_order_puts_one_fruit_into_the_crate_and_a_full_crate_is_changed():
    executed, nodes = run(full="1", first="2")
    assert executed.result.outcome == "success", executed.result.reason
    truth = executed.result.truth
    assert (truth["put_away"], truth["drops"]) == (2, 0)
    assert [name for _, name in nodes if name in ("Done", "Handshake")] == [
        "Done",
        "Handshake",
        "Done",
    ]


def test_a_fault_while_a_fruit_is_carried_stops_the_arm_and_after_the_reset_it_is_put_into_the_crate():
    executed, nodes = run(fault="7 s..8 s", reset="10 s..11 s", orders="1")
    assert executed.result.outcome == "success", executed.result.reason
    truth = executed.result.truth
    assert (truth["put_away"], truth["drops"]) == (2, 0), (
        "the carried one, and that of the next order"
    )
    names = [name for _, name in nodes]
    assert names.index("Wait for the reset") < names.index("Home") < names.index("Done")
    between = [name for at, name in nodes if 7.1 < at < 10.0]
    assert between == ["Wait for the repair"]


def test_an_order_that_stands_before_the_run_begins_starts_nothing() -> None:
    path = find_cell("sim_plc")
    text = path.read_text("utf-8")
    order = "start: {follows: ready, delay: 500 ms}"
    assert order in text
    texts = {str(path): text.replace(order, "start: {during: 0 s..1000 h}")}
    settings = {**USUAL, "others": "0", "orders": "1", "patience": "500 ms"}
    runners: list[Runner] = []
    moving: list[str] = []

    def stop_the_first_motion(event: Event) -> None:
        if isinstance(event, NodeChanged) and event.path.endswith("/Move to look"):
            moving.append(event.status)
            runners[0].safe_stop("the test has seen enough")

    run_order = RunOrder(find_tree("pick_for_plc"), path, 3, settings, texts=texts)
    execute(run_order, [stop_the_first_motion], on_ready=runners.append)
    assert moving == []
