"""Remains after the process is killed, or the disk is full: a real kill, a real limit."""

from __future__ import annotations

import errno
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from mcap.writer import Writer

from pomona.executive.cli import main
from pomona.executive.errors import UsageError
from pomona.executive.recording import recorder as recorder_module
from pomona.executive.recording.digest import digest
from pomona.executive.recording.folder import ENDING_FILE, EVENTS_FILE, is_being_written
from pomona.executive.recording.index import RunIndex
from pomona.executive.recording.read import read_events
from pomona.executive.recording.recorder import Recorder
from pomona.executive.recording.scan import is_whole
from pomona.executive.recording.session import RecordingSession
from pomona.executive.running.events import StateChanged
from pomona.tools.library.repair import repair

pytestmark = pytest.mark.slow

RECORD_FOR_EVER = """
import sys, time
from pathlib import Path
from pomona.executive.running.events import StateChanged
from pomona.executive.recording.recorder import Recorder
recorder = Recorder(Path(sys.argv[1]))
began = time.monotonic()
for tick in range(1_000_000):
    recorder.on_event(StateChanged(time.monotonic() - began, tick, "running", "x" * 500))
    print(tick, flush=True)
    time.sleep(0.01)
"""

LIMITED = """
import resource, sys
sys.dont_write_bytecode = True  # Python itself leaves half a file of compiled code on a full disk
from pomona.executive.cli import main

resource.setrlimit(resource.RLIMIT_FSIZE, (6_000, 6_000))
sys.exit(main(sys.argv[1:]))
"""

TREE = "pomona: 1\ntree: slow\nroot:\n  sequence:\n    - wait: 1 s\n    - wait: 3 s\n"


def kill_a_recording_process(folder: Path) -> int:
    """Kill it after it has recorded an event every 10 ms for a while; the number of the last one handed over."""
    with subprocess.Popen(
        [sys.executable, "-c", RECORD_FOR_EVER, str(folder)], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        last = 0
        for line in process.stdout:
            last = int(line)
            if last == 150:
                break
        process.send_signal(signal.SIGKILL)
        assert process.wait() == -signal.SIGKILL
    return last


def test_a_killed_process_loses_at_most_the_last_second_and_repair_makes_its_record_whole(
    tmp_path: Path,
) -> None:
    folder = tmp_path / "killed"
    folder.mkdir()
    last = kill_a_recording_process(folder)
    path = folder / EVENTS_FILE
    assert not is_whole(path)
    assert not is_being_written(path)  # the system has taken the dead process's lock away
    before = list(read_events(folder))
    assert before[-1].tick > last - 100  # a second's

    done = repair(folder)
    assert done is not None
    assert is_whole(path)
    assert list(read_events(folder)) == before
    assert [event.tick for event in before] == list(range(len(before)))
    assert repair(folder) is None


def test_a_broken_chunk_is_kept_beside_the_repaired_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recorder_module, "CHUNK_BYTES", 500)
    recorder = Recorder(tmp_path)
    for tick in range(20):
        recorder.on_event(StateChanged(0.1 * tick, tick, "running", "x" * 200))
    recorder.close()
    path = tmp_path / EVENTS_FILE
    whole = path.read_bytes()
    path.write_bytes(whole[:5003])
    done = repair(tmp_path)
    assert done is not None
    assert 0 < done.copied.cut < 1500
    tail = path.with_name("run.mcap.tail").read_bytes()
    assert whole[:5003].endswith(tail)
    assert len(tail) == done.copied.cut


@pytest.mark.parametrize("length", [0, 3, 8, 20])
def test_a_file_that_was_killed_at_birth_is_repaired_too(tmp_path: Path, length: int) -> None:
    Recorder(tmp_path).close()
    path = tmp_path / EVENTS_FILE
    path.write_bytes(path.read_bytes()[:length])
    assert list(read_events(tmp_path)) == []
    repair(tmp_path)
    assert is_whole(path)


def test_a_foreign_file_is_not_repaired_and_not_touched(tmp_path: Path) -> None:
    path = tmp_path / EVENTS_FILE
    path.write_bytes(b"something else entirely, and long enough")
    with pytest.raises(UsageError, match="not an MCAP file"):
        repair(tmp_path)
    assert path.read_bytes() == b"something else entirely, and long enough"
    assert list(tmp_path.iterdir()) == [path]


def test_a_run_that_is_going_on_is_seen_and_not_repaired(tmp_path: Path) -> None:
    folder = tmp_path / "now"
    folder.mkdir()
    recorder = Recorder(folder)
    try:
        assert RunIndex(tmp_path).read()[0].state == "running"
        with pytest.raises(UsageError, match="in progress"):
            repair(folder)
    finally:
        recorder.close()
    assert RunIndex(tmp_path).read()[0].state == "cut off"


def run_on_a_full_disk(
    folder: Path, record: str, pace: str = "real"
) -> subprocess.CompletedProcess[str]:
    """A whole run whose record may not become larger than 6 kB."""
    tree, cell, runs = folder / "slow.yaml", folder / "bench.yaml", folder / "runs"
    tree.write_text(TREE)
    cell.write_text(f"name: bench\nkind: mock\nclock: manual\nrecord: {record}\ndevices: {{}}\n")
    arguments = ["run", str(tree), "--cell", str(cell), "--record", str(runs), "--pace", pace]
    return subprocess.run(
        [sys.executable, "-c", LIMITED, *arguments], capture_output=True, text=True, timeout=120
    )


