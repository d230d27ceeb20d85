"""Exports of a record: files, images and tables; and deleted records."""

from __future__ import annotations

import argparse
import csv
import json
import zipfile
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from recorded_events import FAILED, SUCCEEDED, contents, everything, record, write

from pomona.devices.frames.folder import folder_intrinsics, list_frames, read_images
from pomona.executive.errors import UsageError
from pomona.executive.recording.digest import Digest
from pomona.executive.recording.folder import EVENTS_FILE, find_record
from pomona.executive.recording.read import read_events
from pomona.executive.recording.recorder import Recorder
from pomona.tools.library.export import export
from pomona.tools.library.extract import extract
from pomona.tools.library.prune import AGE, SIZE, choose, remove


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    made = tmp_path / "runs" / "2026-01-01_pick"
    made.mkdir(parents=True)
    record(made, everything())
    return made


# ------------------------------------------------------------------------------------------------- export


def test_a_zip_unpacks_to_the_record_it_was(folder: Path, tmp_path: Path) -> None:
    export(folder, tmp_path / "out.zip")
    with zipfile.ZipFile(tmp_path / "out.zip") as archive:
        archive.extractall(tmp_path / "elsewhere")
    there = find_record("last", tmp_path / "elsewhere")
    assert there.name == "2026-01-01_pick"
    assert (there / EVENTS_FILE).read_bytes() == (folder / EVENTS_FILE).read_bytes()
    assert (there / "tree.yaml").read_text() == "pomona: 1\n"


def test_json_lines_hold_every_event(folder: Path, tmp_path: Path) -> None:
    export(folder, tmp_path / "out.jsonl")
    events = [json.loads(line) for line in (tmp_path / "out.jsonl").read_text().splitlines()]
    assert [event["event"] for event in events] == [type(event).__name__ for event in everything()]


def test_an_mcap_is_indexed_and_compressed_with_the_same_content(
    folder: Path, tmp_path: Path
) -> None:
    export(folder, tmp_path / "out.mcap")
    with (tmp_path / "out.mcap").open("rb") as stream:
        reader = make_reader(stream)
        summary = reader.get_summary()
        assert summary is not None
        assert summary.chunk_indexes
        assert {attachment.name for attachment in reader.iter_attachments()} == {
            "tree.yaml",
            "cell.yaml",
            "look.yaml",
        }
    key = str
    assert sorted(contents(tmp_path / "out.mcap"), key=key) == sorted(
        contents(folder / EVENTS_FILE), key=key
    )
    assert len(list(read_events(tmp_path / "out.mcap"))) == len(everything())


def test_an_export_replaces_nothing(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "out.zip").write_text("mine")
    with pytest.raises(UsageError, match="exists, and nothing"):
        export(folder, tmp_path / "out.zip")
    assert (tmp_path / "out.zip").read_text() == "mine"
    with pytest.raises(UsageError, match="No such file"):
        export(folder, tmp_path / "nowhere" / "out.zip")


@pytest.mark.parametrize("ending", ["zip", "jsonl", "mcap"])
def test_a_foreign_file_is_not_exported(tmp_path: Path, ending: str) -> None:
    (tmp_path / EVENTS_FILE).write_text("not an mcap file at all")
    with pytest.raises(UsageError, match="not a record"):
        export(tmp_path, tmp_path / f"out.{ending}")
    assert not (tmp_path / f"out.{ending}").exists()


# ------------------------------------------------------------------------------------------------ extract


def test_a_cell_of_recorded_frames_reads_extracted_frames(folder: Path, tmp_path: Path) -> None:
    extract(folder, tmp_path / "out")
    (frame,) = list_frames(tmp_path / "out" / "frames")
    intrinsics = folder_intrinsics(tmp_path / "out" / "frames")
    assert intrinsics is not None
    assert (intrinsics.fx, intrinsics.cy) == (60.0, 23.5)
    colour, depth = read_images(frame, intrinsics)
    assert np.abs(colour.astype(int) - (200, 40, 30)).max() <= 8  # JPEG
    np.testing.assert_allclose(depth[1:], 0.750, atol=1e-6)
    (about,) = json.loads((tmp_path / "out" / "frames" / "frames.json").read_text())
    assert about["t"] == 0.2
    assert about["T_base_camera"][0][3] == 0.3


