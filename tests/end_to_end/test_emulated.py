"""The whole job through emulated devices on virtual time: real drivers and bytes, and yet the same each time."""

from __future__ import annotations

import pytest

from pomona.executive.execute import Executed, RunOrder, execute
from pomona.executive.files import find_cell, find_tree
from pomona.executive.running.events import Event

pytestmark = pytest.mark.slow


def pick(seed: int, received: list[Event], cell: str = "emulated") -> Executed:
    order = RunOrder(
        find_tree("pick_apple"), find_cell(cell), seed, {"fruit": "apple_4", "place": "2"}
    )
    return execute(order, [received.append], on_ready=lambda _runner: None)


def story(received: list[Event]) -> list[str]:
    """Return the parts that do not depend on the wall clock."""
    return [
        repr(e)
        for e in received
        if type(e).__name__ in ("NodeChanged", "AttemptEnded", "StateChanged", "LinkChanged")
    ]


@pytest.mark.landmark
def test_an_apple_is_picked_through_emulated_devices_and_the_same_seed_gives_the_same_events() -> (
    None
):
    stories, forces = [], []
    for _ in range(2):
        received: list[Event] = []
        executed = pick(1, received)
        assert executed.result.outcome == "success", executed.result.reason
        truth = executed.result.truth
        assert truth is not None
        assert truth["lifted"] is True
        assert truth["drops"] == 0
        assert truth["position_error_mm"] < 4.0  # type: ignore[operator]
        stories.append(story(received))
        forces.append((truth["peak_force_n"], truth["slip_mm"], truth["height_gained_m"]))
    assert stories[0] == stories[1]
    assert forces[0] == forces[1]  # to the last bit


@pytest.mark.parametrize(
    ("cell", "switch", "kind"),
    [("sim", "arm", "nan"), ("emulated", "arm", "wild"), ("emulated", "arm", "busy")],
)
def test_an_arm_that_lies_in_the_lift_gives_no_success_but_the_safe_state_with_the_fruit_held(
    cell: str, switch: str, kind: str
) -> None:
    runners: list[object] = []

    def spoil(event: Event) -> None:
        if type(event).__name__ == "NodeChanged" and event.path.endswith("Lift"):  # type: ignore[attr-defined]
            runners[0]._cell.switches[switch].inject_fault(kind)  # type: ignore[attr-defined]

    order = RunOrder(
        find_tree("pick_apple"), find_cell(cell), 1, {"fruit": "apple_4", "place": "2"}
    )
    executed = execute(order, [spoil], on_ready=runners.append)
    assert executed.result.outcome == "error"
    assert executed.result.reason is not None
    assert executed.result.reason.message.startswith("arm: ")
    truth = executed.result.truth
    assert truth is not None
    assert truth["drops"] == 0
