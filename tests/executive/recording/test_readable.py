"""A written record can be read: the writer refuses the same as the reader, and a required one is read once."""

from __future__ import annotations

import errno
import json
import os
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fake_runs import make

from pomona.executive.cli import main
from pomona.executive.reasons import Reason
from pomona.executive.recording import recorder as recorder_module
from pomona.executive.recording.digest import digest
from pomona.executive.recording.folder import EVENTS_FILE, why_cut
from pomona.executive.recording.read import read_events
from pomona.executive.recording.recorder import Recorder
from pomona.executive.recording.session import RecordingSession
from pomona.executive.registry import Registry
from pomona.executive.running.events import (
    ErrorRaised,
    Event,
    NodeChanged,
    PortWritten,
    Published,
    RunEnded,
    RunStarted,
    StateChanged,
)
from pomona.executive.skill import Skill, Work
from pomona.executive.views import ImageView, Line2, PosesView, SceneView, SeriesView

ANY: Any = 5  # stands where a text is expected


class Evil:
    """Raises at every access."""

    def __str__(self) -> str:
        raise SystemExit("evil")

    __repr__ = __iter__ = __float__ = __array__ = __str__


def pixels(*shape: int) -> ImageView:
    return ImageView(np.zeros(shape, np.uint8))


STARTED = RunStarted(
    0.0, 0, "r", "t", "t.yaml", "", "", "c", "mock", "c.yaml", "", 0, {}, (), {}, 1.0, 0.02
)  # fmt: skip
LOST = Reason("a/Look", "LOST", ANY)
LABELLED = ImageView(None, (Line2(np.zeros((2, 2)), ANY),))
FLAT = PosesView(np.zeros(3), np.zeros(3))
UNEVEN = SeriesView(np.arange(3.0), {"f [N]": np.arange(2.0)})
AFTER = StateChanged(0.6, 8, "succeeded", "")
UNREADABLE: dict[str, tuple[Event, str]] = {
    "a feedback": (NodeChanged(0.5, 7, "a/Look", "RUNNING", ANY, 1), "NodeChanged of a/Look"),
    "a reason's message": (NodeChanged(0.5, 7, "a/Look", "FAILURE", "", 1, LOST), "NodeChanged of a/Look"),
    "a value's sentence": (PortWritten(0.5, 7, "/fruit", 1, "a/Look", ANY), "'/fruit' of a/Look"),
    "a topic": (Published(0.5, 7, "a/Look", ANY, 1), "a published value of a/Look"),
    "a caption": (Published(0.5, 7, "a/Look", "scene", SceneView(caption=ANY)), "'scene' of a/Look"),
    "a label": (Published(0.5, 7, "a/Look", "seen", LABELLED), "'seen' of a/Look"),
    "an empty image": (Published(0.5, 7, "a/Look", "seen", pixels(0, 0, 3)), "'seen' of a/Look"),
    "an image with two channels": (Published(0.5, 7, "a/Look", "seen", pixels(8, 8, 2)), "'seen' of a/Look"),
    "poses that are none": (Published(0.5, 7, "a/Look", "robot", FLAT), "'robot' of a/Look"),
    "samples of two lengths": (Published(0.5, 7, "a/Look", "grip", UNEVEN), "'grip' of a/Look"),
    "a value that raises": (Published(0.5, 7, "a/Look", "evil", Evil()), "'evil' of a/Look"),
    "an end": (RunEnded(0.5, 7, "success", None, 7, 0.5, 0.5, {"score": Evil()}), "RunEnded of the run"),
}  # fmt: skip


@pytest.mark.parametrize("what", UNREADABLE)
def test_an_unreadable_event_stands_as_an_error_that_names_it(tmp_path: Path, what: str) -> None:
    event, name = UNREADABLE[what]
    recorder = Recorder(tmp_path)
    recorder.on_event(event)
    recorder.on_event(AFTER)
    recorder.close()
    told, after = read_events(tmp_path)
    assert isinstance(told, ErrorRaised)
    assert (told.t, told.tick, told.error) == (0.5, 7, "UnencodableError")
    assert told.message.startswith(f"{name} cannot be encoded: "), told.message
    assert after == AFTER
    assert recorder.problem == f"the record lacks an event at 0.50 s of the run: {told.message}"
    assert not recorder.has_ended or recorder._whole


def test_a_value_above_the_readers_limit_is_refused_with_both_sizes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recorder_module, "MOST_MESSAGE", 2_000_000)
    recorder = Recorder(tmp_path)
    recorder.on_event(Published(0.5, 7, "a/Look", "big", "x" * 3_000_000))
    recorder.on_event(AFTER)
    recorder.close()
    told, _after = read_events(tmp_path)
    assert isinstance(told, ErrorRaised)
    assert (
        told.message == "'big' of a/Look cannot be encoded: 3 MB of text; at most 2 MB are recorded"
    )


def test_readings_that_are_none_are_an_error_and_not_the_end_of_the_record(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path)
    recorder.read(0.5, 7, {"arm": {"q_1_rad": [0.1], "q_2_rad": [0.1, 0.2]}})
    recorder.on_event(AFTER)
    recorder.close()
    told, after = read_events(tmp_path)
    assert isinstance(told, ErrorRaised)
    assert told.message.startswith("measurements of the run cannot be encoded: ")
    assert after == AFTER


