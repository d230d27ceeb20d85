"""A record as messages: equal to the live stream's, for every writer and every end of the record."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import BinaryIO

import numpy as np
import pytest

from pomona.executive.errors import UsageError
from pomona.executive.images import from_file
from pomona.executive.reasons import Reason
from pomona.executive.recording import overview as thinning, recorder, scan as scanning
from pomona.executive.recording.mcap_file import RawRecord, raw_record_at
from pomona.executive.recording.recorder import Recorder
from pomona.executive.recording.scan import attachment, require_valid, scan
from pomona.executive.running.events import (
    Event,
    NodeChanged,
    PortWritten,
    Published,
    RunEnded,
    StateChanged,
)
from pomona.executive.views import ImageView, Line2, Points3, SceneView, SeriesView
from pomona.tools.dashboard import record_messages as reading
from pomona.tools.dashboard.messages import encode
from pomona.tools.dashboard.record_messages import (
    between,
    image,
    moment,
    overview,
    record_messages,
    thumbnail,
)

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
        recorder.on_event(event)
    recorder.close()
    return folder


def test_a_record_gives_the_live_streams_messages(tmp_path: Path) -> None:
    lines = (
        b"".join(record_messages(write(tmp_path / "r", EVENTS))).decode().rstrip("\n").split("\n")
    )
    assert [json.loads(line) for line in lines] == [
        json.loads(encode(event, seq)) for seq, event in enumerate(EVENTS, start=1)
    ]


def test_an_image_comes_back_with_its_drawings_and_size(tmp_path: Path) -> None:
    view = ImageView(np.zeros((48, 64, 3), np.uint8), (Line2(np.eye(2)),), caption="one")
    (line,) = b"".join(
        record_messages(write(tmp_path / "r", (Published(0.0, 1, "n", "camera", view),)))
    ).splitlines()
    value = json.loads(line)["value"]
    assert value["image"].startswith("data:image/jpeg;base64,")
    assert value["size"] == [64, 48]
    assert len(value["lines"]) == 1


def test_a_thumbnail_is_the_newest_image_made_small(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    looks = [
        Published(t, 1, "n", "camera", ImageView(np.full((480, 640, 3), grey, np.uint8)))
        for t, grey in ((0.0, 10), (0.5, 200))
    ]
    pixels = from_file(thumbnail(write(tmp_path / "r", (*looks, *EVENTS))) or b"")
    assert pixels.shape == (96, 128, 3)
    assert abs(float(pixels.mean()) - 200.0) < 2.0
    assert thumbnail(write(tmp_path / "none", EVENTS)) is None
    monkeypatch.setattr(reading, "MOST_FOR_THUMBNAIL", 10)
    assert thumbnail(tmp_path / "r") is None


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


def long_run(ticks: int) -> tuple[Event, ...]:
    """Feedback and samples in every tick, and a result in the middle."""
    events: list[Event] = []
    for tick in range(1, ticks):
        t = tick * 0.02
        status = "RUNNING" if tick < ticks // 2 else "SUCCESS"
        events.append(NodeChanged(t, tick, "a", status, f"at {tick}", 1))
        events.append(
            Published(
                t, tick, "a", "grip", SeriesView(np.array([t]), {"force [N]": np.array([1.0])})
            )
        )
    return (*events, RunEnded(ticks * 0.02, ticks, "success", None, ticks, ticks * 0.02, 2.0, None))


@pytest.fixture(params=["made when recorded", "made when read"])
def small(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Records of a few events count as long ones, with and without an overview in them."""
    for module in (reading, thinning, recorder):
        for name, value in (("WHOLE", 10), ("WHOLE_BYTES", 10), ("PARTS", 20)):
            monkeypatch.setattr(module, name, value, raising=False)
    if request.param == "made when read":
        monkeypatch.setattr(recorder, "WHOLE_BYTES", 1e9)
    return str(request.param)


