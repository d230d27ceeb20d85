"""Recorder and reader: the output equals the input, also when the file was cut off."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pomona.executive.errors import UsageError
from pomona.executive.reasons import Reason
from pomona.executive.recording import recorder as recorder_module
from pomona.executive.recording.folder import (
    EVENTS_FILE,
    RecordError,
    find_record,
    new_record_folder,
)
from pomona.executive.recording.read import read_events
from pomona.executive.recording.recorder import Recorder
from pomona.executive.running.events import Event, NodeChanged, Published, StateChanged
from pomona.executive.views import ImageView, Line2, SceneView, SeriesView


def record(folder: Path, events: list[Event]) -> None:
    recorder = Recorder(folder)
    for event in events:
        recorder.on_event(event)
    recorder.close()


def test_a_failure_keeps_its_chain_of_reasons(tmp_path: Path) -> None:
    reason = Reason(
        "0", "NO_PATH", "no path", {"nearest": 0.02}, (Reason("0/1", "NO_PATH", "no path"),)
    )
    changed = NodeChanged(1.5, 75, "0", "FAILURE", "no path", 2, reason)
    record(tmp_path, [changed])
    assert list(read_events(tmp_path)) == [changed]


def test_an_image_comes_back_with_its_lines(tmp_path: Path) -> None:
    image = np.full((48, 64, 3), (200, 40, 30), np.uint8)
    outline = np.array([[1.0, 2.0], [np.nan, np.nan], [3.0, 4.0]])
    view = ImageView(image, (Line2(outline, "contour", "refined"),), caption="apple")
    record(tmp_path, [Published(0.1, 5, "0/Detect", "detection", view)])
    (event,) = read_events(tmp_path)
    assert isinstance(event, Published)
    assert np.abs(event.value.image.astype(int) - image).max() <= 8  # JPEG
    np.testing.assert_array_equal(event.value.lines[0].points, outline)
    assert event.value.caption == "apple"


def test_series_and_empty_scenes_come_back(tmp_path: Path) -> None:
    series = SeriesView(np.arange(3.0), {"force [N]": np.array([0.0, 1.0, 2.0])}, {"least": 1.2})
    record(
        tmp_path,
        [Published(0.0, 0, "n", "grip", series), Published(0.0, 0, "n", "scene", SceneView())],
    )
    grip, scene = read_events(tmp_path)
    assert isinstance(grip, Published)
    assert isinstance(scene, Published)
    np.testing.assert_array_equal(grip.value.values["force [N]"], [0.0, 1.0, 2.0])
    assert (scene.value.lines, scene.value.points, scene.value.meshes) == ((), (), ())


def test_a_record_that_was_cut_off_gives_the_events_up_to_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recorder_module, "CHUNK_BYTES", 1000)
    record(tmp_path, [StateChanged(float(i), i, "running", "x" * 200) for i in range(50)])
    path = tmp_path / EVENTS_FILE
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    events = list(read_events(tmp_path))
    assert 10 < len(events) < 50
    assert [event.tick for event in events] == list(range(len(events)))


def test_a_foreign_file_is_refused_in_words(tmp_path: Path) -> None:
    (tmp_path / EVENTS_FILE).write_bytes(b"not an mcap file at all, only text")
    with pytest.raises(UsageError, match="not a record"):
        list(read_events(tmp_path))


def test_two_records_of_one_second_get_two_folders(tmp_path: Path) -> None:
    from datetime import datetime

    now = datetime(2026, 11, 21, 8, 41, 7)
    first, second = (
        new_record_folder(tmp_path, "pick", now),
        new_record_folder(tmp_path, "pick", now),
    )
    assert first.name == "2026-11-21_08-41-07_pick"
    assert second.name == "2026-11-21_08-41-07_pick_2"


def test_a_tree_with_a_very_long_name_has_a_record_too(tmp_path: Path) -> None:
    folder = new_record_folder(tmp_path, "ä" * 300)
    assert folder.is_dir()
    assert folder.name.endswith("_" + "ä" * 60)


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(RecordError, match="cannot make the record's folder"):
        new_record_folder(tmp_path / "file", "pick")


def test_a_record_is_found_by_path_name_and_last(tmp_path: Path) -> None:
    for name in ("2026-01-01_a", "2026-01-02_b"):
        (tmp_path / name).mkdir()
        record(tmp_path / name, [])
    assert find_record("last", tmp_path).name == "2026-01-02_b"
    assert find_record("2026-01-01_a", tmp_path).name == "2026-01-01_a"
    with pytest.raises(UsageError, match="no record 'nowhere'"):
        find_record("nowhere", tmp_path)
