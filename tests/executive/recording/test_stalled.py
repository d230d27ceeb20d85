"""A disk that takes nothing more, for ever or for a while, or reports an error: the record's promise holds."""

from __future__ import annotations

import errno
import io
import itertools
import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from pomona.executive.cli import main
from pomona.executive.recording import recorder as module, session as session_module
from pomona.executive.recording.folder import EVENTS_FILE, read_ending
from pomona.executive.recording.picture import Picture
from pomona.executive.recording.read import read_events
from pomona.executive.recording.recorder import BATCH, Lag, Recorder
from pomona.executive.recording.scan import is_whole
from pomona.executive.recording.session import RecordingSession
from pomona.executive.running.events import StateChanged
from pomona.executive.values.processes import within

PATIENCE = 300.0  # of a busy machine [s]
ERRORS = [errno.EROFS, errno.EDQUOT, errno.ENOSPC, errno.EIO]


class Disk:
    """Writes of records on it wait in a full pipe, or fail with `error`, once `begin` of them have succeeded."""

    def __init__(self, begin: int, error: int = 0) -> None:
        self.begin, self.error = begin, error
        self.reading, self.full = os.pipe()
        os.set_blocking(self.full, False)
        try:
            while True:
                os.write(self.full, bytes(4096))
        except BlockingIOError:
            os.set_blocking(self.full, True)

    def open(self, path: Path, *arguments: Any, **named: Any) -> Any:
        if path.name != EVENTS_FILE or not arguments or arguments[0] != "wb":
            return io.open(path, *arguments, **named)  # noqa: UP020 - it is `Path.open` that is replaced
        disk = self

        class File(io.FileIO):
            def write(self, data: Any) -> int:
                disk.begin -= 1
                if disk.begin < 0 and disk.error:
                    raise OSError(disk.error, os.strerror(disk.error))
                if disk.begin < 0:
                    os.write(disk.full, b"x")
                return super().write(data) or 0

        return io.BufferedWriter(File(path, "wb"), 1 << 20)

    def go_on(self) -> None:
        """Take everything again."""
        threading.Thread(target=self._read, daemon=True).start()

    def close(self) -> None:
        """Release a write that waits, and the pipe."""
        os.close(self.reading)
        os.close(self.full)

    def _read(self) -> None:
        while os.read(self.reading, 65536):
            pass


@pytest.fixture
def stuck(monkeypatch: pytest.MonkeyPatch) -> Iterator[Disk]:
    disk = Disk(begin=1)
    monkeypatch.setattr(Path, "open", lambda path, *a, **k: disk.open(path, *a, **k))
    yield disk
    disk.go_on()


def wait_for(condition: Callable[[], object]) -> None:
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < deadline
        os.sched_yield()


def record(recorder: Recorder, count: int = 3) -> None:
    for tick in range(count):
        recorder.on_event(StateChanged(tick / 10, tick, "running", "x"))
        written = recorder._steps
        wait_for(lambda before=written: recorder._steps > before or recorder.look() > 3 * BATCH)  # type: ignore[misc]


def test_a_count_that_stands_still_lags_by_the_time_and_one_that_moves_does_not() -> None:
    lag = Lag()
    assert [round(lag.seconds(4, t), 2) for t in (10.0, 10.02, 10.06)] == [0.0, 0.02, 0.06]
    assert lag.seconds(5, 10.08) == 0.0


def test_a_computer_that_stood_still_for_an_hour_is_no_disk_that_takes_nothing() -> None:
    lag = Lag()
    lag.seconds(4, 0.0)
    assert lag.seconds(4, 3600.0) == BATCH


def test_a_write_that_waits_is_reported_and_one_that_goes_on_leaves_a_whole_record(
    tmp_path: Path, stuck: Disk, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "STALLED", 3 * BATCH)
    recorder = Recorder(tmp_path)
    record(recorder)
    wait_for(lambda: recorder.look() > module.STALLED)
    assert recorder.problem == "the disk has taken nothing of the record for 0.3 s"
    assert not recorder.has_ended
    stuck.go_on()
    wait_for(lambda: recorder.look() == 0.0)
    assert recorder.close()
    assert recorder.problem == ""
    assert is_whole(tmp_path / EVENTS_FILE)
    assert len(list(read_events(tmp_path))) == 3


def test_closing_a_record_whose_write_waits_ends_and_names_its_end(
    tmp_path: Path, stuck: Disk, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "CLOSING", 4 * BATCH)
    recorder = Recorder(tmp_path)
    record(recorder)
    assert not recorder.close()
    assert recorder.problem.startswith("the record ends at 0.")
    assert recorder.problem.endswith(" s of the run: its disk has taken nothing for 0.4 s")
    assert recorder.has_ended
    stuck.go_on()
    wait_for(lambda: not recorder._thread.is_alive())
    assert read_ending(tmp_path)["state"] == "failed"
    assert not is_whole(tmp_path / EVENTS_FILE)


def test_a_record_that_waits_too_long_is_given_up_and_takes_no_more_memory(
    tmp_path: Path, stuck: Disk, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "LOST", 4 * BATCH)
    recorder = Recorder(tmp_path)
    record(recorder)
    wait_for(lambda: recorder.look() > module.LOST)
    assert recorder.has_ended
    waiting = recorder._queue.qsize()
    recorder.on_event(StateChanged(9.0, 9, "running", "x"))
    assert recorder._queue.qsize() == waiting
    stuck.go_on()
    recorder.close()
    assert "the record ends at" in recorder.problem