def test_a_long_record_is_thinned_for_the_eye_and_no_result_is_lost(
    tmp_path: Path, small: str
) -> None:
    folder = write(tmp_path / "r", long_run(400))
    made = attachment(folder / "run.mcap", thinning.OVERVIEW, require_valid(folder / "run.mcap"))
    assert (made is not None) == (small == "made when recorded")
    note, *messages = (
        json.loads(line) for line in b"".join(overview(folder, "/images/")).splitlines()
    )
    assert note == {
        "v": 1,
        "event": "Overview",
        "interval": pytest.approx(0.8),
    }  # doubled until all fits
    assert [m["seq"] for m in messages] == sorted(m["seq"] for m in messages)
    changes = [m for m in messages if m["event"] == "NodeChanged"]
    assert len(changes) < 14
    assert (
        next(m["tick"] for m in changes if m["status"] == "SUCCESS") == 200
    )  # where it changed, to the tick
    assert changes[-1]["feedback"] == "at 399"  # and what was said last
    assert len([m for m in messages if m["event"] == "Published"]) <= 11
    assert messages[-1]["event"] == "RunEnded"


@pytest.mark.usefixtures("small")
def test_no_peak_of_a_long_record_is_lost(tmp_path: Path) -> None:
    force, slip = np.zeros(1000), np.full(1000, np.nan)
    force[333], force[334], slip[500:503] = 99.0, -7.0, (1.0, 2.0, 0.5)
    events = [
        Published(
            t,
            tick,
            "a",
            "grip",
            SeriesView(np.array([t - 0.004, t - 0.002]) + 100.0, {"force [N]": f, "slip [mm]": s}),
        )
        for tick in range(500)
        for t, f, s in [
            (tick * 0.02, force[2 * tick : 2 * tick + 2], slip[2 * tick : 2 * tick + 2])
        ]
    ]
    folder = write(tmp_path / "r", tuple(events))
    lines = b"".join(overview(folder, "/images/")).splitlines()
    thinned = [m["value"] for m in map(json.loads, lines) if m["event"] == "Published"]
    assert 10 <= len(thinned) <= 20
    assert sum(value["thinned"] for value in thinned if "thinned" in value) >= 996
    peak = next(value for value in thinned if 99.0 in value["values"]["force [N]"])
    assert peak["values"]["force [N]"] == [99.0, -7.0]  # as they came
    slips = [
        v["values"]["slip [mm]"] for v in thinned if "thinned" in v and "slip [mm]" in v["values"]
    ]
    assert slips == [[2.0, 0.5]]
    assert all(value["t"][0] <= value["t"][-1] and value["t"][0] > 99.0 for value in thinned)


def test_a_stretch_of_a_record_is_whole(tmp_path: Path) -> None:
    folder = write(tmp_path / "r", long_run(100))
    messages = [
        json.loads(line) for line in b"".join(between(folder, "/images/", 0.5, 0.6)).splitlines()
    ]
    assert [m["tick"] for m in messages if m["event"] == "NodeChanged"] == [25, 26, 27, 28, 29, 30]


def test_an_image_stays_behind_until_it_is_asked_for(tmp_path: Path) -> None:
    view = ImageView(np.zeros((48, 64, 3), np.uint8))
    folder = write(tmp_path / "r", (Published(0.0, 1, "n", "camera", view),))
    (line,) = b"".join(overview(folder, "/images/")).splitlines()
    value = json.loads(line)["value"]
    assert value["size"] == [64, 48]
    at = value["image"].removeprefix("/images/")
    found = image(folder, at)
    assert found is not None
    assert found.startswith(b"\xff\xd8")
    for wrong in ("", "0", "0-1", "0--1", "1-0", f"{10**30}-0", "a-b", "0-0-0"):
        assert image(folder, wrong) is None


