"""Runs of a cell whose picks show that the camera is off."""

from __future__ import annotations

import json
import logging
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pomona.executive.cell.cell_file import CellFile, read_cell_file
from pomona.executive.errors import UsageError
from pomona.executive.execute import RunOrder, admitted
from pomona.tools.caliper.run_view import NOTED
from tests.skills.tools.caliper.recorded_runs import picks_of, write_run
from tests.skills.tools.caliper.synthetic import doubted

CELL = """name: sim
kind: mock
world: {{driver: mock}}
devices:
  arm: {{driver: mock-arm}}
  gripper: {{driver: mock-gripper}}
  fingers: {{driver: mock-fingers}}
  camera: {camera}
  caliper: {{driver: caliper{options}}}
"""
MOUNTED = "{driver: realsense, hand_eye: hand_eye.json}"


class Lab:
    """A cell file, and records of its picks."""

    def __init__(
        self, folder: Path, options: str = "", camera: str = "{driver: mock-camera}"
    ) -> None:
        self.folder, self.runs = folder, folder / "runs"
        self.runs.mkdir()
        self.pose = folder / "hand_eye.json"
        self.pose.write_text(json.dumps({"T_mount_camera": np.eye(4).tolist()}))
        self.path = folder / "cell.yaml"
        self.path.write_text(CELL.format(options=options, camera=camera))

    @property
    def cell(self) -> CellFile:
        return read_cell_file(self.path)

    def pick(self, shift: float, count: int = 12, day: int = 1, **changes: Any) -> None:
        """Record picks of a camera that sits so far to the right [m]."""
        for i, touches in enumerate(picks_of(shift, count)):
            place = self.runs / f"2026-01-{day:02d}_10-00-{i:02d}_pick"
            write_run(place, touches | changes, cell=self.path.read_text())

    def admit(self, **how: Any) -> RunOrder:
        return admitted(RunOrder(Path("tree.yaml"), self.path, record=self.runs, **how), self.cell)


def test_a_cell_without_the_section_is_not_looked_at(tmp_path: Path):
    lab = Lab(tmp_path)
    lab.path.write_text(lab.path.read_text().replace("  caliper: {driver: caliper}\n", ""))
    lab.pick(30e-3)
    assert lab.admit().speed == 1.0


def test_first_picks_are_slow_and_three_good_ones_end_that(tmp_path: Path):
    lab = Lab(tmp_path)
    assert lab.admit().speed == 0.1
    lab.pick(0.0, 2)
    assert lab.admit().speed == 0.1
    lab.pick(0.0, 6, day=2)
    assert lab.admit().speed == 1.0
    assert lab.admit(speed=0.5).speed == 0.5


@pytest.mark.parametrize(
    ("shift", "speed", "warned"),
    [(4e-3, 1.0, True), (7e-3, 0.3, True), (9e-3, 0.1, True), (0.0, 1.0, False)],
)
def test_a_camera_that_is_off_is_warned_of_and_then_makes_runs_slow(
    tmp_path: Path, shift: float, speed: float, warned: bool, caplog: pytest.LogCaptureFixture
):
    lab = Lab(tmp_path)
    lab.pick(shift)
    with caplog.at_level(logging.WARNING):
        assert lab.admit().speed == speed
    assert ("mm to the right of where the cell file has it" in caplog.text) is warned


def test_farther_off_a_run_needs_somebody_who_has_looked(tmp_path: Path):
    lab = Lab(tmp_path)
    lab.pick(14e-3)
    with pytest.raises(UsageError, match=r"cell.yaml:9.*(?s:.)*`--cleared` confirms"):
        lab.admit()
    assert lab.admit(cleared=True).speed == 0.1


def test_farthest_off_no_run_begins(tmp_path: Path):
    lab = Lab(tmp_path, ", refuse: 12 mm")
    lab.pick(14e-3)
    with pytest.raises(UsageError, match=r"14\.\d ± .* mm to the right (?s:.)*No run begins"):
        lab.admit(cleared=True)


def test_picks_of_another_cell_file_or_of_another_pose_count_for_nothing(tmp_path: Path):
    lab = Lab(tmp_path, camera=MOUNTED)
    lab.pick(30e-3)
    lab.path.write_text(lab.path.read_text() + "# a comment discards nothing\n")
    with pytest.raises(UsageError, match="No run begins"):
        lab.admit()
    lab.path.write_text(
        lab.path.read_text().replace("hand_eye.json}", "hand_eye.json, silence: 1 s}")
    )
    assert lab.admit().speed == 0.1
    moved = np.eye(4)
    moved[0, 3] = 1e-3
    lab.pick(30e-3, day=2, T_mount_camera=moved.tolist())
    assert lab.admit().speed == 0.1


def test_runs_of_another_cell_in_between_hide_nothing(tmp_path: Path):
    lab = Lab(tmp_path)
    lab.pick(14e-3)
    write_run(
        lab.runs / "2026-02-01_10-00-00_pick",
        picks_of(0.0, 1)[0],
        cell="name: other\n",
        name="other",
    )
    with pytest.raises(UsageError, match="--cleared"):
        lab.admit()


def test_looks_that_show_a_turn_alone_prove_no_place_and_the_run_stays_slow(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
):
    lab = Lab(tmp_path)
    error = np.array(
        [*[0.0] * 3, *np.radians([1.7, 0.0, 0.0]), *[0.0] * 2]
    )  # 4.5 mm at 0.15 m, below `slow`
    looks = [doubted(error + 1e-7 * i) for i in range(3)]
    write_run(
        lab.runs / "2026-01-01_10-00-00_pick",
        *looks,
        cell=lab.path.read_text(),
        topic="doubted_look",
    )
    with caplog.at_level(logging.WARNING):
        assert (
            lab.admit().speed == 0.1
        )  # at full speed, the fingers of such a cell pressed with 27 N
    assert "is turned by 1.7 ± 0." in caplog.text
    assert "10 % (`first_speed`)" in caplog.text


def test_a_record_is_read_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    lab = Lab(tmp_path)
    lab.pick(7e-3)
    assert lab.admit().speed == 0.3
    assert all((run / NOTED).is_file() for run in lab.runs.iterdir())

    def read(_record: Path) -> Any:
        raise AssertionError("it was read again")

    monkeypatch.setattr("pomona.tools.caliper.records._read", read)
    assert lab.admit().speed == 0.3


def test_a_note_that_is_not_of_its_record_is_not_used(tmp_path: Path):
    lab = Lab(tmp_path)
    lab.pick(7e-3)
    lab.admit()
    for run in lab.runs.iterdir():
        note = json.loads((run / NOTED).read_text())
        (run / NOTED).write_text(json.dumps(note | {"of": [1, 2], "touches": []}))
    assert lab.admit().speed == 0.3


def test_a_note_that_was_edited_is_not_used(tmp_path: Path):
    lab = Lab(tmp_path)
    lab.pick(7e-3)
    lab.admit()
    for k, run in enumerate(lab.runs.iterdir()):
        note = json.loads((run / NOTED).read_text())
        edited = (
            {"touches": 5} if k == 0 else {"touches": [["pick", 5]]} if k == 1 else {"touches": []}
        )
        (run / NOTED).write_text(json.dumps(note | edited))
    assert lab.admit().speed == 0.3
