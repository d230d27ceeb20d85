"""The line of `pomona evidence` and `pomona doctor` about a cell's camera."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from pomona.executive.cli import main
from pomona.executive.values.installation import further_checks
from pomona.tools.caliper.check_records import check
from tests.skills.tools.caliper.recorded_runs import picks_of, runs_of, write_run
from tests.skills.tools.caliper.synthetic import recorded

NO_WIDTH = {"type": "PadTouch", "stamp": 1.0, "width": None, "force": 0.5}
CHANGED = "name: sim\nworkspace: {}\n"


def records(root: Path) -> list[Path]:
    return sorted(root.iterdir())


def test_a_camera_that_is_off_fails_with_numbers_and_advice(tmp_path: Path):
    (line,) = check(records(runs_of(tmp_path, -6e-3, 12)))
    assert not line.ok
    assert "mm to the left of where the cell file has it" in line.found
    assert "(12 picks)" in line.found
    assert "grasps tilted by 30°" in line.found
    assert "calibrate from-picks" in line.advice


def test_a_camera_in_its_place_passes_and_runs_without_touches_give_no_line(tmp_path: Path):
    (line,) = check(records(runs_of(tmp_path / "good", 0.0)))
    assert line.ok
    write_run(tmp_path / "none" / "2026-01-01_10-00-00_pick")
    assert not list(check(records(tmp_path / "none")))
    assert not list(check([]))


def test_each_calibration_is_judged_by_its_own_picks(tmp_path: Path):
    runs_of(tmp_path, 6e-3)
    write_run(tmp_path / "2026-01-02_10-00-00_pick", *picks_of(0.0, 8), cell=CHANGED)
    (line,) = check(records(tmp_path))
    assert not line.ok
    assert "(12 picks)" in line.found
    (newest,) = check(records(tmp_path), "sim")
    assert newest.ok
    assert "(8 picks)" in newest.found
    assert not list(check(records(tmp_path), "none of them"))


def test_a_new_calibration_of_a_cell_ends_the_line(tmp_path: Path):
    runs_of(tmp_path, 6e-3)
    corrected = picks_of(0.0, 8)
    for touches in corrected:
        touches["T_mount_camera"][0][3] = 6e-3
    write_run(tmp_path / "2026-01-02_10-00-00_pick", *corrected)
    (now,) = check(records(tmp_path), "sim")
    assert now.ok
    assert "(8 picks)" in now.found


def test_a_record_that_cannot_be_trusted_is_left_out(tmp_path: Path):
    runs_of(tmp_path, 0.0)
    broken = write_run(tmp_path / "2026-01-02_10-00-00_pick", recorded())
    next(broken.glob("*.mcap")).write_bytes(b"nothing")
    assert [line.ok for line in check(records(tmp_path))] == [True]
    assert [line.ok for line in check(records(tmp_path), "sim")] == [True]


def test_a_gripper_without_a_width_leaves_the_camera_unknown_with_the_reason(tmp_path: Path):
    write_run(
        tmp_path / "2026-01-02_10-00-00_pick",
        recorded() | {"left": None, "right": None, "closed": NO_WIDTH},
    )
    (line,) = check(records(tmp_path))
    assert line.absent
    assert "the gripper reports no width" in line.found


def test_evidence_prints_the_line_and_fails(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    runs = runs_of(tmp_path / "runs", 6e-3)
    assert main(["evidence", str(runs), "--out", str(tmp_path / "out")]) == 1
    assert "✗ camera of sim: The camera sits" in capsys.readouterr().out
    (line,) = json.loads((tmp_path / "out" / "evidence.json").read_text())["checks"]
    assert line["ok"] is False
    assert "Checks of all runs together" in (tmp_path / "out" / "evidence.md").read_text()


def test_a_check_that_cannot_be_loaded_is_a_line_of_its_own(monkeypatch: pytest.MonkeyPatch):
    from importlib.metadata import EntryPoint

    def broken(group: str) -> list[EntryPoint]:
        return [EntryPoint("broken", "pomona.nowhere:check", group)]

    monkeypatch.setattr("pomona.executive.values.installation.entry_points", broken)
    (line,) = further_checks()
    assert not line.ok
    assert "No module named 'pomona.nowhere'" in line.found
