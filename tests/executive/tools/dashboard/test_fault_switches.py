"""The holder of control can inject faults into a simulated cell; a real cell has none."""

from __future__ import annotations

from typing import Any

import pytest
from fake_cell import FakeCell
from fake_runs import Turn, make

from pomona.executive.cell.device import FaultSwitch
from pomona.executive.registry import Registry
from pomona.executive.running.events import OperatorActed
from pomona.executive.running.requests import UnknownFaultError
from pomona.tools.dashboard.control_lock import ControlLock, RefusedError

TREE = "pomona: 1\ntree: t\nroot: {Turn: {duration: 9 s}}"


class Switch(FaultSwitch):
    """The wheel's bearing."""

    known_faults = ("hot", "loose")

    def __init__(self, cell: FakeCell) -> None:
        super().__init__()
        self.cell, self.told = cell, [""]

    def inject_fault(self, kind: str) -> None:
        self.told.append(kind)
        self.cell.wheel.trouble = RuntimeError(f"wheel: the bearing is {kind}")

    def clear_fault(self) -> None:
        self.told.append("")
        self.cell.wheel.trouble = None


def run(acts: dict[int, Any]) -> tuple[Any, FakeCell, list[Any]]:
    runner, cell, events = make(TREE, Registry({"Turn": Turn}), acts)
    cell.faults["wheel"] = Switch(cell)
    return runner.run(), cell, events


def test_a_fault_that_somebody_makes_ends_the_run_as_a_real_one_would_and_stands_in_the_record() -> (
    None
):
    result, cell, events = run({5: lambda runner, _cell: runner.fail("wheel", "hot", "ada")})
    assert result.outcome == "error"
    assert result.reason.message == "wheel: the bearing is hot"
    assert cell.switches["wheel"].told == ["", "hot"]
    assert [(e.who, e.action, e.detail) for e in events if isinstance(e, OperatorActed)] == [
        ("ada", "fail", "wheel hot")
    ]


def test_only_faults_that_the_cell_has_are_made() -> None:
    def wrong(runner: Any, _cell: FakeCell) -> None:
        for switch, kind in (("wheel", "cold"), ("axle", "hot"), ("axle", "")):
            with pytest.raises(UnknownFaultError):
                runner.fail(switch, kind)
        runner.stop()

    result, cell, _events = run({5: wrong})
    assert result.outcome == "stopped"
    assert cell.switches["wheel"].told == [""]


def test_the_page_needs_control_for_it_and_gets_the_choices() -> None:
    lock = ControlLock()
    seen: list[Any] = []

    def act(runner: Any, _cell: FakeCell) -> None:
        lock.serve(runner)
        seen.append(lock.known_faults)
        with pytest.raises(RefusedError, match="take it first"):
            lock.act("page", "fail", "wheel hot")
        lock.take("page", "ada")
        with pytest.raises(RefusedError, match="no fault 'wheel cold'"):
            lock.act("page", "fail", "wheel cold")
        lock.act("page", "fail", "wheel loose")

    result, _cell, _events = run({5: act})
    assert result.reason.message == "wheel: the bearing is loose"
    assert seen == [{"wheel": ("hot", "loose")}]
    assert lock.known_faults == {}
