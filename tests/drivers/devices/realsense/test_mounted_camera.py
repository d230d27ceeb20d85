"""Foreign files of the camera's pose."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from pomona.devices.realsense.mounted_camera import UnusableHandEye, read_hand_eye


def changed(row: int, column: int, number: float) -> str:
    T = np.eye(4)
    T[row, column] = number
    return json.dumps({"T_mount_camera": T.tolist()})


def test_a_rigid_pose_is_read(tmp_path: Path) -> None:
    path = tmp_path / "hand_eye.json"
    path.write_text(changed(0, 3, 0.05))
    assert read_hand_eye(path)[0, 3] == 0.05


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{}",
        "[" * 100_000,
        '{"T_mount_camera": "up"}',
        '{"T_mount_camera": [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}',
        changed(0, 3, float("nan")),
        changed(1, 3, float("inf")),
        changed(2, 3, 53.0),
        changed(0, 0, -1.0),
        changed(3, 0, 0.1),
        changed(0, 0, float("nan")),
    ],
    ids=[
        "empty",
        "no pose",
        "deep",
        "words",
        "3 x 3",
        "NaN",
        "infinite",
        "millimetres",
        "mirror",
        "scale",
        "no turn",
    ],
)
def test_a_file_that_holds_no_pose_is_refused_in_words(text: str, tmp_path: Path) -> None:
    path = tmp_path / "hand_eye.json"
    path.write_text(text)
    with pytest.raises(UnusableHandEye, match=r"hand_eye\.json"):
        read_hand_eye(path)


def test_a_file_of_two_gigabytes_is_not_read_whole(tmp_path: Path) -> None:
    path = tmp_path / "hand_eye.json"
    with path.open("wb") as stream:
        stream.truncate(2 << 30)  # sparse: it takes no room
    with pytest.raises(UnusableHandEye, match="Larger than"):
        read_hand_eye(path)
