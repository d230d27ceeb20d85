"""The next run knows that the last one on its cell was cut off, and the state of the gripper."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import threading
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from recorded_events import started

from pomona.executive.cli import main
from pomona.executive.errors import UsageError
from pomona.executive.execute import RunOrder, execute
from pomona.executive.recording.folder import ENDING_FILE, EVENTS_FILE, find_record
from pomona.executive.recording.recorder import Recorder
from pomona.executive.recording.session import RecordingSession, unfinished
from pomona.executive.running.events import HandChanged, NodeChanged, RunEnded
from pomona.executive.running.starting import StartCancelledError
from pomona.executive.running.supervise import REPORT
from pomona.tools.dashboard.choices import Choices
from pomona.tools.dashboard.command_dashboard import Launcher
from pomona.tools.dashboard.control_lock import ControlLock, RefusedError

CELL = "name: bench\nkind: mock\nclock: manual\ndevices: {}\n"
TREE = "pomona: 1\ntree: t\nroot: {wait: 20 ms}\n"
NODES = (
    {"path": "t", "parent": None, "name": "t", "type": "sequence"},
    {"path": "t/Lift", "parent": "t", "name": "Lift", "type": "Lift"},
)


@pytest.fixture
def order(tmp_path: Path) -> RunOrder:
    (tmp_path / "cell.yaml").write_text(CELL)
    (tmp_path / "tree.yaml").write_text(TREE)
    return RunOrder(tmp_path / "tree.yaml", tmp_path / "cell.yaml", record=tmp_path / "runs")


def leave(
    order: RunOrder,
    kind: str,
    hand: str | None,
    ended: bool = False,
    name: str = "2026-01-01_t",
    tree: str = "t",
    outcome: str = "success",
) -> None:
    """A record on this cell, in which Lift was running."""
    assert order.record is not None
    folder = order.record / name
    folder.mkdir(parents=True)
    recorder = Recorder(folder)
    recorder.on_event(
        replace(
            started(), cell_kind=kind, cell_path=str(order.cell.resolve()), nodes=NODES, tree=tree
        )
    )
    recorder.on_event(NodeChanged(0.1, 5, "t/Lift", "RUNNING", "", 1))
    if hand is not None:
        recorder.on_event(HandChanged(0.2, 10, hand))
    if ended:
        recorder.on_event(RunEnded(0.4, 20, outcome, None, 20, 0.4, 0.4, None))
    recorder.close()
    written = datetime.fromisoformat(name.partition("_")[0]).timestamp()
    os.utime(folder / EVENTS_FILE, (written, written))


HELD = "something is between the fingers"


def test_a_run_that_came_to_an_end_is_not_unfinished(order: RunOrder) -> None:
    leave(order, "real", HELD, ended=True)
    assert order.record is not None
    assert unfinished(order.record, order.cell) is None


def test_a_cut_run_reports_its_activity_and_the_possible_content_of_the_gripper(
    order: RunOrder,
) -> None:
    leave(order, "real", HELD)
    assert order.record is not None
    cut = unfinished(order.record, order.cell)
    assert cut is not None
    assert (cut.kind, cut.doing, cut.hand) == ("real", ("Lift",), HELD)
    assert "while Lift was running" in cut.sentence
    assert HELD in cut.sentence


def test_actions_of_the_supervisor_are_reported_with_a_cut_run_and_by_explain(
    order: RunOrder, capsys: pytest.CaptureFixture[str]
) -> None:
    leave(order, "real", HELD)
    assert order.record is not None
    (record,) = order.record.iterdir()
    report = {
        "reason": "the run's process did not answer for 1 s",
        "devices": {"arm": "stopped", "gripper": "stopped"},
    }
    (record / REPORT).write_text(json.dumps(report))
    told = "its supervisor reported that the run's process did not answer for 1 s: arm stopped, gripper stopped"
    cut = unfinished(order.record, order.cell)
    assert cut is not None
    assert told in cut.sentence
    assert main(["explain", str(record)]) == 0
    assert told in " ".join(capsys.readouterr().out.split())
    (record / REPORT).write_text("[1, 2")
    cut = unfinished(order.record, order.cell)
    assert cut is not None
    assert "supervisor" not in cut.sentence


def test_only_the_newest_run_on_this_cell_counts(order: RunOrder, tmp_path: Path) -> None:
    leave(order, "real", HELD)
    leave(order, "real", HELD, ended=True, name="2026-01-02_t")
    assert order.record is not None
    assert unfinished(order.record, order.cell) is None
    other = tmp_path / "other.yaml"
    other.write_text(CELL)
    leave(replace(order, cell=other), "real", HELD, name="2026-01-03_t")
    assert unfinished(order.record, order.cell) is None
    assert unfinished(order.record, other) is not None


def test_a_run_that_was_cut_after_the_clock_was_set_back_is_the_newest_all_the_same(
    order: RunOrder,
) -> None:
    leave(order, "real", "", ended=True, name="2026-11-22_t")
    leave(order, "real", HELD, name="2026-11-21_t")
    assert order.record is not None
    cut = unfinished(order.record, order.cell)
    assert cut is not None
    assert cut.record.name == "2026-11-21_t"
    assert find_record("last", order.record).name == "2026-11-21_t"
    os.utime(order.record / "2026-11-22_t" / EVENTS_FILE)  # as a repair of an old record does
    assert unfinished(order.record, order.cell) is not None


@pytest.mark.parametrize("damage", ["missing", "no JSON", "a number that no recorder writes"])
def test_a_record_without_a_number_stands_where_its_time_puts_it(
    order: RunOrder, damage: str
) -> None:
    leave(order, "real", "", ended=True, name="2026-11-20_t")
    leave(order, "real", HELD, name="2026-11-21_t")
    leave(order, "real", "", ended=True, name="2026-11-22_t")
    assert order.record is not None
    said = {"no JSON": "[1,", "a number that no recorder writes": f'{{"number": {10**40}}}'}
    for name in ("2026-11-21_t", "2026-11-22_t"):
        ending = order.record / name / ENDING_FILE
        ending.write_text(said.get(damage, ""))
        if damage == "missing":
            ending.unlink()
        assert unfinished(order.record, order.cell) is None
    os.utime(order.record / "2026-11-21_t" / EVENTS_FILE)
    assert unfinished(order.record, order.cell) is not None


@pytest.mark.parametrize("damage", ["a flipped bit", "the tail is zero", "empty", "all zero"])
def test_an_untrusted_newest_record_makes_no_gripper_count_as_empty(
    order: RunOrder, damage: str
) -> None:
    order.cell.write_text(CELL.replace("kind: mock", "kind: real"))
    leave(order, "real", "", ended=True)
    leave(order, "real", HELD, name="2026-01-02_t")
    assert order.record is not None
    path = order.record / "2026-01-02_t" / EVENTS_FILE
    said = bytearray(path.read_bytes())
    if damage == "a flipped bit":
        said[len(said) // 2] ^= 4
    elif damage == "the tail is zero":
        said[-len(said) // 3 :] = bytes(len(said[-len(said) // 3 :]))
    path.write_bytes(
        b"" if damage == "empty" else bytes(len(said)) if damage == "all zero" else said
    )
    cut = unfinished(order.record, order.cell)
    assert cut is not None
    assert cut.hand is None or cut.hand == HELD
    with pytest.raises(UsageError, match="--cleared"):
        execute(order)
    assert execute(replace(order, cleared=True)).result.outcome == "success"
    assert unfinished(order.record, order.cell) is None


def test_a_pipe_among_the_records_is_not_waited_for(order: RunOrder) -> None:
    assert order.record is not None
    (order.record / "2026-01-01_t").mkdir(parents=True)
    os.mkfifo(order.record / "2026-01-01_t" / EVENTS_FILE)
    cut = unfinished(order.record, order.cell)
    assert cut is not None
    assert cut.why == "its record cannot be read"


def test_on_a_simulated_cell_an_unreadable_record_is_only_reported(
    order: RunOrder, caplog: pytest.LogCaptureFixture
) -> None:
    leave(order, "mock", HELD)
    assert order.record is not None
    (order.record / "2026-01-01_t" / EVENTS_FILE).write_bytes(b"")
    assert execute(order).result.outcome == "success"
    assert "its record cannot be read" in caplog.text


@pytest.mark.parametrize(("kind", "hand"), [("real", HELD), ("real", None), ("emulated", HELD)])
def test_a_real_cell_that_may_hold_something_is_refused_with_the_remedy(
    order: RunOrder, kind: str, hand: str | None
) -> None:
    leave(order, kind, hand)
    with pytest.raises(
        UsageError, match=r"was cut after 0\.\d s while Lift was running"
    ) as refused:
        execute(order)
    assert "--recover" in str(refused.value)
    assert "--cleared" in str(refused.value)


@pytest.mark.parametrize(("kind", "hand"), [("real", ""), ("simulated", HELD), ("mock", None)])
def test_an_empty_gripper_and_a_simulated_cell_are_only_reported(
    order: RunOrder, kind: str, hand: str | None, caplog: pytest.LogCaptureFixture
) -> None:
    leave(order, kind, hand)
    assert execute(order).result.outcome == "success"
    assert "was cut after" in caplog.text
    caplog.clear()
    assert execute(order).result.outcome == "success"
    assert caplog.text == ""  # told once: the newest run has come to an end


def test_a_run_does_not_begin_with_something_between_the_fingers_however_the_last_one_ended(
    order: RunOrder, monkeypatch: pytest.MonkeyPatch
) -> None:
    leave(order, "real", "", ended=True)
    monkeypatch.setattr("pomona.executive.cell.cell.Cell.in_hand", lambda _cell: HELD)
    with pytest.raises(UsageError, match=rf"bench: {HELD} before the run has begun") as refused:
        execute(order)
    assert "--recover" in str(refused.value)
    assert order.record is not None
    assert len(list(order.record.iterdir())) == 1
    assert execute(replace(order, cleared=True)).result.outcome == "success"


def test_a_cell_that_requires_a_record_starts_no_run_without_one(order: RunOrder) -> None:
    order.cell.write_text(CELL + "record: required\n")
    with pytest.raises(
        UsageError,
        match=r"bench: its file has `record: required`, but this run would not be recorded",
    ):
        execute(replace(order, record=None))
    assert execute(order).result.outcome == "success"


def test_recovery_that_is_asked_for_runs_even_when_no_run_was_cut(
    order: RunOrder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pomona.executive.execute.installed_trees", lambda: tmp_path)
    (tmp_path / "recover.yaml").write_text(TREE.replace("tree: t", "tree: recover"))
    assert execute(replace(order, recover=True)).result.outcome == "success"
    assert order.record is not None
    assert sum("_recover" in path.name for path in order.record.iterdir()) == 1


@pytest.mark.parametrize("also", [{"record": None}, {"cleared": True}])
def test_recovery_that_is_asked_for_runs_whatever_else_is_said(
    order: RunOrder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, also: dict[str, Any]
) -> None:
    monkeypatch.setattr("pomona.executive.execute.installed_trees", lambda: tmp_path)
    (tmp_path / "recover.yaml").write_text(TREE.replace("tree: t", "tree: recover"))
    begun: list[str] = []
    execute(
        replace(order, recover=True, **also), on_ready=lambda runner: begun.append(runner.tree.name)
    )
    assert begun == ["recover", "t"]


def test_a_run_without_a_record_is_refused_after_a_cut_one_like_any_other(order: RunOrder) -> None:
    leave(order, "real", HELD)
    with pytest.raises(UsageError, match="while Lift was running"):
        execute(replace(order, record=None, past=order.record))


def test_a_cell_that_somebody_has_looked_after_goes_on(order: RunOrder) -> None:
    leave(order, "real", HELD)
    assert execute(replace(order, cleared=True)).result.outcome == "success"


def test_recovery_runs_before_anything_else_and_nothing_runs_when_it_fails(
    order: RunOrder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recover = tmp_path / "recover.yaml"
    monkeypatch.setattr("pomona.executive.execute.installed_trees", lambda: tmp_path)
    recover.write_text("pomona: 1\ntree: recover\nroot: {fail: {code: STUCK}}\n")
    leave(order, "real", HELD)
    assert order.record is not None
    with pytest.raises(UsageError, match=r"recover failed: .*STUCK"):
        execute(replace(order, recover=True))
    leave(order, "real", HELD, name="2099-01-01_t")
    recover.write_text("pomona: 1\ntree: recover\nparameters: {release: {type: bool, default: false}}\n"
                       "root: {check: '{release}'}\n")  # fmt: skip
    executed = execute(replace(order, recover=True, settings={"release": "true"}))
    assert executed.result.outcome == "success"
    names = sorted(path.name.split("_", 2)[-1] for path in order.record.iterdir())
    assert sum(name.startswith("recover") for name in names) == 2
    assert (
        unfinished(order.record, order.cell) is None
    )  # which came last is no question of the clock


def test_the_page_begins_after_a_cut_as_its_form_says(
    order: RunOrder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pomona.executive.execute.installed_trees", lambda: tmp_path)
    (tmp_path / "recover.yaml").write_text(TREE.replace("tree: t", "tree: recover"))
    leave(order, "real", HELD)
    assert order.record is not None
    dashboard: Any = SimpleNamespace(control=ControlLock(), on_event=lambda event: None)
    launcher = Launcher(
        dashboard, order.record, Choices({"tree": order.tree}, {"cell": order.cell})
    )

    def start(after_cut: str) -> tuple[str, list[str]]:
        before = {path.name for path in order.record.iterdir()} if order.record else set()
        launcher.start({"tree": "tree", "cell": "cell", "pace": "fast", "after_cut": after_cut})
        assert launcher._thread is not None
        launcher._thread.join()
        problem = (dashboard.control.start or {}).get("problem", "")
        new = {path.name for path in order.record.iterdir()} - before if order.record else set()
        return problem, sorted("recover" if "_recover" in name else "t" for name in new)

    problem, run = start("")
    assert run == []
    assert "was cut after" in problem
    assert HELD in problem
    assert "On the page" in problem
    assert start("recover") == ("", ["recover", "t"])
    leave(order, "real", HELD, name="2099-01-01_t")
    assert start("") != ("", ["t"])
    assert start("cleared") == ("", ["t"])


def test_two_starts_at_the_same_time_are_one_run(
    order: RunOrder, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert order.record is not None
    dashboard: Any = SimpleNamespace(control=ControlLock(), on_event=lambda event: None)
    launcher = Launcher(
        dashboard, order.record, Choices({"tree": order.tree}, {"cell": order.cell})
    )
    both, went_on = threading.Barrier(2), threading.Event()
    monkeypatch.setattr(
        "pomona.tools.dashboard.command_dashboard.execute", lambda *_, **__: went_on.wait(5.0)
    )

    def judged(_form: object) -> RunOrder:
        with contextlib.suppress(threading.BrokenBarrierError):
            both.wait(0.1)  # there where the second would have passed the first
        return order

    monkeypatch.setattr(launcher, "_order", judged)
    answers: list[str] = []

    def start() -> None:
        try:
            answers.append(launcher.start({}))
        except RefusedError as refused:
            answers.append(str(refused))

    pages = [threading.Thread(target=start) for _ in range(2)]
    for page in pages:
        page.start()
    for page in pages:
        page.join()
    went_on.set()
    launcher.close()
    assert sorted(answers) == ["a run is going on", "tree"]


@pytest.mark.parametrize("who", ["a signal", "the page"])
def test_a_stop_between_the_recovery_and_the_run_keeps_the_run_from_beginning(
    order: RunOrder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, who: str
) -> None:
    (tmp_path / "recover.yaml").write_text(TREE.replace("tree: t", "tree: recover"))
    monkeypatch.setattr("pomona.executive.execute.installed_trees", lambda: tmp_path)
    desk = ControlLock()
    close = RecordingSession.close

    def closes(session: RecordingSession) -> str:
        if who == "a signal":
            os.kill(os.getpid(), signal.SIGTERM)
        else:
            assert desk.safe_stop("ada") == "nothing was running, and nothing begins now"
        return close(session)

    monkeypatch.setattr(RecordingSession, "close", closes)
    with pytest.raises(KeyboardInterrupt if who == "a signal" else StartCancelledError):
        execute(replace(order, recover=True), on_ready=desk.serve, starting=desk.prepare("t"))
    assert order.record is not None
    assert ["_recover" in path.name for path in order.record.iterdir()] == [True]


def test_a_recovery_that_failed_leaves_the_cell_as_it_was(order: RunOrder) -> None:
    leave(order, "real", HELD)
    leave(
        order,
        "real",
        None,
        ended=True,
        name="2026-01-02_recover",
        tree="recover",
        outcome="failure",
    )
    assert order.record is not None
    assert unfinished(order.record, order.cell) is not None
    leave(order, "real", None, ended=True, name="2026-01-03_recover", tree="recover")
    assert unfinished(order.record, order.cell) is None