RUN = """
import sys
from pathlib import Path
sys.path.insert(0, {here!r})
from test_stalled import Disk, module
module.STALLED, module.CLOSING = 0.5, 1.0
disk = Disk(begin={begin})
Path.open = lambda path, *arguments, **named: disk.open(path, *arguments, **named)
from pomona.executive.cli import main
sys.exit(main())
"""


def files(folder: Path, required: str, duration: str) -> list[str]:
    tree, cell = folder / "slow.yaml", folder / "bench.yaml"
    tree.write_text(f"pomona: 1\ntree: slow\nroot:\n  wait: {duration}\n")
    cell.write_text(f"name: bench\nkind: mock\nclock: manual\nrecord: {required}\ndevices: {{}}\n")
    return ["run", str(tree), "--cell", str(cell), "--record", str(folder / "runs")]


def run_stuck(
    folder: Path, required: str, duration: str, pace: str
) -> subprocess.CompletedProcess[str]:
    script = RUN.format(here=str(Path(__file__).parent), begin=1)
    words = [*files(folder, required, duration), "--pace", pace]
    command = [sys.executable, "-c", script, *words]
    return subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE)


@pytest.mark.slow
def test_a_run_that_needs_its_record_ends_in_the_safe_state_when_its_disk_takes_nothing(
    tmp_path: Path,
) -> None:
    done = run_stuck(tmp_path, "required", "300 s", "real")
    said = " ".join((done.stdout + done.stderr).split())
    assert done.returncode == 3, said
    assert "safe stop: the disk has taken nothing of the record for 0.5 s" in said
    assert "Traceback" not in said


@pytest.mark.slow
def test_a_run_that_ends_before_its_stuck_disk_is_noticed_is_no_success(tmp_path: Path) -> None:
    done = run_stuck(tmp_path, "required", "1 s", "fast")
    said = " ".join((done.stdout + done.stderr).split())
    assert done.returncode == 3, said
    assert "its disk has taken nothing for 1 s" in said


@pytest.mark.slow
def test_a_run_that_does_not_need_its_record_goes_on_and_warns_once(tmp_path: Path) -> None:
    done = run_stuck(tmp_path, "optional", "2 s", "real")
    said = " ".join((done.stdout + done.stderr).split())
    assert done.returncode == 0, said
    assert said.count("! record: the disk has taken nothing of the record for 0.5 s") == 1


@pytest.mark.parametrize("number", ERRORS)
@pytest.mark.parametrize("begin", [0, 1, 4])
def test_an_error_of_the_disk_ends_a_run_that_needs_its_record_in_the_safe_state(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    number: int,
    begin: int,
) -> None:
    disk = Disk(begin, number)
    monkeypatch.setattr(Path, "open", lambda path, *a, **k: disk.open(path, *a, **k))
    assert main([*files(tmp_path, "required", "2 s"), "--pace", "real", "--json"]) == 3
    said = capsys.readouterr()
    assert json.loads(said.out)["outcome"] in ("stopped", "error")
    assert os.strerror(number) in " ".join(said.err.split())


def test_an_error_that_the_disk_reports_only_when_synchronised_makes_a_needed_record_incomplete(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(_file: int) -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr(os, "fsync", fail)
    for required, status in (("required", 3), ("optional", 0)):
        assert main([*files(tmp_path, required, "100 ms"), "--json"]) == status
    told = json.loads(capsys.readouterr().out.splitlines()[0])
    assert told["reason"]["code"] == "NO_RECORD"
    assert "Input/output error" in told["reason"]["message"]


def test_a_picture_whose_drawing_never_ends_is_not_waited_for(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    never = threading.Event()
    monkeypatch.setattr(session_module, "DRAWING", 0.1)
    monkeypatch.setattr(Picture, "empty", False)
    monkeypatch.setattr(Picture, "save", lambda *_: never.wait())
    assert main([*files(tmp_path, "optional", "100 ms")]) == 0
    assert "the picture is not done within 0.1 s" in " ".join(capsys.readouterr().out.split())
    never.set()


def test_a_finished_record_that_cannot_be_read_in_time_is_no_proof(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    never = threading.Event()
    monkeypatch.setattr(session_module, "READING", 0.1)
    monkeypatch.setattr(session_module, "_unread", lambda *_: never.wait())
    assert main([*files(tmp_path, "required", "100 ms"), "--json"]) == 3
    assert "cannot be read: not done within 0.1 s" in capsys.readouterr().out
    never.set()


def test_a_session_without_a_record_has_no_picture(tmp_path: Path) -> None:
    session = RecordingSession(None, None)  # type: ignore[arg-type]
    session.draw("t")
    assert list(tmp_path.iterdir()) == []


def test_work_in_time_returns_its_result_and_raises_its_error() -> None:
    assert within(PATIENCE, lambda: 7) == 7
    with pytest.raises(ZeroDivisionError):
        within(PATIENCE, lambda: 1 / 0)
    counted = itertools.count()
    assert within(PATIENCE, lambda: next(counted)) == 0
