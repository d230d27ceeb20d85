"""The supervisor process stops the devices when the run's process hangs, is stopped or dies, and only then."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from fake_cell import FakeCell
from fake_runs import Turn, make

from pomona.executive.registry import Registry
from pomona.executive.running.supervise import REPORT
from pomona.executive.running.supervisor import NoSupervisorError, RunSupervision, Supervisor

SUPERVISED = """
import ctypes, os, signal, sys, time
from pathlib import Path
from pomona.executive.running.supervisor import Supervisor
folder, way = Path(sys.argv[1]), sys.argv[2]
deadline = float(sys.argv[3])
supervisor = Supervisor({"wheel": ("os:mkdir", [str(folder / "stopped")])}, deadline, folder)
for _ in range(20):
    supervisor.beat()
    time.sleep(0.02)
beaten = time.monotonic()  # before the line that lets the test stop this process
print("alive", supervisor._process.pid, flush=True)
if way == "tick":
    while (now := time.monotonic()) - beaten < 0.5 * deadline:
        beaten = now
        supervisor.beat()
        time.sleep(0.02)
    (folder / "safe").mkdir()
if way == "hang":
    while True:
        pass
if way == "crash":
    ctypes.string_at(0)
if way == "still":
    for _ in range(20):
        supervisor.beat()
        time.sleep(0.02)
if way == "rest":
    supervisor.rest()
    time.sleep(1.0)
if way == "wait":
    time.sleep(60.0)
