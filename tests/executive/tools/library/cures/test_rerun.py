"""`pomona rerun --set`: a run of mocks again, with a change."""

from __future__ import annotations

from pathlib import Path

import pytest

from pomona.executive.cli import main
from pomona.executive.execute import RunOrder, execute
from pomona.executive.files import find_cell
from pomona.executive.running.events import Event, StateChanged
from pomona.executive.running.runner import Runner

TREE = """\
pomona: 1
tree: slow
parameters:
  work: {type: time, default: 4 s}
root:
  sequence:
    - wait: "{work}"
      name: Work
      timeout: 1 s
    - MoveTo:
        pose: home       # from here on it is at home
    - wait: 20 ms
    - wait: 20 ms
"""


@pytest.fixture(autouse=True)
def failed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("tree.yaml").write_text(TREE)
    assert main(["run", "tree.yaml", "--dry", "--quiet"]) == 1


def rerun(capsys: pytest.CaptureFixture[str], *settings: str, status: int) -> str:
    capsys.readouterr()
    assert (
        main(["rerun", "last", *(word for text in settings for word in ("--set", text))]) == status
    )
    captured = capsys.readouterr()
    assert "Traceback" not in captured.out + captured.err
    return " ".join((captured.out + captured.err).split())


def test_a_word_of_a_node_is_changed_and_the_run_succeeds(
    capsys: pytest.CaptureFixture[str],
) -> None:
    said = rerun(capsys, "Work.timeout=5 s", status=0)
    assert "tree.yaml:9 Work.timeout: 1 s -> 5 s" in said
    assert "✓ slow" in said
    assert Path("tree.yaml").read_text() == TREE
    assert len(list(Path("runs").glob("*/"))) == 1  # it leaves no record


def test_a_parameter_is_changed(capsys: pytest.CaptureFixture[str]) -> None:
    assert "tree.yaml:4 work: 4 s -> 500 ms" in rerun(capsys, "work=500 ms", status=0)


def test_two_changes_are_made_together(capsys: pytest.CaptureFixture[str]) -> None:
    assert "✗ slow" in rerun(capsys, "Work.timeout=5 s", "work=9 s", status=1)


def test_a_port_that_is_not_written_is_written(capsys: pytest.CaptureFixture[str]) -> None:
    said = rerun(capsys, "MoveTo.budget=2 s", "work=20 ms", status=0)
    assert "tree.yaml:10 MoveTo.budget: 500 ms -> 2 s" in said


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("works=1 s", "did you mean 'work'?"),
        ("work", "write NAME=VALUE"),
        ("Work.wait=1 s", "it is wired"),
        ("Wrk.timeout=1 s", "no node 'Wrk'"),
        ("MoveTo.budgt=1 s", "did you mean 'budget'?"),
        ("wait.wait=1 s", "use the name of one"),
        ("Work.timeout=soon", "error"),
    ],
)
def test_a_change_that_cannot_be_made_is_refused_with_the_reason(
    text: str, why: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert why in rerun(capsys, text, status=2)


def test_a_run_that_reloaded_its_tree_is_repeated_as_it_ran_or_the_answer_names_the_change(
    capsys: pytest.CaptureFixture[str],
) -> None:
    first = TREE.replace("    - MoveTo", "    - wait: 20 ms\n      name: Pause\n    - MoveTo")
    first = first.replace("timeout: 1 s", "timeout: 9 s")
    Path("turn.yaml").write_text(first.replace("tree: slow", "tree: turn"))
    runners: list[Runner] = []

    def reload_when_paused(event: Event) -> None:
        if isinstance(event, StateChanged) and event.state == "paused":
            Path("turn.yaml").write_text(
                Path("turn.yaml").read_text() + "    - fail: {code: LATER, message: later}\n"
            )
            runners[0].reload(event.pause, "ada")
            runners[0].resume(event.pause, "ada")

    order = RunOrder(
        Path("turn.yaml"),
        find_cell("sim"),
        dry=True,
        record=Path("runs"),
        breaks=(("turn/Work", "after"),),
    )
    executed = execute(order, [reload_when_paused], on_ready=runners.append)
    assert executed.result.outcome == "failure"
    assert executed.record is not None
    capsys.readouterr()
    status = main(["rerun", str(executed.record), "--set", "work=2 s"])
    captured = capsys.readouterr()
    assert status == 1 or "reload" in captured.out + captured.err
