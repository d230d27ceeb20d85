"""Output that nothing reads: no write waits, no signal is lost, the run ends with its own status."""

from __future__ import annotations

import contextlib
import fcntl
import logging
import os
import pty
import signal
import subprocess
import sys
import termios
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TextIO

import pytest
from fake_runs import Turn, make

from pomona.executive.recording.folder import EVENTS_FILE
from pomona.executive.recording.read import read_events
from pomona.executive.registry import Registry
from pomona.executive.running.events import RunEnded, SafeStopped, StateChanged
from pomona.executive.terminal import output as module
from pomona.executive.terminal.live import LiveTree
from pomona.executive.terminal.output import Output, unwaiting_output
from pomona.executive.terminal.screen import Screen
from pomona.executive.values.processes import write_if_read

PATIENCE = 300.0  # of a busy machine [s]
TREE = "pomona: 1\ntree: t\nroot: {repeat: 1000000, sequence: [{wait: 20 ms}, {succeed: {}}]}\n"


def fill(file: int) -> int:
    """Write until a pipe takes no more; returns the number of bytes."""
    os.set_blocking(file, False)
    written = 0
    with contextlib.suppress(BlockingIOError):
        while True:
            written += os.write(file, b"f" * 64)
    os.set_blocking(file, True)
    return written


@pytest.fixture
def pipe() -> Iterator[tuple[int, TextIO]]:
    """A pipe of 4096 bytes, which is full: its reading end, and its writing end as a stream."""
    reading, writing = os.pipe()
    fcntl.fcntl(writing, fcntl.F_SETPIPE_SZ, 4096)
    fill(writing)
    stream = os.fdopen(writing, "w", encoding="utf-8", errors="backslashreplace")
    yield reading, stream
    with contextlib.suppress(OSError):
        os.close(reading)
    with contextlib.suppress(OSError):
        stream.close()


def wait_for(condition: Callable[[], object]) -> None:
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < deadline
        os.sched_yield()


def read(file: int, count: int) -> bytes:
    found = b""
    while len(found) < count:
        found += os.read(file, count - len(found))
    return found


def test_a_full_pipe_gets_everything_in_order_once_it_is_read(pipe: tuple[int, TextIO]) -> None:
    reading, stream = pipe
    output = Output(stream)
    lines = [f"{number:5d} ☐\n" for number in range(2000)]
    for line in lines:
        output.write(line)
        output.flush()
    assert output.is_behind
    assert read(reading, 4096) == b"f" * 4096
    expected = "".join(lines).encode()
    assert read(reading, len(expected)) == expected
    assert output.wait(PATIENCE)
    wait_for(lambda: not output.is_behind)


def test_texts_beyond_the_bound_are_left_out_and_counted(
    pipe: tuple[int, TextIO], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "MOST", 10)
    reading, stream = pipe
    output = Output(stream)
    output.write("first\n")
    wait_for(lambda: output._waiting.empty())  # its thread waits in the write
    for number in range(15):
        output.write(f"{number}\n")
    read(reading, 4096)
    assert output.wait(PATIENCE)
    said = os.read(reading, 4096).decode()
    assert said.startswith("first\n")
    assert "5 texts are left out here: the output was not read" in said
    assert said.endswith("9\n")


def test_a_reader_that_is_gone_shows_in_a_later_write(pipe: tuple[int, TextIO]) -> None:
    reading, stream = pipe
    output = Output(stream)
    output.write("x")
    os.close(reading)
    assert output.wait(PATIENCE)
    with pytest.raises(BrokenPipeError):
        output.write("y")
    with pytest.raises(BrokenPipeError):
        output.flush()


def test_a_pipe_that_another_process_made_non_blocking_loses_nothing(
    pipe: tuple[int, TextIO],
) -> None:
    reading, stream = pipe
    os.set_blocking(stream.fileno(), False)
    output = Output(stream)
    output.write("x" * 10_000)
    assert read(reading, 4096 + 10_000).endswith(b"x" * 10_000)


def test_at_the_end_the_reader_has_a_bounded_time(
    pipe: tuple[int, TextIO], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "ENDING", 0.1)
    reading, stream = pipe
    monkeypatch.setattr(sys, "stdout", stream)
    monkeypatch.setattr(sys, "stderr", stream)
    with unwaiting_output():
        print("never read")
        assert isinstance(sys.stdout, Output)
    assert sys.stdout is stream
    os.set_blocking(reading, False)
    assert read(reading, 4096) == b"f" * 4096


def test_a_forked_child_writes_by_itself(pipe: tuple[int, TextIO]) -> None:
    reading, stream = pipe
    read(reading, 4096)
    output = Output(stream)
    child = os.fork()
    if not child:
        output.write("of the child")
        output.flush()
        os._exit(0)
    os.waitpid(child, 0)
    assert os.read(reading, 4096).endswith(b"of the child")


def test_a_picture_of_the_tree_is_not_drawn_while_the_terminal_has_not_taken_the_last_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    live = LiveTree(Screen())
    drawn: list[Any] = []

    class Drawing:
        is_started = True

        def update(self, text: Any, refresh: bool) -> None:
            drawn.append(text)

    monkeypatch.setattr(live, "_live", Drawing())
    for behind, count in ((True, 0), (False, 1)):
        monkeypatch.setattr(Screen, "is_behind", behind)
        live._drawn = -1e9
        live.on_event(StateChanged(0.0, 0, "running", "started"))
        assert len(drawn) == count