def test_on_a_full_disk_a_run_goes_on_unrecorded_and_reports_it(tmp_path: Path) -> None:
    done = run_on_a_full_disk(tmp_path, "optional")
    said = " ".join((done.stdout + done.stderr).split())
    assert done.returncode == 0, said
    assert "goes on unrecorded" in said
    assert "File too large" in said
    assert "Traceback" not in said
    (folder,) = (tmp_path / "runs").iterdir()
    assert digest(folder).tree == "slow"  # what was written before is there
    assert repair(folder) is not None


def test_on_a_full_disk_a_run_that_needs_its_record_ends_in_the_safe_state(tmp_path: Path) -> None:
    done = run_on_a_full_disk(tmp_path, "required")
    said = " ".join((done.stdout + done.stderr).split())
    assert done.returncode == 3, said
    assert "safe stop: the record ends" in said
    assert "Traceback" not in said


def test_a_record_that_is_needed_and_fails_at_its_end_makes_an_error_of_a_success(
    tmp_path: Path,
) -> None:
    done = run_on_a_full_disk(tmp_path, "required", pace="fast")
    said = " ".join((done.stdout + done.stderr).split())
    assert done.returncode == 3, said
    assert "the record ends at" in said
    assert "File too large" in said
    assert "■ slow" in said


def test_a_record_that_is_removed_while_it_is_written_is_missed(tmp_path: Path) -> None:
    folder = tmp_path / "gone"
    folder.mkdir()
    recorder = Recorder(folder)
    shutil.rmtree(folder)
    deadline = time.monotonic() + 60.0  # of a busy machine
    while not recorder.problem and time.monotonic() < deadline:
        os.sched_yield()
    assert (
        recorder.problem
        == "the record ends at 0.00 s of the run: its file was removed while it was written"
    )
    recorder.close()


def test_a_record_with_another_in_its_place_is_missed(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path)
    (tmp_path / EVENTS_FILE).rename(tmp_path / "moved")
    (tmp_path / EVENTS_FILE).touch()
    recorder.close()
    assert "its file was replaced" in recorder.problem


def test_a_run_whose_needed_record_was_removed_is_an_error_and_names_no_record(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    runs = tmp_path / "runs"
    monkeypatch.setattr(RecordingSession, "draw", lambda _session, _title: shutil.rmtree(runs))
    tree, cell = tmp_path / "short.yaml", tmp_path / "bench.yaml"
    tree.write_text("pomona: 1\ntree: short\nroot: {wait: 100 ms}\n")
    cell.write_text("name: bench\nkind: mock\nclock: manual\nrecord: required\ndevices: {}\n")
    assert main(["run", str(tree), "--cell", str(cell), "--record", str(runs), "--json"]) == 3
    said = capsys.readouterr()
    told = json.loads(said.out.splitlines()[-1])
    assert (told["outcome"], told["reason"]["code"], told["record"]) == ("error", "NO_RECORD", None)
    assert re.search(
        r"the record ends at 0\.[01]0 s", " ".join(said.err.split())
    )  # whenever its thread has seen it


@pytest.mark.parametrize("record", ["required", "optional"])
def test_a_folder_that_cannot_be_made_refuses_a_run(tmp_path: Path, record: str) -> None:
    (tmp_path / "runs").write_text("a file")
    done = run_on_a_full_disk(tmp_path, record, pace="fast")
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert line == (
        f"{tmp_path / 'runs'}: no record can be written there: Not a directory. Nothing was run. "
        "`--record DIR` names another folder, `--no-record` leaves none"
    )
    assert done.stdout == ""


def test_a_record_of_which_nothing_was_written_is_not_named_but_its_loss(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def full(_writer: Writer, profile: str, library: str) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Writer, "start", full)
    tree = tmp_path / "short.yaml"
    tree.write_text("pomona: 1\ntree: short\nroot: {wait: 100 ms}\n")
    runs = tmp_path / "runs"
    words = ["run", str(tree), "--dry", "--record", str(runs)]
    assert main([*words, "--json"]) == 0
    said = capsys.readouterr()
    assert json.loads(said.out.splitlines()[-1])["record"] is None
    assert "the record ends at 0.00 s of the run: No space left on device" in " ".join(
        said.err.split()
    )
    assert main([*words, "--quiet"]) == 0
    assert "No space left on device" in capsys.readouterr().err

    (first, _second) = sorted(path for path in runs.iterdir() if path.is_dir())
    assert (first / EVENTS_FILE).stat().st_size == 0
    for command in (["runs", "list"], ["explain", "last"]):
        assert main([*command, "--record", str(runs)]) == 0
        told = " ".join(capsys.readouterr().out.split())
        assert "could not be written: No space left on device" in told
        assert "killed" not in told
    (first / ENDING_FILE).unlink()
    assert main(["explain", first.name, "--record", str(runs)]) == 0
    assert "empty: nothing was written (full disk?)" in " ".join(capsys.readouterr().out.split())


def test_written_data_are_with_the_system_within_a_moment(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path)
    recorder.on_event(StateChanged(0.0, 0, "running", "started"))
    deadline = time.monotonic() + 60.0  # of a busy machine
    while not list(read_events(tmp_path)) and time.monotonic() < deadline:
        os.sched_yield()
    assert len(list(read_events(tmp_path))) == 1
    recorder.close()
