"""A record as messages: the same as the live stream's, whoever wrote the record and however it ended."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from executive.dashboard.messages import encode
from executive.dashboard.record_messages import first_event, record_messages
from executive.dashboard.records import RecordList
from executive.errors import UsageError
from executive.events import Event, NodeChanged, Published, RunEnded, StateChanged
from executive.reasons import Reason
from executive.recording.recorder import Recorder
from executive.views import ImageView, Line2, Points3, SceneView

REASON = Reason("a/b", "JAMMED", 'stuck \u2028 "here"', {"angle": 0.5}, (Reason("c", "X", "y"),))
EVENTS: tuple[Event, ...] = (
    StateChanged(0.0, 0, "running", "started"),
    NodeChanged(0.5, 25, "a/b", "FAILURE", "ä", 2, REASON),
    Published(0.6, 30, "a", "path", SceneView(points=(Points3(np.eye(3)),))),
    RunEnded(1.0, 50, "failure", REASON, 50, 1.0, 2.0, None),
)


def write(folder: Path, events: tuple[Event, ...]) -> Path:
    folder.mkdir()
    recorder = Recorder(folder)
    for event in events:
        recorder.hear(event)
    recorder.close()
    return folder


def test_a_record_gives_the_live_streams_messages(tmp_path: Path) -> None:
    lines = b"".join(record_messages(write(tmp_path / "r", EVENTS))).decode().rstrip("\n").split("\n")
    assert [json.loads(line) for line in lines] == [
        json.loads(encode(event, seq)) for seq, event in enumerate(EVENTS, start=1)
    ]


def test_an_image_comes_back_with_its_drawings_and_size(tmp_path: Path) -> None:
    view = ImageView(np.zeros((48, 64, 3), np.uint8), (Line2(np.eye(2)),), caption="one")
    (line,) = b"".join(record_messages(write(tmp_path / "r", (Published(0.0, 1, "n", "camera", view),)))).splitlines()
    value = json.loads(line)["value"]
    assert value["image"].startswith("data:image/jpeg;base64,")
    assert value["size"] == [64, 48]
    assert len(value["lines"]) == 1


def test_a_record_that_was_cut_off_ends_there(tmp_path: Path) -> None:
    path = write(tmp_path / "r", EVENTS) / "run.mcap"
    whole = path.read_bytes()
    for length in range(8, len(whole), 97):
        path.write_bytes(whole[:length])
        lines = b"".join(record_messages(path.parent)).splitlines()
        assert [json.loads(line)["seq"] for line in lines] == list(range(1, len(lines) + 1))


def test_a_file_that_is_no_record_is_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "r", EVENTS) / "run.mcap"
    path.write_bytes(b"something else entirely")
    with pytest.raises(UsageError, match="not a record"):
        list(record_messages(path.parent))
    assert first_event(path.parent) == {}


def test_the_list_says_how_runs_ended_and_reads_each_once(tmp_path: Path) -> None:
    write(tmp_path / "run_1", EVENTS)
    write(tmp_path / "run_2", EVENTS[:2])
    records = RecordList(tmp_path)
    newest, oldest = records.read()
    assert (newest["run"], newest.get("outcome")) == ("run_2", None)
    assert (oldest["outcome"], oldest["code"]) == ("failure", "JAMMED")
    assert records.read()[0] is newest