def test_measurements_and_paths_are_tables_and_lines(folder: Path, tmp_path: Path) -> None:
    written = extract(folder, tmp_path / "out")
    assert set(written) == {"frames/", "paths.json", "arm.csv", "series_grip.csv"}
    with (tmp_path / "out" / "arm.csv").open() as stream:
        assert list(csv.DictReader(stream)) == [
            {"stamp_s": "0.1", "q_1_rad": "0.0"},
            {"stamp_s": "0.2", "q_1_rad": "0.5"},
        ]
    planned, executed = json.loads((tmp_path / "out" / "paths.json").read_text())
    assert (planned["label"], planned["points"]) == ("planned path", np.eye(3).tolist())
    assert (executed["label"], executed["times"]) == ("executed", [0.1])


def test_nothing_is_extracted_over_existing_files(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "mine").write_text("")
    with pytest.raises(UsageError, match="exists and is not empty"):
        extract(folder, tmp_path / "out")


# -------------------------------------------------------------------------------------------------- prune

DAY = 86400.0


def many(count: int) -> list[Digest]:
    """Newest first, one a day, a megabyte each."""
    return [Digest(f"run_{k}", wall_time=(100 - k) * DAY, bytes=1_000_000) for k in range(count)]


def test_records_go_by_age_number_and_size() -> None:
    runs, now = many(5), 100.5 * DAY
    assert list(choose(runs, older=2 * DAY, now=now)) == ["run_2", "run_3", "run_4"]
    assert list(choose(runs, keep=4, now=now)) == ["run_4"]
    assert list(choose(runs, total=3e6, now=now)) == ["run_3", "run_4"]
    assert list(choose(runs, keep=4, total=3e6, now=now)) == ["run_3", "run_4"]


def test_a_run_that_is_going_on_never_goes(tmp_path: Path) -> None:
    running = Digest("run", state="running", wall_time=DAY, bytes=10**12)
    assert choose([running], older=1.0, keep=1, total=1.0, now=100 * DAY) == {}
    (tmp_path / "run").mkdir()
    recorder = Recorder(tmp_path / "run")
    assert remove(tmp_path / "run").endswith("stays: a run writes it")
    recorder.close()
    assert remove(tmp_path / "run") == ""
    assert not (tmp_path / "run").exists()


def test_a_record_elsewhere_is_only_let_go(tmp_path: Path) -> None:
    elsewhere = write(tmp_path / "elsewhere" / "one", SUCCEEDED)
    (tmp_path / "runs").mkdir()
    (tmp_path / "runs" / "one").symlink_to(elsewhere)
    assert remove(tmp_path / "runs" / "one") == ""
    assert (elsewhere / EVENTS_FILE).is_file()


def test_ages_and_sizes_carry_units() -> None:
    assert AGE.option("30 d") == 30 * DAY
    assert AGE.option("1.5h") == 5400.0
    assert SIZE.option("20 GB") == 20e9
    problems = {
        "30": "lacks a unit",
        "d": "is not an age",
        "-3 d": "must be at least 0 d",
        "3 days": "no unit of age",
    }
    for text, problem in problems.items():
        with pytest.raises(argparse.ArgumentTypeError, match=problem):
            AGE.option(text)


# --------------------------------------------------------------------------------------------------- find


def test_a_run_is_found_by_path_file_beginning_and_last(tmp_path: Path) -> None:
    for name in ("2026-01-01_a", "2026-01-02_b"):
        write(tmp_path / name, FAILED)
    export(tmp_path / "2026-01-01_a", tmp_path / "a.mcap")
    assert find_record("last", tmp_path).name == "2026-01-02_b"
    assert find_record("2026-01-01", tmp_path).name == "2026-01-01_a"
    assert (
        find_record(str(tmp_path / "2026-01-01_a" / EVENTS_FILE), tmp_path / "x")
        == tmp_path / "2026-01-01_a"
    )
    assert find_record(str(tmp_path / "a.mcap"), tmp_path) == tmp_path / "a.mcap"


def test_an_unknown_run_is_named_with_those_like_it(tmp_path: Path) -> None:
    for name in ("2026-01-01_a", "2026-01-02_b"):
        write(tmp_path / name, FAILED)
    with pytest.raises(UsageError, match="did you mean 2026-01-01_a, 2026-01-02_b"):
        find_record("2026-01-0", tmp_path)
    with pytest.raises(UsageError, match="pomona runs list"):
        find_record("nonsense", tmp_path)
    with pytest.raises(UsageError, match="no records in"):
        find_record("last", tmp_path / "nowhere")
