"""A tree of plain py_trees behaviours is recorded and explained like a tree file."""

from __future__ import annotations

import json
import re
import socket
import threading
from pathlib import Path
from typing import Any
from urllib.request import Request, urlopen

import py_trees
import pytest
from py_trees.common import Status

from pomona.executive.behaviours import run_behaviour
from pomona.executive.cli import main
from pomona.executive.errors import UsageError
from pomona.executive.recording.read import read_events
from pomona.executive.running.events import NodeChanged


class Count(py_trees.behaviour.Behaviour):
    """Count ticks, then end."""

    def __init__(self, name: str, ticks: int, end: Status = Status.SUCCESS) -> None:
        super().__init__(name)
        self.left, self.end = ticks, end

    def update(self) -> Status:
        self.left -= 1
        self.feedback_message = f"{self.left} left"
        return Status.RUNNING if self.left > 0 else self.end


class Broken(py_trees.behaviour.Behaviour):
    def update(self) -> Status:
        raise ZeroDivisionError("a division by zero")


def sequence(*children: py_trees.behaviour.Behaviour) -> py_trees.composites.Sequence:
    return py_trees.composites.Sequence("fetch", memory=True, children=list(children))


def test_a_tree_runs_to_its_end_and_its_record_holds_each_change(tmp_path: Path) -> None:
    executed = run_behaviour(
        sequence(Count("go", 2), Count("go", 1)), record=tmp_path, period=0.001
    )
    assert executed.result.outcome == "success"
    assert executed.record is not None
    changes = [
        (event.path, event.status)
        for event in read_events(executed.record)
        if isinstance(event, NodeChanged)
    ]
    assert changes == [
        ("fetch", "RUNNING"), ("fetch/go", "RUNNING"), ("fetch", "SUCCESS"), ("fetch/go", "SUCCESS"),
        ("fetch/go#2", "SUCCESS"),
    ]  # fmt: skip


def test_a_failure_is_explained_by_the_leaf_that_failed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tree = sequence(Count("look", 1), Count("grasp", 2, Status.FAILURE))
    executed = run_behaviour(tree, record=tmp_path, period=0.001)
    assert executed.result.outcome == "failure"
    assert executed.result.reason is not None
    assert (executed.result.reason.node_path, executed.result.reason.message) == ("fetch", "0 left")
    assert main(["explain", "--record", str(tmp_path)]) == 0
    assert "grasp" in capsys.readouterr().out


def test_an_exception_of_a_behaviour_ends_the_run_as_an_error() -> None:
    executed = run_behaviour(sequence(Broken("broken")), record=None, period=0.001)
    assert executed.result.outcome == "error"
    assert executed.result.reason is not None
    assert "a division by zero" in executed.result.reason.message


def test_a_decorator_and_a_slash_in_a_name_get_paths_of_their_own() -> None:
    tree = py_trees.decorators.Inverter("not", Count("a/b", 1, Status.FAILURE))
    executed = run_behaviour(sequence(tree), record=None, period=0.001)
    assert executed.result.outcome == "success"
    assert tree.children[0].path == "fetch/not/a∕b"  # type: ignore[attr-defined]


@pytest.mark.parametrize("name", ["", " "])
def test_a_behaviour_without_a_name_is_shown_under_its_class(tmp_path: Path, name: str) -> None:
    root = py_trees.composites.Sequence(
        name, memory=True, children=[Count(name, 1), Count(name, 1, Status.FAILURE)]
    )
    executed = run_behaviour(root, record=tmp_path, period=0.001)
    assert executed.result.outcome == "failure"
    assert executed.record is not None
    paths = [event.path for event in read_events(executed.record) if isinstance(event, NodeChanged)]
    assert paths == ["Sequence", "Sequence/Count", "Sequence/Count#2"]
    assert main(["explain", "--record", str(tmp_path)]) == 0


def test_a_child_that_starts_and_is_interrupted_in_one_tick_is_recorded() -> None:
    policy = py_trees.common.ParallelPolicy.SuccessOnOne()
    children = [py_trees.behaviours.Running("runs"), py_trees.behaviours.Success("done")]
    seen: list[Any] = []
    parallel = py_trees.composites.Parallel("p", policy, children=children)
    executed = run_behaviour(parallel, record=None, period=0.001, listeners=[seen.append])
    assert executed.result.outcome == "success"
    changes = [
        (e.path, e.status, e.starts)
        for e in seen
        if isinstance(e, NodeChanged) and e.path.endswith("runs")
    ]
    assert changes == [("p/runs", "INVALID", 1)]


def test_the_page_shows_the_tree_and_stops_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    answers: list[dict[str, Any]] = []

    def stop() -> None:
        address, token = re.findall(
            r"dashboard: (http://\S+/)#token=(\S+?)&", capsys.readouterr().out
        )[0]
        headers = {"content-type": "application/json", "x-pomona-token": token}
        body = json.dumps({"action": "safe_stop", "viewer": "me", "who": "ada"}).encode()
        with urlopen(Request(f"{address}api/act", body, headers), timeout=60) as answer:
            answers.append(json.load(answer))

    thread = threading.Thread(target=stop)

    class Begin(py_trees.behaviour.Behaviour):
        """Order the stop once the run ticks: before, it would end the preparation."""

        def update(self) -> Status:
            thread.start()
            return Status.SUCCESS

    tree = sequence(Begin("begin"), Count("go", 10**9))
    executed = run_behaviour(tree, dashboard=True, port=port, record=tmp_path, period=0.001)
    thread.join()
    assert executed.result.outcome == "stopped"
    assert answers[0]["confirmed"] == "safe state: safe stop by ada"


def test_a_port_that_is_taken_is_refused_before_the_first_tick(tmp_path: Path) -> None:
    tree = sequence(counter := Count("go", 5))
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        with pytest.raises(UsageError, match="the port is taken"):
            run_behaviour(tree, dashboard=True, port=taken.getsockname()[1], record=tmp_path)
    assert counter.left == 5
    assert list(tmp_path.iterdir()) == []


def test_the_lines_of_the_readme_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    text = (Path(__file__).parents[2] / "README.md").read_text("utf-8")
    (lines,) = re.findall(r"```python\n(import py_trees\n.*?)```", text, re.DOTALL)
    script = lines.replace("dashboard=True", "period=0.001").replace("2.0", "0.01")
    pasted: dict[str, Any] = {}
    exec(script, pasted)
    assert pasted["executed"].result.outcome == "success"
