"""A simulated cell whose camera is 8 mm off notices, corrects itself between two runs, and takes the step back."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from pomona.devices.emulators.connect import camera_site
from pomona.executive.cli import main
from pomona.executive.files import find_cell
from pomona.executive.recording.folder import EVENTS_FILE
from pomona.tools.caliper.records import Picks

OFF = 8e-3  # across the picture [m]
MOST_RUNS = 9  # runs until the camera is corrected
AFTER = 2  # runs with the corrected camera


class Cell:
    """The simulated cell with a pose file for its camera, and records of its runs."""

    def __init__(self, folder: Path) -> None:
        self.runs, self.pose, self.path = (
            folder / "runs",
            folder / "hand_eye.json",
            folder / "cell.yaml",
        )
        trees, text = find_cell("sim").parents[1], find_cell("sim").read_text("utf-8")
        text = text.replace("{include: shared/", f"{{include: {trees}/cells/shared/").replace(
            "../", f"{trees}/"
        )
        text = text.replace(
            "driver: sim-camera\n", "driver: sim-camera\n    hand_eye: hand_eye.json\n"
        )
        section = "caliper: {driver: caliper, self_calibration: apply, first_speed: 1}"
        self.path.write_text(f"{text}  {section}\n", "utf-8")
        self.write(np.eye(4))

    def write(self, T: np.ndarray) -> None:
        self.pose.write_text(json.dumps({"T_mount_camera": T.tolist()}), "utf-8")

    def stated(self) -> np.ndarray:
        return np.array(json.loads(self.pose.read_text("utf-8"))["T_mount_camera"])

    def pick(self, number: int) -> tuple[int, float]:
        """Pick one fruit; return the exit status and the distance of the first touch from the measured skin [m]."""
        settings = (f"fruit=apple_{(1, 4, 5)[number % 3]}", f"place={1 + number % 5}")
        where = [
            "--cell",
            str(self.path),
            "--record",
            str(self.runs),
            "--seed",
            str(number),
            "--json",
        ]
        status = main(
            ["run", "pick_apple", *where, *(word for one in settings for word in ("--set", one))]
        )
        read = Picks()
        read.add(max(path.parent for path in self.runs.glob(f"*/{EVENTS_FILE}")))
        firsts = [abs(pick.first) for pick in read.picks if pick.side and not pick.landed]
        return status, firsts[-1] if firsts else np.nan


@pytest.mark.long
def test_a_cell_that_is_8_mm_off_corrects_itself_picks_better_and_takes_it_back(tmp_path: Path):
    cell = Cell(tmp_path)
    true = camera_site(find_cell("sim").parents[1] / "robots" / "sia5f_wsg32.xml")
    wrong = true.copy()
    wrong[:3, 3] -= OFF * true[:3, 0]
    cell.write(wrong)
    before, after = [], []
    while len(before) < MOST_RUNS and np.array_equal(cell.stated(), wrong):
        before.append(cell.pick(len(before)))
    assert not np.array_equal(cell.stated(), wrong), f"no correction after {before}"
    first = before.pop()  # this run has the corrected pose already
    across, down, _ = true[:3, :3].T @ (cell.stated()[:3, 3] - true[:3, 3])
    assert np.hypot(across, down) < 0.4 * OFF
    after = [first, *(cell.pick(MOST_RUNS + k) for k in range(AFTER))]
    assert all(status == 0 for status, _ in after)
    assert np.nanmedian([way for _, way in after]) < 0.5 * np.nanmedian([way for _, way in before])
    assert main(["calibrate", "undo-picks", str(cell.pose)]) == 0
    np.testing.assert_allclose(cell.stated(), wrong, atol=1e-12)
    cell.pick(MOST_RUNS + AFTER)
    np.testing.assert_allclose(
        cell.stated(), wrong, atol=1e-12
    )  # the same runs never lead to it again
