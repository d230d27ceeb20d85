"""In a small terminal the running node is in sight."""

from __future__ import annotations

import contextlib
import io
from typing import Any

import pytest
from rich.console import Console

from pomona.executive.reasons import Reason
from pomona.executive.running.events import NodeChanged, RunStarted, TickOverran
from pomona.executive.terminal.live import LiveTree
from pomona.executive.terminal.output import visible
from pomona.executive.terminal.screen import Screen

NODES = (
    {"path": "t", "parent": None, "name": "whole"},
    *(
        {"path": f"t/{n}", "parent": "t", "name": f"a node with quite a long name {n}"}
        for n in range(60)
    ),
)


def shown(running: int, width: int = 80, height: int = 24, odd: str = "") -> list[str]:
    """Return the terminal's contents while this leaf runs; `odd` stands in every name and in the feedback."""
    nodes = tuple(node | {"name": f"{node['name']}{odd}"} for node in NODES)
    live = LiveTree(Screen(quiet=True))
    live.on_event(
        RunStarted(
            0.0,
            0,
            "r",
            f"t{odd}",
            "t.yaml",
            "",
            "",
            "sim",
            "simulated",
            "",
            "",
            0,
            {},
            nodes,
            {},
            0.0,
            0.02,
        )
    )
    for number in range(running):
        live.on_event(NodeChanged(0.0, number, f"t/{number}", "SUCCESS", "", 1))
    live.on_event(
        NodeChanged(1.0, running, f"t/{running}", "RUNNING", f"on {odd} the way " * 20, 1)
    )
    live._console = Screen()
    live._console.size = (width, height)  # type: ignore[assignment]
    text = live._text()
    terminal = Console(
        file=io.StringIO(), width=width, height=height, force_terminal=True, color_system=None
    )
    return [line.plain for line in text.wrap(terminal, width)]


@pytest.mark.parametrize("running", [0, 5, 30, 58, 59])
def test_the_running_node_is_in_sight_in_80_by_24(running: int) -> None:
    lines = shown(running)
    assert len(lines) <= 23
    assert all(len(line) <= 80 for line in lines)
    assert any(f"▶ a node with quite a long name {running}" in line for line in lines)
    assert lines[0].startswith("t on sim")


def test_left_out_items_are_counted() -> None:
    lines = shown(30)
    above = next(int(line.split()[1]) for line in lines if line.endswith("above"))
    below = next(int(line.split()[1]) for line in lines if line.endswith("below"))
    inside = sum("name" in line or "whole" in line for line in lines)
    assert above + inside + below == len(NODES)


def test_a_tree_that_fits_is_shown_whole() -> None:
    assert len(shown(30, height=80)) == len(NODES) + 1


@pytest.mark.parametrize(
    "odd", ["\nsecond\n\nfourth", "\r\u202e\u200b\x1b[2J" * 9, "\t\u2028\x85\x0b🍎"]
)
@pytest.mark.parametrize(("width", "height"), [(80, 24), (40, 10)])
def test_names_and_feedback_take_one_line_each_whatever_they_hold(
    odd: str, width: int, height: int
) -> None:
    lines = shown(30, width, height, odd)
    assert len(lines) <= height - 1
    assert all(len(visible(line)) <= width for line in lines)
    assert any("▶ a node with quite" in line for line in lines)


def test_preparation_is_shown_until_the_run_begins() -> None:
    screen: Any = Console(
        file=io.StringIO(), width=40, height=10, force_terminal=True, color_system=None
    )
    with contextlib.closing(LiveTree(screen)) as live:
        starting = live.starting()
        starting.reach("connecting the cell")
        starting.reach("preparing SlipAvoidGrasp and all that it needs", 2, 9)
        drawn = screen.file.getvalue()
        starting.begin()
        assert screen.file.getvalue() == drawn
    assert "◌ connecting the cell …" in drawn
    assert "◌ preparing SlipAvoidGrasp and all that…" in drawn


def test_where_nothing_is_drawn_only_a_long_preparation_is_reported(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    screen: Any = Console(file=io.StringIO())
    starting = LiveTree(screen).starting()
    starting.reach("preparing Detect", 2, 9)
    assert screen.file.getvalue() == ""
    monkeypatch.setattr("pomona.executive.terminal.live.PATIENCE", -1.0)
    starting.reach("preparing Refine", 3, 9)
    assert screen.file.getvalue() == "preparing Refine, 4 of 9 …\n"


def test_a_skill_that_kept_the_tick_waiting_is_reported_while_it_runs(
    capsys: pytest.CaptureFixture[str],
) -> None:
    live = LiveTree(Screen(width=120))
    start = RunStarted(
        0.0, 0, "r", "t", "t.yaml", "", "", "lab", "real", "", "", 0, {}, NODES, {}, 0.0, 0.02
    )
    live.on_event(start)
    live.on_event(TickOverran(0.02, 1, "t/3", 2.0))
    live.on_event(TickOverran(0.04, 2, "t/4", 0.03))
    live.on_event(TickOverran(0.06, 3, "t/3", 2.0, 1.9))
    live.on_event(TickOverran(0.08, 4, "t/3", 2.0, 0.1))
    out = " ".join(capsys.readouterr().out.split())
    told = "a node with quite a long name 3 kept the tick waiting for 2.0 s: no limit could interrupt it"
    busy = "(it computed for 0.1 s; the rest it waited, or the computer was busy)"
    assert out == f"0.02 s ! {told} 0.06 s ! {told} 0.08 s ! {told} {busy}"


def test_on_a_simulated_cell_only_work_that_belongs_beside_the_tick_is_reported(
    capsys: pytest.CaptureFixture[str],
) -> None:
    live = LiveTree(Screen(width=120))
    live.on_event(
        RunStarted(
            0.0,
            0,
            "r",
            "t",
            "t.yaml",
            "",
            "",
            "sim",
            "simulated",
            "",
            "",
            0,
            {},
            NODES,
            {},
            0.0,
            0.02,
        )
    )
    live.on_event(TickOverran(0.02, 1, "t/3", 2.0, 0.1))
    assert capsys.readouterr().out == "", "the world stood still while the tick waited"
    live.on_event(TickOverran(0.04, 2, "t/3", 2.0, 1.9))
    assert "kept the tick waiting for 2.0 s" in " ".join(capsys.readouterr().out.split())


def test_a_condition_that_does_not_hold_has_no_cross(capsys: pytest.CaptureFixture[str]) -> None:
    live = LiveTree(Screen())
    live._live = None
    nodes = (
        {"path": "t", "parent": None, "name": "whole"},
        {"path": "t/c", "parent": "t", "name": "check"},
    )
    live.on_event(
        RunStarted(
            0.0,
            0,
            "r",
            "t",
            "t.yaml",
            "",
            "",
            "sim",
            "simulated",
            "",
            "",
            0,
            {},
            nodes,
            {},
            0.0,
            0.02,
        )
    )
    for code in ("CONDITION_FALSE", "NO_PATH"):
        live.on_event(NodeChanged(0.0, 1, "t/c", "FAILURE", "", 1, Reason("t/c", code, "so it is")))
    decided, failed = (line for line in capsys.readouterr().out.splitlines() if "so it is" in line)
    assert "· check" in decided
    assert "✗ check" in failed
