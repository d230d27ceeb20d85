"""A simulated camera that states another pose than its own."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from pomona.executive.cell.cell_file import read_cell_file
from pomona.executive.cell.errors import CellFileError
from pomona.executive.files import find_cell


def cell(folder: Path, pose: str) -> Path:
    """The simulated cell whose camera has the pose of a file."""
    trees, text = find_cell("sim").parents[1], find_cell("sim").read_text("utf-8")
    text = text.replace("{include: shared/", f"{{include: {trees}/cells/shared/").replace(
        "../", f"{trees}/"
    )
    (folder / "hand_eye.json").write_text(pose, "utf-8")
    path = folder / "cell.yaml"
    path.write_text(
        text.replace("driver: sim-camera\n", "driver: sim-camera\n    hand_eye: hand_eye.json\n"),
        "utf-8",
    )
    return path


def test_the_stated_pose_is_that_of_its_file(tmp_path: Path):
    T = np.eye(4)
    T[:3, 3] = 0.1, 0.2, 0.3
    read = read_cell_file(cell(tmp_path, json.dumps({"T_mount_camera": T.tolist()})))
    np.testing.assert_array_equal(read.section.devices["camera"].values.stated(), T)
    assert read_cell_file(find_cell("sim")).section.devices["camera"].values.stated() is None


@pytest.mark.parametrize(
    "pose", ["", "[]", "{}", '{"T_mount_camera": [[1.0]]}', '{"T_mount_camera": "here"}']
)
def test_a_file_without_a_pose_is_refused_with_its_line(tmp_path: Path, pose: str):
    with pytest.raises(
        CellFileError, match=r"(?s)cell\.yaml:\d+:\d+.*holds no pose 'T_mount_camera'"
    ):
        read_cell_file(cell(tmp_path, pose))
