"""`pomona why` on runs of mocks: whole runs, repeated in this process."""

from __future__ import annotations

import contextlib
import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings, strategies as st
from recorded_events import FAILED, foreign, started, write

from pomona.executive.cli import main
from pomona.executive.encode import encoded
from pomona.executive.errors import UsageError
from pomona.executive.execute import RunOrder
from pomona.executive.recording.message import message_of
from pomona.executive.recording.read import read_events
from pomona.tools.library.cures import command_why
from pomona.tools.library.cures.command_why import read_case
from pomona.tools.library.cures.trials import Trial, run_trial

LIMIT = """\
pomona: 1
tree: slow
parameters:
  looks: {type: int, default: 3}
root:
  sequence:
    - wait: 500 ms
    - wait: 4 s          # the work
      name: Work
      timeout: 1 s
  retry: "{looks}"
"""
TRIES = """\
pomona: 1
tree: tries
root:
  sequence:
    - MoveTo: {pose: home}
  name: Attempt
  retry: 2               # the mock succeeds at the fourth try
"""
CHECKED = """\
pomona: 1
tree: checked
parameters:
  count: {type: int, default: 3}
root:
  sequence:
    - check: "{count} > 2"
    - wait: 20 ms
"""
NEVER = "pomona: 1\ntree: never\nroot: {fail: }\n"


class Here:
    """Trials in this process, one after another."""

    def __init__(self, _jobs: int) -> None:
        self._waiting: list[tuple[Any, RunOrder]] = []

    @property
    def free(self) -> bool:
        return not self._waiting

    def start(self, key: Any, order: RunOrder, limit: float) -> None:
        assert limit > 0.0
        self._waiting.append((key, order))

    def ended(self) -> Iterator[tuple[Any, Trial]]:
        for key, order in self._waiting:
            self._waiting = []
            yield key, run_trial(order)

    def close(self) -> None:
        self._waiting = []