def test_last_words_are_left_out_where_nothing_reads_and_written_where_something_does(
    pipe: tuple[int, TextIO],
) -> None:
    reading, stream = pipe
    write_if_read(stream.fileno(), b"last")
    read(reading, 4096)
    write_if_read(stream.fileno(), b"words")
    assert os.read(reading, 4096) == b"words"
    os.close(reading)
    write_if_read(stream.fileno(), b"more")


def full_pipe() -> tuple[int, int]:
    reading, writing = os.pipe()
    fcntl.fcntl(writing, fcntl.F_SETPIPE_SZ, 4096)
    fill(writing)
    return reading, writing


def stopped_terminal() -> tuple[int, int]:
    ours, theirs = pty.openpty()
    termios.tcflow(theirs, termios.TCOOFF)  # as Ctrl-S
    return ours, theirs


def recorded(folder: Path) -> int:
    """Return the size of the run's record so far [bytes]."""
    return sum(path.stat().st_size for path in folder.glob(f"runs/*/{EVENTS_FILE}"))


def events_of(folder: Path) -> list[Any]:
    (path,) = folder.glob(f"runs/*/{EVENTS_FILE}")
    return list(read_events(path.parent))


@contextlib.contextmanager
def unread_run(
    folder: Path, tree: str, output: int, more: list[str], script: str = ""
) -> Iterator[Any]:
    (folder / "t.yaml").write_text(tree)
    main = "import sys; from pomona.executive.cli import main; sys.exit(main())"
    words = ["run", str(folder / "t.yaml"), "--dry", "--record", str(folder / "runs"), *more]
    command = [sys.executable, "-c", script + main, *words]
    process = subprocess.Popen(command, stdout=output, stderr=output, stdin=subprocess.DEVNULL)
    try:
        yield process
    finally:
        process.kill()
        process.wait()


@pytest.mark.slow
@pytest.mark.parametrize("make", [full_pipe, stopped_terminal])
@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 3)])
def test_a_signal_ends_a_run_whose_output_nothing_reads_in_the_safe_state(
    tmp_path: Path, make: Callable[[], tuple[int, int]], number: int, status: int
) -> None:
    ours, theirs = make()
    with unread_run(tmp_path, TREE, theirs, ["--pace", "real"]) as process:
        wait_for(lambda: recorded(tmp_path) > 100_000)  # the output is some kilobytes then
        process.send_signal(number)
        assert process.wait(PATIENCE) == status
    events = events_of(tmp_path)
    assert any(isinstance(event, SafeStopped) for event in events)
    assert [event.outcome for event in events if isinstance(event, RunEnded)] == ["stopped"]
    os.close(ours)
    os.close(theirs)


@pytest.mark.slow
def test_a_run_whose_output_nothing_reads_ends_by_itself_with_its_status(tmp_path: Path) -> None:
    ours, theirs = full_pipe()
    tree = TREE.replace("1000000", "200")
    with unread_run(tmp_path, tree, theirs, []) as process:
        assert process.wait(PATIENCE) == 0
    assert [event.outcome for event in events_of(tmp_path) if isinstance(event, RunEnded)] == [
        "success"
    ]
    os.close(ours)
    os.close(theirs)


HOLDS_LOGGING = """
import logging, threading
from pomona.executive.recording.session import RecordingSession
begin = RecordingSession.begin
def hold(session, *arguments):
    held = threading.Event()
    def keep():
        for handler in logging.getLogger().handlers:
            handler.acquire()
        logging._lock.acquire()
        held.set()
        threading.Event().wait()
    threading.Thread(target=keep, daemon=True).start()
    held.wait()
    begin(session, *arguments)
RecordingSession.begin = hold
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 3), (None, 0)]
)
def test_a_lock_of_logging_that_a_thread_keeps_does_not_keep_a_run_from_its_end(
    tmp_path: Path, number: int | None, status: int
) -> None:
    tree = TREE if number is not None else TREE.replace("1000000", "20")
    more = ["--pace", "real"] if number is not None else []
    with unread_run(tmp_path, tree, subprocess.DEVNULL, more, HOLDS_LOGGING) as process:
        if number is not None:
            wait_for(lambda: recorded(tmp_path) > 20_000)
            process.send_signal(number)
        assert process.wait(PATIENCE) == status
    outcome = "success" if number is None else "stopped"
    assert [event.outcome for event in events_of(tmp_path) if isinstance(event, RunEnded)] == [
        outcome
    ]


def test_a_fault_needs_no_lock_of_logging() -> None:
    def fail(*_: object) -> None:
        raise RuntimeError("the wheel came off")

    runner, cell, events = make(
        "pomona: 1\ntree: t\nroot: {Turn: {duration: 9 s}}", Registry({"Turn": Turn}), {2: fail}
    )
    logging.root.manager._clear_cache()  # type: ignore[attr-defined]  # whether a level is enabled needs the lock then
    held, free = threading.Event(), threading.Event()

    def keep() -> None:
        with logging._lock:  # type: ignore[attr-defined]
            held.set()
            free.wait()

    keeper = threading.Thread(target=keep)
    keeper.start()
    assert held.wait(PATIENCE)
    try:
        result = runner.run()
    finally:
        free.set()
        keeper.join()
    assert result.outcome == "error"
    assert cell.latched is not None
    assert any(isinstance(event, SafeStopped) for event in events)