supervisor.close()
"""


def supervised(folder: Path, way: str, number: int | None = None) -> tuple[int, str, float]:
    """Return a supervised process's exit status, its output, and its duration."""
    command = [sys.executable, "-c", SUPERVISED, str(folder), way, "0.4"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        assert process.stdout.readline().startswith("alive ")
        began = time.monotonic()
        if number is not None:
            process.send_signal(number)
        said = process.stderr.read()  # until the supervisor has ended, too: it holds the other end
        return process.wait(), said, time.monotonic() - began


@pytest.mark.parametrize(
    ("way", "number", "reason"),
    [
        ("hang", None, "did not answer for 0.4 s"),
        ("wait", signal.SIGSTOP, "did not answer for 0.4 s"),
        ("wait", signal.SIGKILL, "the run's process died"),
        ("crash", None, "the run's process died"),  # in compiled code
    ],
)
def test_a_process_that_hangs_is_stopped_or_dies_has_its_devices_stopped(
    tmp_path: Path, way: str, number: int | None, reason: str
) -> None:
    status, said, took = supervised(tmp_path, way, number)
    assert status == -(signal.SIGSEGV if way == "crash" else signal.SIGKILL)
    assert (tmp_path / "stopped").is_dir()
    assert reason in said
    report = json.loads((tmp_path / REPORT).read_text())
    assert report["devices"] == {"wheel": "stopped"}
    assert reason in report["reason"]
    assert took < 20.0


@pytest.mark.parametrize("way", ["end", "rest"])
def test_a_process_that_ends_or_rests_is_left_alone(tmp_path: Path, way: str) -> None:
    status, said, _took = supervised(tmp_path, way)
    assert (status, said) == (0, "")
    assert not (tmp_path / "stopped").exists()


def test_a_computer_that_stalls_as_a_whole_causes_no_fault(tmp_path: Path) -> None:
    command = [sys.executable, "-c", SUPERVISED, str(tmp_path), "still", "0.4"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        supervisor = int(process.stdout.readline().split()[-1])
        for number in (signal.SIGSTOP, signal.SIGCONT):
            os.kill(supervisor, number)
            process.send_signal(number)
            time.sleep(0.6 if number == signal.SIGSTOP else 0.0)
        _said, complaint = process.communicate()
    assert (process.returncode, complaint) == (0, "")
    assert not (tmp_path / "stopped").exists()


@pytest.mark.parametrize("whole", [False, True], ids=["its group", "its supervisor, too"])
def test_a_run_that_a_signal_stops_is_continued_and_ends_by_itself(
    tmp_path: Path, whole: bool
) -> None:
    command = [sys.executable, "-c", SUPERVISED, str(tmp_path), "tick", "2.0"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True
    ) as process:
        assert process.stdout is not None
        supervisor = int(process.stdout.readline().split()[-1])
        os.killpg(process.pid, signal.SIGSTOP)  # Ctrl-Z reaches the group, and not its supervisor
        if whole:
            os.kill(supervisor, signal.SIGSTOP)
            time.sleep(2.2)
            os.kill(supervisor, signal.SIGCONT)
            os.killpg(process.pid, signal.SIGCONT)
        try:
            _said, complaint = process.communicate(timeout=60)
        finally:
            process.kill()  # harmless when it has ended
    assert (process.returncode, complaint) == (0, b"")
    assert (tmp_path / "safe").is_dir()
    assert not (tmp_path / "stopped").exists()


@pytest.mark.slow
def test_a_device_that_cannot_be_stopped_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "stopped").mkdir()  # os.mkdir fails now
    _status, said, _took = supervised(tmp_path, "wait", signal.SIGKILL)
    assert "wheel could not be stopped" in said


def test_an_unwritable_report_is_reported_without_a_traceback(tmp_path: Path) -> None:
    (tmp_path / REPORT).mkdir()
    _status, said, _took = supervised(tmp_path, "wait", signal.SIGKILL)
    assert (tmp_path / "stopped").is_dir()
    assert f"{REPORT}: Is a directory" in said
    assert "Traceback" not in said


def test_a_function_that_is_not_there_refuses_the_run(capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(NoSupervisorError):
        Supervisor({"wheel": ("os:no_such_function", [])}, 1.0)
    assert "no_such_function" in capfd.readouterr().err


def test_a_run_whose_supervisor_is_gone_ends_in_the_safe_state() -> None:
    supervisor = Supervisor({"wheel": ("os:getpid", [])}, 5.0)

    def end_it(_runner: object, _cell: FakeCell) -> None:
        os.kill(supervisor._process.pid, signal.SIGKILL)
        supervisor._process.wait()

    runner, cell, _events = make(
        "pomona: 1\ntree: t\nroot: {Turn: {duration: 9 s}}", Registry({"Turn": Turn}), {5: end_it}
    )
    runner._heartbeat = supervisor.beat
    runner.look_after("supervisor", supervisor.state, required=True)
    result = runner.run()
    supervisor.close()
    assert result.outcome == "stopped"
    assert cell.latched == "the supervisor process is gone"


def test_a_supervisor_that_is_stopped_is_noticed_and_one_that_answers_is_not() -> None:
    supervisor = Supervisor({"wheel": ("os:getpid", [])}, 0.5)

    def beat_until(end: float) -> str:
        while time.monotonic() < end and supervisor.state() == "ok":
            supervisor.beat()
            time.sleep(0.01)
        return supervisor.state()

    assert beat_until(time.monotonic() + 0.4) == "ok"
    os.kill(supervisor._process.pid, signal.SIGSTOP)
    stopped = time.monotonic()
    assert beat_until(stopped + 10.0).startswith("the supervisor process has not answered for ")
    os.kill(supervisor._process.pid, signal.SIGCONT)
    supervisor.close()


def test_the_heartbeat_goes_on_while_a_run_is_paused_and_while_it_comes_to_rest() -> None:
    beats: list[str] = []
    runner, _cell, _events = make(
        "pomona: 1\ntree: t\nroot: {Turn: {duration: 9 s}}",
        Registry({"Turn": Turn}),
        {
            4: lambda runner, _cell: runner.pause("ada"),
            30: lambda runner, _cell: runner.safe_stop("enough"),
        },
    )
    runner._heartbeat = lambda: beats.append(runner.state.value)
    runner.run()
    assert beats.count("paused") > 20
    assert len(beats) >= 33  # three more while the wheel coasts


class Supervised(FakeCell):
    """A cell on the system's kind of clock, whose wheel can be stopped from outside."""

    heartbeat_deadline = 1.0

    def outside_stops(self) -> dict[str, tuple[str, list[Any]]]:
        return {"wheel": ("os:getpid", [])}


@pytest.mark.parametrize(
    ("stands_still", "lasts", "outcome"),
    [(0.3, "1 s", "success"), (0.6, "1 s", "stopped"), (3600.0, "2 h", "stopped")],
)
def test_a_run_that_stood_still_does_not_go_on_by_itself_and_reports_that_before_the_faults_of_its_devices(
    monkeypatch: pytest.MonkeyPatch, stands_still: float, lasts: str, outcome: str
) -> None:
    def stand_still(_runner: object, cell: FakeCell) -> None:
        cell.clock.advance(stands_still)
        if outcome == "stopped":  # found by the next look
            monkeypatch.setattr(cell, "check", lambda: pytest.fail("camera: no image"))

    monkeypatch.setattr("pomona.executive.running.supervisor.Supervisor", lambda *_: SimpleNamespace(
        beat=lambda: None, rest=lambda: None, close=lambda: None, state=lambda: "ok"
    ))  # fmt: skip
    runner, cell, _events = make(
        "pomona: 1\ntree: t\nroot: {Turn: {duration: " + lasts + "}}",
        Registry({"Turn": Turn}),
        {5: stand_still},
    )
    cell.__class__ = Supervised
    monkeypatch.setattr(type(cell.clock), "simulated", False)
    supervision = RunSupervision(cell)
    supervision.begin(runner, None)
    runner._heartbeat = supervision.beat
    result = runner.run()
    assert result.outcome == outcome
    if outcome == "stopped":
        assert (cell.latched or "").startswith(f"the run stalled for {stands_still:.1f}")
        assert not cell.wheel.turning
