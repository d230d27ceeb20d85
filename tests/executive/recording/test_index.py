"""The index agrees with the records, after any damage."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from recorded_events import FAILED, SUCCEEDED, write

from pomona.executive.cli import main
from pomona.executive.recording import index as index_module
from pomona.executive.recording.folder import EVENTS_FILE, hash_of
from pomona.executive.recording.index import INDEX_FILE, RunIndex
from pomona.executive.recording.picture import Picture
from pomona.executive.recording.recorder import Recorder
from pomona.executive.running.events import Published
from pomona.executive.views import SeriesView


@pytest.fixture
def runs(tmp_path: Path) -> Path:
    write(tmp_path / "2026-01-01_failed", FAILED)
    write(tmp_path / "2026-01-02_succeeded", SUCCEEDED)
    return tmp_path


def test_an_entry_holds_outcome_codes_durations_hashes_and_commit(runs: Path) -> None:
    newest, oldest = RunIndex(runs).read()
    assert (newest.outcome, newest.code, newest.time, newest.wall) == ("success", None, 1.5, 0.2)
    assert (oldest.outcome, oldest.code, oldest.message) == (
        "failure",
        "NO_PATH",
        "there is no path",
    )
    assert oldest.codes == {"NO_PATH": 2}
    assert oldest.attempts == 1
    assert oldest.tree_hash == "abc"
    assert oldest.cell_hash == hash_of("name: sim\n")
    assert oldest.git == "0123abc"
    assert oldest.settings == {"fruit": "apple_5"}
    assert oldest.truth == {"lifted": False}
    assert (oldest.account, newest.account) == ({"count": 2}, None)
    assert RunIndex(runs).read() == [newest, oldest]  # from the file


def test_a_clock_that_was_set_back_does_not_make_the_newest_run_an_old_one(tmp_path: Path) -> None:
    for name in ("2026-01-05_first", "2026-01-02_second", "2025-12-31_third"):
        write(tmp_path / name, SUCCEEDED)
    assert [run.run[11:] for run in RunIndex(tmp_path).read()] == ["third", "second", "first"]


def test_a_record_is_read_once_and_again_only_when_it_changed(
    runs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    read: list[str] = []
    digest = index_module.digest
    monkeypatch.setattr(
        index_module, "digest", lambda record: read.append(record.name) or digest(record)
    )
    assert len(RunIndex(runs).read()) == 2
    assert len(RunIndex(runs).read()) == 2
    assert sorted(read) == ["2026-01-01_failed", "2026-01-02_succeeded"]
    path = runs / "2026-01-01_failed" / EVENTS_FILE
    path.write_bytes(path.read_bytes()[:-100])
    RunIndex(runs).read()
    assert read[2:] == ["2026-01-01_failed"]


def test_records_that_come_and_go_are_seen(runs: Path) -> None:
    index = RunIndex(runs)
    index.read()
    write(runs / "2026-01-03_new", FAILED)
    for path in (runs / "2026-01-02_succeeded").iterdir():
        path.unlink()
    assert [run.run for run in index.read()] == ["2026-01-03_new", "2026-01-01_failed"]


def test_foreign_cut_off_and_empty_records_are_listed_as_such(runs: Path) -> None:
    for name, content in {"a_foreign": b"not an mcap file at all", "b_empty": b""}.items():
        (runs / name).mkdir()
        (runs / name / EVENTS_FILE).write_bytes(content)
    write(runs / "c_cut", FAILED[:3])
    entries = {run.run: run for run in RunIndex(runs).read()}
    assert entries["a_foreign"].state == "unreadable"
    assert "not a record" in (entries["a_foreign"].message or "")
    assert entries["b_empty"].state == "cut off"
    assert (entries["c_cut"].state, entries["c_cut"].outcome, entries["c_cut"].tree) == (
        "cut off",
        None,
        "pick",
    )


@pytest.mark.parametrize("content", [b"", b"\x00\xff" * 50, b"[1]", b'{"version": 0}', b"{" * 900])
def test_an_index_that_is_none_is_made_again(runs: Path, content: bytes) -> None:
    before = RunIndex(runs).read()
    good = (runs / INDEX_FILE).read_bytes()
    (runs / INDEX_FILE).write_bytes(content)
    index = RunIndex(runs)
    assert index.read() == before
    assert index.problem == ""
    assert (runs / INDEX_FILE).read_bytes() == good


@pytest.mark.parametrize(
    "change",
    [
        {"codes": [1, 2]}, {"codes": {"NO_PATH": "two"}}, {"settings": {"a": 1}}, {"truth": 7}, {"account": 7},
        {"seed": "three"}, {"wall_time": "noon"}, {"state": 7}, {"picture": 5}, {"outcome": ["success"]},
        {"unknown": 1, "run": None},
    ],
)  # fmt: skip
def test_an_entry_with_anything_in_it_is_read_from_its_record(
    runs: Path, change: dict[str, object]
) -> None:
    before = RunIndex(runs).read()
    content = json.loads((runs / INDEX_FILE).read_text())
    for _stamp, about in content["runs"].values():
        about |= change
    (runs / INDEX_FILE).write_text(json.dumps(content))
    assert RunIndex(runs).read() == before


def test_an_index_that_cannot_be_written_does_not_hide_the_runs(
    runs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_arguments: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(index_module, "replace_file", refuse)
    index = RunIndex(runs)
    assert len(index.read()) == 2
    assert index.problem.endswith("cannot be written: No space left on device")


def test_a_folder_that_is_not_there_holds_no_runs(tmp_path: Path) -> None:
    assert RunIndex(tmp_path / "nowhere").read() == []
    assert not (tmp_path / "nowhere").exists()


def test_every_run_has_its_largest_measured_values(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    recorder = Recorder(tmp_path / "a")
    for k, force in enumerate(([1.0, 7.5], [np.nan, 3.0], [np.nan, np.nan])):
        view = SeriesView(
            np.arange(2) * 0.002 + k,
            {"force [N]": np.array(force), "slip [mm]": np.array([-2.0, -1.0])},
        )
        recorder.on_event(Published(k * 1.0, k, "n", "grip", view))
    recorder.close()
    (found,) = RunIndex(tmp_path).read()
    assert found.peaks == {"force [N]": 7.5, "slip [mm]": -1.0}
    assert list(found.peaks) == ["force [N]", "slip [mm]"]


def test_a_run_that_failed_deep_down_in_its_tree_has_ended_with_the_reason(tmp_path: Path) -> None:
    node = '{check: "1 > 2"}'
    for _ in range(12):
        node = f"{{fallback: [{{sequence: [{node}], retry: 1}}]}}"
    (tmp_path / "deep.yaml").write_text(f"pomona: 1\ntree: deep\nroot: {node}\n")
    (tmp_path / "bench.yaml").write_text("name: bench\nkind: mock\nclock: manual\ndevices: {}\n")
    files = [str(tmp_path / name) for name in ("deep.yaml", "bench.yaml", "runs")]
    assert main(["run", files[0], "--cell", files[1], "--record", files[2], "--quiet"]) == 1
    (run,) = RunIndex(tmp_path / "runs").read()
    assert (run.state, run.outcome, run.code) == ("ended", "failure", "CONDITION_FALSE")
    assert run.message is not None
    assert "1 > 2" in run.message


def test_a_picture_that_cannot_be_drawn_is_reported_and_leaves_the_run_unchanged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def save(*_arguments: object) -> None:
        raise ValueError("a view of no shape")

    monkeypatch.setattr(Picture, "empty", False)
    monkeypatch.setattr(Picture, "save", save)
    (tmp_path / "t.yaml").write_text("pomona: 1\ntree: t\nroot: {wait: 100 ms}\n")
    (tmp_path / "bench.yaml").write_text("name: bench\nkind: mock\nclock: manual\ndevices: {}\n")
    words = [
        "run",
        str(tmp_path / "t.yaml"),
        "--cell",
        str(tmp_path / "bench.yaml"),
        "--record",
        str(tmp_path / "runs"),
    ]
    assert main(words) == 0
    said = capsys.readouterr()
    assert "the picture cannot be drawn: a view of no shape" in " ".join(
        (said.out + said.err).split()
    )
    assert RunIndex(tmp_path / "runs").read()[0].outcome == "success"