@pytest.fixture(autouse=True)
def inside(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(command_why, "TrialPool", Here)


def why(capsys: pytest.CaptureFixture[str], *arguments: str, status: int = 0) -> str:
    """Return the output of `pomona why last`, without its line breaks."""
    capsys.readouterr()
    assert main(["why", *arguments]) == status
    captured = capsys.readouterr()
    assert "Traceback" not in captured.out + captured.err
    return " ".join((captured.out + captured.err).split())


def fail(tree: str, *more: str, mocks: str = "mocks: {}\n") -> None:
    Path("tree.yaml").write_text(tree)
    Path("mocks.yaml").write_text(mocks)
    assert main(["run", "tree.yaml", "--dry", "mocks.yaml", "--quiet", *more]) == 1


def test_a_timeout_that_is_too_short_is_the_first_cause(capsys: pytest.CaptureFixture[str]) -> None:
    fail(LIMIT)
    said = why(capsys, "last", "--seeds", "2")
    assert "✗ without a change TIMEOUT after" in said
    assert "the cure: tree.yaml:10 Work.timeout: 1 s -> 5 s" in said
    assert "3 of 3" in said
    assert Path("tree.yaml").read_text() == LIMIT


def test_more_tries_cure_a_step_that_succeeds_at_the_fourth(
    capsys: pytest.CaptureFixture[str],
) -> None:
    fail(TRIES, mocks="mocks:\n  MoveTo: [NO_PATH, NO_PATH, NO_PATH, success]\n")
    said = why(capsys, "last", "--seeds", "1")
    assert "the cure: tree.yaml:7 Attempt.retry: 2 -> 4" in said


def test_a_value_with_which_the_run_was_started_is_tried_first(
    capsys: pytest.CaptureFixture[str],
) -> None:
    fail(CHECKED, "--set", "count=1")
    said = why(capsys, "last")
    assert "1. tree.yaml:4 count: 1 -> 3" in said
    assert "the run was started with another value" in said


def test_no_cure_is_an_answer_with_status_1(capsys: pytest.CaptureFixture[str]) -> None:
    fail(NEVER)
    assert "there is no single change to try" in why(capsys, "last", status=1)


def test_json_holds_the_change_and_its_cost(capsys: pytest.CaptureFixture[str]) -> None:
    fail(LIMIT)
    capsys.readouterr()
    assert main(["why", "last", "--seeds", "1", "--json"]) == 0
    found = json.loads(capsys.readouterr().out.splitlines()[-1])
    (cure,) = found["cures"]
    assert (cure["line"], cure["name"], cure["before"], cure["after"]) == (
        10,
        "Work.timeout",
        "1 s",
        "5 s",
    )
    assert (cure["successes"], cure["seeds"]) == (2, 2)
    assert found["original"]["repeats"] is True
    assert found["original"]["other_seeds"] == 1
    assert found["original"]["successes_of_other_seeds"] == 0
    assert cure["time_s"] > 4.0


# ------------------------------------------------------------------------------------------------ refused


def test_a_run_that_succeeded_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    Path("tree.yaml").write_text("pomona: 1\ntree: t\nroot: {wait: 20 ms}\n")
    assert main(["run", "tree.yaml", "--dry", "--quiet"]) == 0
    assert "the run succeeded: there is nothing to cure" in why(capsys, "last", status=2)


def test_a_damaged_record_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    fail(LIMIT)
    (path,) = Path("runs").glob("*/run.mcap")
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0xFF
    path.write_bytes(content)
    assert "the record is damaged and is not trusted" in why(capsys, "last", status=2)


def test_a_record_without_an_end_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    write(Path("runs/cut"), (started(),))
    assert "the run has no end" in why(capsys, "cut", status=2)


def test_a_record_whose_tree_cannot_be_rebuilt_is_refused_in_one_line(
    capsys: pytest.CaptureFixture[str],
) -> None:
    tree = "pomona: 1\ntree: t\nroot:\n  sequence:\n    - NoSuchSkill: {}\n    - NorThis: {}\n"
    about = {"cell": "dry", "cell_kind": "mock", "cell_path": "", "cell_text": "", "settings": {}}
    write(Path("runs/old"), (started(**about, tree_text=tree), *FAILED[1:]))
    said = why(capsys, "old", status=2)
    assert "its tree cannot be rebuilt here" in said
    assert "no skill named 'NoSuchSkill'" in said
    assert "(and 1 more)" in said


def test_a_run_of_a_real_cell_is_simulated_and_never_connected(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    used: list[RunOrder] = []

    class Watched(Here):
        def start(self, key: Any, order: RunOrder, limit: float) -> None:
            used.append(order)
            super().start(key, order, limit)

        def ended(self) -> Iterator[tuple[Any, Trial]]:
            for key, order in self._waiting:
                self._waiting = []
                good = "5 s" in order.texts["tree.yaml"]
                yield (
                    key,
                    Trial("success" if good else "failure", "" if good else "TIMEOUT", time=1.0),
                )

    monkeypatch.setattr(command_why, "TrialPool", Watched)
    fail(LIMIT)
    (path,) = (one for one in Path("runs").iterdir() if one.is_dir())
    _relabel(
        path,
        cell="lab",
        cell_kind="real",
        cell_path="/nowhere/lab.yaml",
        cell_text="name: lab\nkind: real\n",
    )
    said = why(capsys, "lab", "--seeds", "1")
    assert "This is a simulation of a run on a real cell" in said
    assert "the cure: tree.yaml:10 Work.timeout: 1 s -> 5 s" in said
    assert {order.cell.name for order in used} == {"sim.yaml"}
    assert all(not order.dry for order in used)


def _relabel(record: Path, **about: Any) -> None:
    """Write the record `lab` with the events of another one on another cell."""
    from dataclasses import replace

    from pomona.executive.recording.read import read_events

    first, *rest = read_events(record)
    write(Path("runs/lab"), (replace(first, **about), *rest))


def test_a_cell_is_no_choice_for_a_run_that_is_repeated_on_its_own(
    capsys: pytest.CaptureFixture[str],
) -> None:
    fail(LIMIT)
    assert "--cell is for runs on a real cell" in why(capsys, "last", "--cell", "sim", status=2)


@pytest.mark.parametrize(
    "wrong",
    [
        ("--budget", "0 s"),
        ("--budget", "soon"),
        ("--jobs", "0"),
        ("--seeds", "-1"),
        ("--cures", "many"),
    ],
)
def test_a_wrong_option_is_refused(
    wrong: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["why", "last", *wrong])
    assert ended.value.code == 2
    assert wrong[0] in capsys.readouterr().err


# ------------------------------------------------------------------------------------------------ forged records

ODD = (None, "x", -1, 2**70, float("nan"), [], {}, ["a"], {"path": 3}, True)


@settings(
    max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_a_forged_record_gives_a_case_or_one_error(data: st.DataObject) -> None:
    """Any value of a whole record may be replaced by another one: nothing but a `UsageError` is raised."""
    messages = _failed_messages()
    number = data.draw(st.sampled_from(range(len(messages))))
    keys = data.draw(st.sampled_from(list(_places(messages[number]))))
    messages[number] = _put(messages[number], keys, data.draw(st.sampled_from(ODD)))
    shutil.rmtree("runs/odd", ignore_errors=True)
    foreign(Path("runs/odd"), *(json.dumps(message).encode() for message in messages))
    with contextlib.suppress(UsageError):
        read_case(Path("runs/odd"))


def _failed_messages() -> list[Any]:
    if not Path("runs").is_dir():
        fail(LIMIT)
        shutil.move(next(one for one in Path("runs").iterdir() if one.is_dir()), "whole")
    return [json.loads(encoded(message_of(event))) for event in read_events(Path("whole"))]


def _places(value: Any, at: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    yield at
    inner = (
        value.items()
        if isinstance(value, dict)
        else enumerate(value)
        if isinstance(value, list)
        else ()
    )
    for key, item in inner:
        yield from _places(item, (*at, key))


def _put(value: Any, at: tuple[Any, ...], new: Any) -> Any:
    if not at:
        return new
    changed = value.copy()
    changed[at[0]] = _put(value[at[0]], at[1:], new)
    return changed


def test_a_foreign_file_is_named_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "tree.yaml"
    path.write_text("pomona: 1\n")
    assert why(capsys, str(path), status=2).count(str(path)) == 1