def wait_until(holds: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 60.0  # of a busy machine
    while not holds():
        assert time.monotonic() < deadline
        os.sched_yield()


def test_a_record_that_is_cut_while_it_is_written_is_missed(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path)
    path = tmp_path / EVENTS_FILE
    recorder.on_event(StateChanged(0.0, 0, "running", "x" * 500))
    wait_until(lambda: path.stat().st_size > 500)
    os.truncate(path, 100)
    recorder.on_event(AFTER)
    recorder.close()
    assert "its file was cut to 100 bytes while it was written, from" in recorder.problem
    assert "it could not be written: its file was cut to 100 bytes" in why_cut(tmp_path)


def test_a_process_without_handles_still_writes_why_its_record_ends(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorder = Recorder(tmp_path)

    def none_left(*_arguments: object, **_named: object) -> None:
        raise OSError(errno.EMFILE, os.strerror(errno.EMFILE))

    with monkeypatch.context() as patched:
        patched.setattr(Path, "open", none_left)
        patched.setattr(Path, "write_bytes", none_left)
        recorder.on_event(RunEnded(0.5, 7, "success", None, 7, 0.5, 0.5, None))
        recorder.close()
    assert "Too many open files" in recorder.problem
    assert why_cut(tmp_path) == "it could not be written: Too many open files"


@pytest.mark.parametrize("t", [1e13, 1e308])
def test_a_time_that_no_run_has_is_refused_in_a_short_sentence(tmp_path: Path, t: float) -> None:
    ended = RunEnded(0.5, 7, "success", None, 7, 0.5, 0.5, None)
    recorder = Recorder(tmp_path)
    for event in (STARTED, replace(ended, time=t)):
        recorder.on_event(event)
    recorder.close()
    told = [event for event in read_events(tmp_path) if isinstance(event, ErrorRaised)]
    assert [event.message for event in told] == [
        f"RunEnded of the run cannot be encoded: an event RunEnded cannot be read: '{t}' stands where a number is "
        "expected, 1e+12 at most"
    ]
    assert digest(tmp_path).state == "cut off"


SHORT = "pomona: 1\ntree: short\nroot: {wait: 100 ms}\n"


def run_required(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> tuple[int, dict[str, Any]]:
    tree, cell = tmp_path / "short.yaml", tmp_path / "bench.yaml"
    tree.write_text(SHORT)
    cell.write_text("name: bench\nkind: mock\nclock: manual\nrecord: required\ndevices: {}\n")
    status = main(
        ["run", str(tree), "--cell", str(cell), "--record", str(tmp_path / "runs"), "--json"]
    )
    return status, json.loads(capsys.readouterr().out.splitlines()[-1])


def test_a_required_record_that_is_whole_is_a_success(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status, told = run_required(tmp_path, capsys)
    assert (status, told["outcome"]) == (0, "success")


def change_a_byte(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (change_a_byte, "cannot be read"),
        (lambda path: os.truncate(path, path.stat().st_size - 9), "the finished record is cut off"),
        (
            lambda path: path.write_bytes(b""),
            "the finished record is cut off and contains no end instead of success",
        ),
        (lambda path: path.unlink(), "cannot be read"),
    ],
)
def test_a_required_record_that_is_damaged_once_it_is_closed_makes_an_error_of_a_success(
    damage: Callable[[Path], object],
    words: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    close = RecordingSession.close

    def close_and_damage(session: RecordingSession) -> str:
        problem = close(session)
        assert session.folder is not None
        assert digest(session.folder).state == "ended"
        damage(session.folder / EVENTS_FILE)
        return problem

    monkeypatch.setattr(RecordingSession, "close", close_and_damage)
    status, told = run_required(tmp_path, capsys)
    assert (status, told["outcome"], told["reason"]["code"]) == (3, "error", "NO_RECORD")
    assert words in told["reason"]["message"]


class Mumble(Skill):
    """Set its feedback as py_trees' own behaviours do, to an object that is no text."""

    def run(self) -> Work[None]:
        self.feedback_message = ANY
        yield None
        return {}  # type: ignore[return-value]


class Yielding(Skill):
    """Yield an object that is no text."""

    def run(self) -> Work[None]:
        yield ANY
        return {}  # type: ignore[return-value]


class Failing(Skill):
    """Fail with an object that is no text."""

    failures = ("LOST",)

    def run(self) -> Work[None]:
        yield None
        raise self.failure("LOST", ANY)


@pytest.mark.parametrize(
    ("skill", "words"),
    [
        ("Mumble", "t: its feedback is no text but 5 (int)"),
        ("Yielding", "t: its feedback is no text but 5 (int)"),
        ("Failing", "Failing: the message of LOST is no text but int"),
    ],
)
def test_a_skill_whose_words_are_no_text_ends_the_run_and_is_named(
    tmp_path: Path, skill: str, words: str
) -> None:
    recorder = Recorder(tmp_path)
    skills = Registry({"Mumble": Mumble, "Yielding": Yielding, "Failing": Failing})
    runner, cell, _events = make(
        f"pomona: 1\ntree: t\nroot: {{{skill}: {{}}}}\n", skills, listeners=[recorder.on_event]
    )
    result = runner.run()
    recorder.close()
    assert (result.outcome, cell.latched) == ("error", words)
    assert recorder.problem == ""
    assert [e.message for e in read_events(tmp_path) if isinstance(e, ErrorRaised)] == [words]