@pytest.mark.usefixtures("small")
@pytest.mark.parametrize("chunk", [2_000, 65_536])
def test_how_things_stand_is_read_with_the_moment_and_not_with_the_overview(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, chunk: int
) -> None:
    monkeypatch.setattr(recorder, "CHUNK_BYTES", chunk)
    events: list[Event] = []
    for n in range(30):
        picture = ImageView(np.full((8, 8 + 8 * n, 3), n, np.uint8))
        events += [
            NodeChanged(n * 1.0, n, "n", "RUNNING", "looks", n),
            Published(n * 1.0, n, "n", "camera", picture),
            PortWritten(n * 1.0, n, "n/seen", "fruit " * n, "n", ""),
        ]
    folder = write(tmp_path / "r", tuple(events))
    note, *messages = (
        json.loads(line) for line in b"".join(overview(folder, "/images/")).splitlines()
    )
    assert note["interval"] == pytest.approx(1.6)
    assert {message["event"] for message in messages} == {"NodeChanged"}
    for begin in np.arange(0.0, 29.0, 0.7):
        found = [
            json.loads(line)
            for line in b"".join(moment(folder, "/images/", begin, begin + 2.0)).splitlines()
        ]
        assert [m["seq"] for m in found] == sorted(m["seq"] for m in found)
        for t in (begin, begin + 1.0):
            look = [
                m
                for m in found
                if m["t"] <= t and m["event"] == "Published" and m["topic"] == "camera"
            ][-1]
            assert look["tick"] == int(t)
            assert look["value"]["size"] == [8 + 8 * int(t), 8]
            assert image(folder, look["value"]["image"].removeprefix("/images/")) is not None
            port = [m for m in found if m["t"] <= t and m["event"] == "PortWritten"][-1]
            assert (port["tick"], port["value"]) == (int(t), "fruit " * int(t))


def test_a_part_of_a_record_is_found_without_reading_the_rest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recorder, "CHUNK_BYTES", 2_000)
    path = write(tmp_path / "r", long_run(300)) / "run.mcap"
    whole = path.read_bytes()
    everything = [json.loads(line) for line in b"".join(record_messages(path.parent)).splitlines()]
    chunks = require_valid(path).chunks
    assert chunks is not None
    read: list[int] = []

    def counted(stream: BinaryIO, at: int, size: int | None = None) -> RawRecord:
        read.append(at)
        return raw_record_at(stream, at, size)

    monkeypatch.setattr(scanning, "raw_record_at", counted)
    for length in (len(whole), len(whole) * 2 // 3):  # the second one has no index
        path.write_bytes(whole[:length])
        list(record_messages(path.parent))
        read.clear()
        found = [
            json.loads(line)
            for line in b"".join(between(path.parent, "/images/", 1.0, 1.1)).splitlines()
        ]
        assert found == [message for message in everything if 1.0 <= message["t"] <= 1.1]
        assert len(found) == 12
        if length == len(whole):
            assert 1 <= len(set(read) & {chunk.at for chunk in chunks}) < len(chunks) / 5


def test_the_index_leads_to_the_same_messages_as_reading_record_by_record(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recorder, "CHUNK_BYTES", 2_000)
    path = write(tmp_path / "r", long_run(300)) / "run.mcap"
    verdict = require_valid(path)
    assert verdict.chunks
    everything = list(scan(path, verdict))
    assert len(everything) > 600
    assert everything == list(scan(path, replace(verdict, chunks=None, topics={})))
    numbers = [found.sequence for found in everything if found.topic == "/events"]
    assert numbers == list(range(1, 600))
    some = list(
        scan(path, verdict, topics="/events".__eq__, begin=1_000_000_000, end=2_000_000_000)
    )
    assert some == [
        found for found in everything if found.topic == "/events" and 1e9 <= found.stamp <= 2e9
    ]


@pytest.mark.parametrize(
    "forged",
    [
        b"",
        b"[]\n",
        b'{"interval": NaN}\n',
        b'{"interval": 1.0}\n[1,2\n',
        b'{"interval": -1}\n',
        b"\xff\xfe\n",
        b"[" * 9_000,
    ],
)
def test_an_overview_that_is_none_is_made_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, small: str, forged: bytes
) -> None:
    monkeypatch.setattr(thinning.Overview, "lines", lambda _self: iter([forged or b"\n"]))
    folder = write(tmp_path / "r", long_run(400))
    monkeypatch.undo()
    monkeypatch.setattr(reading, "WHOLE_BYTES", 10)
    lines = [json.loads(line) for line in b"".join(overview(folder, "/images/")).splitlines()]
    assert [line["seq"] for line in lines] == list(range(1, 800)), small
