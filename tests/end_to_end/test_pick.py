"""The whole job on the simulated cell: a tree file in, a picked apple and a record out."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pomona.drivers.interfaces import Arm, Gripper
from pomona.executive.cell.cell import Cell
from pomona.executive.cell.connect import load_cell
from pomona.executive.cli import main
from pomona.executive.execute import Executed, RunOrder, execute
from pomona.executive.files import find_cell, find_tree
from pomona.executive.language import build
from pomona.executive.language.check import read_document
from pomona.executive.recording.read import read_events
from pomona.executive.registry import Registry
from pomona.executive.running.events import Event, HandChanged, Published, RunEnded
from pomona.executive.running.runner import Runner
from pomona.executive.running.starting import RunResult
from pomona.executive.running.tick import EventStream

pytestmark = pytest.mark.slow


def pick(
    seed: int = 0,
    record: Path | None = None,
    listeners: Any = (),
    on_ready: Any = None,
    **settings: str,
) -> Executed:
    order = RunOrder(find_tree("pick_apple"), find_cell("sim"), seed, settings, record=record)
    return execute(order, listeners, on_ready=on_ready or (lambda _runner: None))


@pytest.mark.pick
@pytest.mark.landmark
def test_an_apple_is_picked_and_the_record_repeats_it(tmp_path: Path) -> None:
    received: list[Event] = []
    executed = pick(1, tmp_path, [received.append], fruit="apple_4", place="2")
    assert executed.result.outcome == "success", executed.result.reason
    assert executed.result.truth is not None
    assert executed.result.truth["lifted"] is True
    assert executed.record is not None
    assert (executed.record / "picture.png").stat().st_size > 20_000
    replayed = list(read_events(executed.record))
    assert [(type(e), e.t, e.tick) for e in replayed] == [(type(e), e.t, e.tick) for e in received]
    hands = [event.what for event in replayed if isinstance(event, HandChanged)]
    assert not hands[0]
    assert all(hands[1:]), "what is held is never said to be gone, however little it is pressed"
    topics = {event.topic for event in replayed if isinstance(event, Published)}
    assert {"detection", "refine", "grip"} <= {topic.split("/")[0] for topic in topics}


@pytest.mark.parametrize(("seed", "fruit", "place"), [(1, "apple_1", "3"), (5, "apple_5", "5")])
def test_an_apple_is_picked_without_a_force_sensor(seed: int, fruit: str, place: str) -> None:
    received: list[Event] = []
    order = RunOrder(
        find_tree("pick_apple_plain"),
        find_cell("sim_plain"),
        seed,
        {"fruit": fruit, "place": place},
    )
    executed = execute(order, [received.append])
    assert executed.result.outcome == "success", executed.result.reason
    truth = executed.result.truth
    assert truth is not None
    assert (truth["lifted"], truth["drops"]) == (True, 0)
    hands = [event.what for event in received if isinstance(event, HandChanged)]
    assert hands[0] == ""
    assert hands[-1] == "something is between the fingers"


def run_on(cell: Cell, tree: str, seed: int, **settings: str) -> RunResult:
    registry, document = Registry.installed(), read_document(find_tree(tree))
    runner = Runner(
        lambda context, board: build(
            document, registry, overrides=settings, context=context, board=board
        ),
        cell,
        EventStream(),
        seed=seed,
    )
    runner.prepare()
    return runner.run()


@pytest.mark.parametrize("release", ["false", "true"])
def test_recover_keeps_the_apple_without_a_force_sensor(release: str) -> None:
    """The arm goes home with the apple. With `release` it stays: no contact is measured, so nothing opens."""
    cell = load_cell(find_cell("sim_plain"), seed=1, overrides={"fruit": "apple_1", "place": "3"})
    try:
        assert run_on(cell, "pick_apple_plain", 1).outcome == "success"
        held, q = cell.device(Gripper).state().width, cell.device(Arm).state().q
        recovered = run_on(cell, "recover", 1, release=release)
        if release == "true":
            assert recovered.reason is not None
            assert recovered.reason.code == "NO_CONTACT"
            goal = q
        else:
            assert recovered.outcome == "success", recovered.reason
            goal = cell.workspace.poses["home"]
        assert np.abs(cell.device(Arm).state().q - goal).max() < 0.01
        assert cell.device(Gripper).state().width == pytest.approx(held, abs=1e-3)
        assert cell.in_hand() == "something is between the fingers"
        assert recovered.truth is not None
        assert recovered.truth["drops"] == 0
    finally:
        cell.close()


def test_a_recovery_comes_before_the_task_and_each_has_its_record(tmp_path: Path) -> None:
    """With every view that is installed: each follows two runs."""
    assert main(["run", "pick_apple", "--recover", "--seed", "3", "--record", str(tmp_path)]) == 0
    first, second = sorted(path.name for path in tmp_path.iterdir())
    assert first.endswith("_recover")
    assert second.endswith("_pick_apple")


def test_another_fruit_is_picked_by_the_same_tree_with_its_own_weights() -> None:
    truth = pick(0, None, kind="lemon", fruit="lemon", place="5").result.truth
    assert truth is not None
    assert truth["lifted"] is True
    assert truth["target"] == "lemon"
    assert truth["position_error_mm"] < 4.0


def test_the_json_line_is_complete_for_a_program(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status = main(
        [
            "run",
            "pick_apple",
            "--seed",
            "2",
            "--record",
            str(tmp_path),
            "--json",
            "--set",
            "fruit=apple_1",
        ]
    )
    line = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert status == 0
    assert line["outcome"] == "success"
    wanted = {
        "outcome",
        "reason",
        "run",
        "record",
        "seed",
        "ticks",
        "time_s",
        "wall_s",
        "attempts",
        "truth",
    }
    assert wanted <= line.keys()
    assert {"lifted", "slip_mm", "peak_force_n", "least_force_n"} <= line["truth"].keys()
    assert Path(line["record"]).is_dir()


def story(executed_events: list[Event]) -> str:
    """Return the parts that must be equal in every run: all that do not depend on the wall clock."""
    kept = [
        e
        for e in executed_events
        if type(e).__name__ in ("NodeChanged", "AttemptEnded", "StateChanged")
    ]
    return "\n".join(repr(event) for event in kept)


@pytest.mark.long
def test_the_same_seed_gives_the_same_events() -> None:
    stories = []
    for _ in range(2):
        received: list[Event] = []
        pick(3, None, [received.append], fruit="apple_3")
        stories.append(story(received))
    assert stories[0] == stories[1]


def test_a_task_that_cannot_succeed_fails_with_every_attempts_reason() -> None:
    executed = pick(0, None, attempts="2", friction="0.06")  # nothing this slippery can be lifted
    assert executed.result.outcome == "failure"
    assert executed.result.reason is not None
    assert all(leaf.code.isupper() and leaf.message for leaf in executed.result.reason.leaves())
    failed = [attempt for attempt in executed.summary.attempts if not attempt.succeeded]
    assert failed
    assert all(attempt.reason is not None for attempt in failed)


def test_a_safe_stop_in_the_lift_keeps_the_apple_held() -> None:
    runners: list[Runner] = []

    def stop_in_lift(event: Event) -> None:
        if type(event).__name__ == "NodeChanged" and event.path.endswith("Lift") and event.t > 0:  # type: ignore[attr-defined]
            runners[0].safe_stop("test", "test")

    executed = pick(0, None, [stop_in_lift], runners.append)
    assert executed.result.outcome == "stopped"
    assert executed.result.truth is not None
    assert executed.result.truth["drops"] == 0


@pytest.mark.long
def test_ctrl_c_closes_a_readable_record_and_exits_with_130(tmp_path: Path) -> None:
    # What is started in the background, as tests may be, begins with Ctrl-C ignored.
    listening = "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler)"
    script = f"{listening}; from pomona.executive.cli import main; sys.exit(main())"
    command = [
        sys.executable,
        "-c",
        script,
        "run",
        "pick_apple",
        "--pace",
        "real",
        "--record",
        str(tmp_path),
    ]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    ) as process:
        assert process.stdout is not None
        for line in process.stdout:
            if "Plan" in line:
                process.send_signal(signal.SIGINT)
                break
        output = process.stdout.read()
        assert process.wait(60) == 130
    assert "Traceback" not in output
    (folder,) = tmp_path.iterdir()
    events = list(read_events(folder))
    assert isinstance(events[-1], RunEnded)
    assert events[-1].outcome == "stopped"


def test_a_pick_of_a_fruit_that_is_not_there_is_no_success() -> None:
    executed = pick(3, kind="lemon")
    assert executed.result.outcome == "failure"
    assert executed.result.truth is not None
    assert executed.result.truth["collisions"] == 0
