"""How a command's process begins and ends: its streams, its exit status, and what it leaves behind."""

from __future__ import annotations

import argparse
import io
import os
import signal
import sys
import threading
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest

from pomona.executive import cli
from pomona.executive.running.compute import COMPUTING


def raises(error: BaseException) -> Callable[..., int]:
    def run(*_arguments: Any) -> int:
        raise error

    return run


# ------------------------------------------------------------------------------------------------- exit status


def test_a_package_that_is_not_installed_is_named_with_the_command_for_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(cli, "_run", raises(ModuleNotFoundError("no", name="rosbags.highlevel")))
    assert cli._main(["export"]) == 2
    assert "the package rosbags.highlevel is not installed; run: " in capsys.readouterr().err


@pytest.mark.parametrize("name", ["pomona.tools.gone", "pomona", None])
def test_a_part_of_pomona_that_is_missing_is_a_mistake_of_ours(
    monkeypatch: pytest.MonkeyPatch, name: str | None
) -> None:
    monkeypatch.setattr(cli, "_run", raises(ModuleNotFoundError("no", name=name)))
    with pytest.raises(ModuleNotFoundError):
        cli._main(["run"])


def test_ctrl_c_is_one_line_with_what_it_interrupted_and_130(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    ended = KeyboardInterrupt()
    ended.add_note("the camera was being opened")
    monkeypatch.setattr(cli, "_run", raises(ended))
    assert cli._main(["run"]) == cli.INTERRUPTED + signal.SIGINT == 130
    assert capsys.readouterr().err == (
        "interrupted from the keyboard. the camera was being opened\n"
    )


@pytest.fixture
def refused(monkeypatch: pytest.MonkeyPatch) -> Callable[[BaseException], int]:
    def run(error: BaseException) -> int:
        options = argparse.Namespace(main=raises(error))
        parser = SimpleNamespace(parse_known_args=lambda _words: (options, []))
        monkeypatch.setattr(cli, "make_parser", lambda _names: parser)
        return cli._run(["run"])

    return run


def test_a_reader_that_has_gone_is_status_1_and_a_file_that_fails_is_named(
    refused: Callable[[BaseException], int], capsys: pytest.CaptureFixture[str]
) -> None:
    assert refused(BrokenPipeError()) == 1
    assert capsys.readouterr().err == ""
    assert refused(OSError(28, "No space left on device", "runs/a")) == 2
    assert capsys.readouterr().err == "runs/a: No space left on device\n"
    with pytest.raises(OSError, match="no file in sight"):
        refused(OSError("no file in sight"))


@pytest.mark.parametrize(("words", "name"), [
    ([], ""), (["run", "pick"], "run"), (["--skill", "A=b", "run", "pick"], "run"),
    (["--skill", "A=b", "--skill", "C=d", "check"], "check"), (["--skill", "run"], ""),
])  # fmt: skip
def test_the_command_comes_after_the_options_of_all(words: list[str], name: str) -> None:
    assert cli._command(words) == name


# ------------------------------------------------------------------------------------------------- streams


def test_a_missing_stream_is_opened_and_any_sign_is_printed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    narrow = io.TextIOWrapper(io.BytesIO(), encoding="ascii")
    careful = io.TextIOWrapper(io.BytesIO(), encoding="ascii", errors="replace")
    asked: list[tuple[str, int]] = []

    def fstat(number: int) -> None:
        if number == 1:
            raise OSError("closed")

    with monkeypatch.context() as patch:
        patch.setattr(sys, "stdin", None)
        patch.setattr(sys, "stdout", narrow)
        patch.setattr(sys, "stderr", careful)
        patch.setattr(os, "fstat", fstat)
        patch.setattr(os, "open", lambda path, flags: asked.append((path, flags)))
        patch.setattr(os, "fdopen", lambda number, mode, **about: (number, mode, about))
        cli._complete_streams()
        assert sys.stdin == (0, "r", {"encoding": "utf-8", "closefd": False})
    assert asked == [(os.devnull, os.O_RDWR)]
    assert (narrow.errors, careful.errors) == ("backslashreplace", "replace")


def test_output_that_nobody_reads_goes_nowhere(monkeypatch: pytest.MonkeyPatch) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    with os.fdopen(writing, "w") as broken:
        broken.write("rest")
        with monkeypatch.context() as patch:
            patch.setattr(sys, "stdout", broken)
            cli._leave_quietly()
        assert os.readlink(f"/proc/self/fd/{writing}") == os.devnull
        broken.flush()


# ------------------------------------------------------------------------------------------------- leftovers


def test_threads_for_which_python_waits_are_named() -> None:
    release = threading.Event()
    threads = [
        threading.Thread(target=release.wait, name=name, daemon=daemon)
        for name, daemon in (("a skill's", False), ("a daemon's", True))
    ]
    for thread in threads:
        thread.start()
    try:
        found = cli._left()
    finally:
        release.set()
        for thread in threads:
            thread.join()
    assert "a skill's" in found
    assert not {"a daemon's", threading.main_thread().name} & set(found)


class Child:
    daemon = False
    name = "worker-1"
    killed = 0

    def kill(self) -> None:
        self.killed += 1


class End:
    """The end of a process, as it happens: what is waited for, reported, printed, and the status."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.happened: list[Any] = []
        self.left: list[str] = []
        self.child = Child()
        happened = self.happened

        class Event:
            def wait(self, seconds: float) -> None:
                happened.append(("waits", seconds))

        class Thread:
            def __init__(self, target: Callable[[], None], name: str, daemon: bool) -> None:
                assert (name, daemon) == ("pomona-end", True)
                self.start = target

        shown = SimpleNamespace(Event=Event, Thread=Thread)
        monkeypatch.setattr(cli, "threading", shown)
        monkeypatch.setattr(cli, "_left", lambda: list(self.left))
        monkeypatch.setattr(cli, "_children", lambda: [self.child])
        monkeypatch.setattr(cli, "report_end", lambda status: happened.append(("told", status)))
        monkeypatch.setattr(cli, "_print_error", happened.append)
        monkeypatch.setattr(cli, "within", lambda _seconds, work: work())
        monkeypatch.setattr(os, "_exit", lambda status: happened.append(("exits", status)))


@pytest.fixture
def end(monkeypatch: pytest.MonkeyPatch) -> End:
    return End(monkeypatch)


def test_a_command_without_leftovers_ends_as_python_does(end: End) -> None:
    cli._end_without([], 0, ticking=False)
    assert end.happened == []


def test_leftovers_that_end_in_time_need_no_word(end: End) -> None:
    cli._end_without(["pool"], 0, ticking=False)
    assert end.happened == [("waits", cli.PATIENCE)]
    assert end.child.killed == 0


def test_a_command_that_ticked_a_tree_ends_though_a_foreign_lock_is_held(end: End) -> None:
    cli._end_without([], 3, ticking=True)
    assert end.happened == [
        ("waits", cli.PATIENCE), ("waits", cli.LEAVING - cli.PATIENCE), ("told", 3), ("exits", 3)
    ]  # fmt: skip
    assert end.child.killed == 0


@pytest.mark.parametrize(("status", "named"), [
    (1, f"{COMPUTING} plan, a skill's"), (cli.INTERRUPTED, f"{COMPUTING} plan, a skill's"), (130, "a skill's"),
])  # fmt: skip
def test_what_still_runs_is_named_and_ended_with_the_process(
    end: End, status: int, named: str
) -> None:
    end.left = [f"{COMPUTING} plan", "a skill's"]
    cli._end_without(end.left, status, ticking=False)
    words = f"still running after the end, and ended with the process: {named}"
    assert end.happened == [("waits", cli.PATIENCE), words, ("told", status), ("exits", status)]
    assert end.child.killed == 1


def test_a_computation_that_an_interruption_leaves_needs_no_word(end: End) -> None:
    end.left = [f"{COMPUTING} plan"]
    cli._end_without(end.left, 130, ticking=True)
    assert end.happened == [("waits", cli.PATIENCE), ("told", 130), ("exits", 130)]
