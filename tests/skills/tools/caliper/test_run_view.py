"""Words about the camera after each pick of a run."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import pytest
from recorded_events import started

from pomona.executive.run_views import RunView, ViewedRun
from pomona.executive.running.events import Event, Published, RunEnded, StateChanged
from pomona.executive.terminal.screen import Screen
from pomona.executive.views import TableView
from pomona.tools.caliper.records import note_touches
from pomona.tools.caliper.run_view import NOTED, TouchesView
from tests.skills.tools.caliper.recorded_runs import CELL, picks_of, runs_of, write_run
from tests.skills.tools.caliper.synthetic import recorded

NO_WIDTH = {"type": "PadTouch", "stamp": 1.0, "width": None, "force": 0.5}


class Page(RunView):
    """Another view of the run."""

    def __init__(self) -> None:
        self.seen: list[Event] = []

    def on_event(self, event: Event) -> None:
        self.seen.append(event)


def watch(records: Path, *touches: dict[str, Any], dry: str | None = None) -> Page:
    """Let a view follow a run with the touches of its picks, and return the page beside it."""
    view, page = TouchesView(), Page()
    if view.open(argparse.Namespace(dry=dry), ViewedRun(Screen(width=1000), records, (page,))):
        view.on_event(started(cell_text=CELL, nodes=(), run="now"))
        for i, value in enumerate(touches):
            view.on_event(Published(float(i), i, "pick/SlipAvoidGrasp", "touches", value))
            view.on_event(StateChanged(float(i), i, "running", ""))
        view.on_event(RunEnded(9.0, 450, "success", None, 450, 9.0, 9.0, None))
        view.ended("")
        view.close()
    return page


def noted(root: Path) -> Path:
    """Note the touches of all records, as the view does at the end of each run."""
    from pomona.tools.caliper.records import _read

    for run in root.iterdir():
        note_touches(run, *_read(run)[1:])
    return root


def test_the_terminal_and_the_page_get_the_sentence_after_each_pick(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    page = watch(tmp_path, *picks_of(6e-3, 8))
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 8
    assert "(1 pick)" in lines[0]
    assert "Width of the fruit between the fingers: 80." in lines[0]
    assert "mm to the right of where the cell file has it" in lines[-1]
    assert "(8 picks)" in lines[-1]
    tables = [event.value for event in page.seen if isinstance(event, Published)]
    assert all(isinstance(table, TableView) for table in tables)
    assert [table.rows[0][0] for table in tables] == lines


def test_picks_of_earlier_runs_count_once_they_are_noted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    runs = runs_of(tmp_path / "runs", 6e-3, 6)
    watch(runs, *picks_of(6e-3, 1, seed=3))
    assert "(1 pick)" in capsys.readouterr().out
    noted(runs)
    watch(runs, *picks_of(6e-3, 1, seed=3))
    assert "(7 picks)" in capsys.readouterr().out


def test_a_recovery_before_the_task_has_its_own_picks(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    runs, view = runs_of(tmp_path / "runs", 6e-3, 2), TouchesView()
    before, after = (run.name for run in sorted(runs.iterdir()))
    assert view.open(argparse.Namespace(dry=None), ViewedRun(Screen(width=1000), runs, ()))
    for run, picks in ((before, picks_of(6e-3, 1)), (after, picks_of(6e-3, 2, seed=3))):
        view.on_event(started(cell_text=CELL, nodes=(), run=run))
        for i, value in enumerate(picks):
            view.on_event(Published(float(i), i, "pick/SlipAvoidGrasp", "touches", value))
    view.ended("")
    view.close()
    assert len(capsys.readouterr().out.splitlines()) == 3
    for run, count in ((before, 1), (after, 2)):
        assert len(json.loads((runs / run / NOTED).read_text("utf-8"))["touches"]) == count


def test_an_unusable_touch_gives_the_reason(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    watch(tmp_path, recorded() | {"left": None, "right": None, "closed": NO_WIDTH})
    assert "No word about the camera" in (out := capsys.readouterr().out)
    assert "the gripper reports no width" in out


def test_a_reason_is_given_once_in_a_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    watch(tmp_path, *[recorded(3e-3 + 1e-4 * i) for i in range(4)])
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 2
    assert "(1 pick)" in lines[0]
    assert lines[1].endswith("an earlier touch has moved the fruit since its look.")


def test_touches_are_noted_beside_the_record_at_the_end(tmp_path: Path):
    write_run(tmp_path / "now", *(touches := picks_of(0.0, 2)))
    watch(tmp_path, *touches)
    note = json.loads((tmp_path / "now" / NOTED).read_text())
    assert [value for _, value in note["touches"]] == touches


def test_a_run_without_touches_or_without_a_cell_has_no_words(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    watch(tmp_path)
    watch(tmp_path, recorded(), dry="")
    assert capsys.readouterr().out == ""
