"""`pomona check` of calibrations."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from pomona.executive.cli import main

OWN = "fx: 615 px\nfy: 615 px\ncx: 318 px\ncy: 241 px\nwidth: 640\nheight: 480\n"
POSE = np.eye(4).tolist()


@pytest.mark.parametrize("text", [OWN, json.dumps({"T_mount_camera": POSE, "looks": 12})])
def test_a_calibration_of_its_own_is_right(tmp_path: Path, text: str) -> None:
    path = tmp_path / "file.yaml"
    path.write_text(text)
    assert main(["check", str(path)]) == 0


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (
            OWN.replace("fx: 615", "fx: 6"),
            ":1:5: error[value]: fx: it is 6 px in an image of 640 px: is it in mm?",
        ),
        (json.dumps({"T_mount_camera": [[1.0]]}), "error[value]: 'T_mount_camera' in "),
        (
            "cam0:\n  rostopic: /a\n",
            ":1:1: error[foreign]: this is a chain of cameras of Kalibr, and no file of Pomona",
        ),
        ("%YAML:1.0\n---\nimage_width: 1\n", "this is a file of OpenCV's FileStorage, and no YAML"),
    ],
)
def test_a_wrong_or_foreign_one_is_named_as_what_it_is(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, text: str, expected: str
) -> None:
    path = tmp_path / "file.yaml"
    path.write_text(text)
    assert main(["check", str(path)]) == 2
    said = capsys.readouterr().out
    assert expected in said
    assert "tree" not in said.replace("trees/cells", "")
