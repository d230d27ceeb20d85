"""Corrections of a camera's pose file, and the step back."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pomona.executive.cli import main
from pomona.executive.errors import UsageError
from pomona.tools.caliper.self_calibration import NotApplied, apply, before_of, read_pose, undo

MOST, TURNED = 0.015, 0.035


def moved(x: float) -> list[list[float]]:
    T = np.eye(4)
    T[0, 3] = x
    return T.tolist()


def pose_file(folder: Path) -> Path:
    place = folder / "hand_eye.json"
    place.write_text(json.dumps({"T_mount_camera": moved(0.0), "looks": 12}))
    return place


def proposal(start: float, end: float, *runs: str) -> dict[str, Any]:
    return {"T_mount_camera": moved(end), "T_mount_camera_before": moved(start), "runs": list(runs)}


def x_of(place: Path) -> float:
    return float(read_pose(place)[1][0, 3])


def test_a_correction_keeps_the_file_before_it(tmp_path: Path):
    place = pose_file(tmp_path)
    apply(place, proposal(0.0, 0.006, "run 1"), MOST, TURNED)
    assert x_of(place) == 0.006
    assert read_pose(before_of(place))[0]["looks"] == 12
    assert json.loads(place.read_text())["runs"] == ["run 1"]
    assert not list(tmp_path.glob(".*"))


def test_one_step_takes_it_back_and_its_picks_lead_to_none_again(tmp_path: Path):
    place = pose_file(tmp_path)
    apply(place, proposal(0.0, 0.006, "run 1"), MOST, TURNED)
    undo(place)
    assert x_of(place) == 0.0
    with pytest.raises(NotApplied, match="run 1 was undone"):
        apply(place, proposal(0.0, 0.006, "run 1", "run 2"), MOST, TURNED)
    apply(place, proposal(0.0, 0.006, "run 3"), MOST, TURNED)
    assert x_of(place) == 0.006
    undo(place)
    undo(place)
    assert x_of(place) == 0.006


def test_the_target_of_a_link_is_corrected_and_the_link_stays(tmp_path: Path):
    target, link = pose_file(tmp_path), tmp_path / "camera.json"
    link.symlink_to(target.name)
    apply(link, proposal(0.0, 0.006, "run 1"), MOST, TURNED)
    assert link.is_symlink()
    assert (x_of(target), x_of(before_of(link))) == (0.006, 0.0)
    undo(link)
    assert (link.is_symlink(), x_of(target)) == (True, 0.0)


def test_a_file_that_was_calibrated_anew_is_not_taken_back_to_a_pose_of_old(tmp_path: Path):
    place = pose_file(tmp_path)
    apply(place, proposal(0.0, 0.006, "run 1"), MOST, TURNED)
    place.write_text("\ufeff" + json.dumps({"T_mount_camera": moved(0.02)}), encoding="utf-8")
    with pytest.raises(
        UsageError, match=r"another calibration .* hand_eye.json.before is not of this one"
    ):
        undo(place)
    assert (x_of(place), x_of(before_of(place))) == (0.02, 0.0)


def test_several_corrections_do_not_pass_the_bounds_together(tmp_path: Path):
    place = pose_file(tmp_path)
    apply(place, proposal(0.0, 0.010, "run 1"), MOST, TURNED)
    with pytest.raises(NotApplied, match=r"20\.0 mm"):
        apply(place, proposal(0.010, 0.020, "run 2"), MOST, TURNED)
    assert x_of(place) == 0.010


def test_picks_of_another_pose_correct_nothing(tmp_path: Path):
    place = pose_file(tmp_path)
    with pytest.raises(NotApplied, match="another pose"):
        apply(place, proposal(0.001, 0.006, "run 1"), MOST, TURNED)
    assert not before_of(place).exists()


def test_a_turn_beyond_its_bound_is_not_written(tmp_path: Path):
    place = pose_file(tmp_path)
    c, s = np.cos(0.05), np.sin(0.05)
    turned = [[c, -s, 0.0, 0.0], [s, c, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
    with pytest.raises(NotApplied, match=r"2\.9°"):
        apply(place, proposal(0.0, 0.0, "run 1") | {"T_mount_camera": turned}, MOST, TURNED)


def test_a_read_only_file_is_neither_corrected_nor_taken_back(tmp_path: Path):
    place = pose_file(tmp_path)
    apply(place, proposal(0.0, 0.006, "run 1"), MOST, TURNED)
    place.chmod(0o444)
    with pytest.raises(NotApplied, match="read-only: `chmod"):
        apply(place, proposal(0.006, 0.008, "run 2"), MOST, TURNED)
    with pytest.raises(NotApplied, match="read-only"):
        undo(place)
    assert (x_of(place), x_of(before_of(place))) == (0.006, 0.0)


@pytest.mark.parametrize(
    ("content", "why"),
    [
        (None, "cannot be read: No such file"),
        ("{}", "holds no 'T_mount_camera'"),
        ("[1, 2", "holds no 'T_mount_camera'"),
        (json.dumps({"T_mount_camera": moved(0.0), "undone": 5}), "holds no"),
        (json.dumps({"T_mount_camera": moved(0.0), "runs": 5}), "holds no"),
        (
            json.dumps({"T_mount_camera": moved(0.0), "T_mount_camera_first": [[2.0]]}),
            "_first' in .* is no rigid",
        ),
        (json.dumps({"T_mount_camera": [[1.0] * 4] * 4}), "is no rigid"),
        (
            json.dumps({"T_mount_camera": moved(0.0), "T_mount_camera_before": 1}),
            "_before' in .* is no rigid",
        ),
    ],
)
def test_a_file_that_is_missing_or_was_edited_is_refused_with_the_reason(
    tmp_path: Path, content: str | None, why: str
):
    place = tmp_path / "hand_eye.json"
    if content is not None:
        place.write_text(content)
    with pytest.raises(UsageError, match=why):
        apply(place, proposal(0.0, 0.006, "run 1"), MOST, TURNED)
    assert [path.name for path in tmp_path.iterdir()] == (
        [] if content is None else ["hand_eye.json"]
    )


def test_the_command_takes_back_and_refuses_a_file_without_a_correction(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    place = pose_file(tmp_path)
    assert main(["calibrate", "undo-picks", str(place)]) == 2
    assert "no correction that could be taken back" in capsys.readouterr().err
    apply(place, proposal(0.0, 0.006, "run 1"), MOST, TURNED)
    assert main(["calibrate", "undo-picks", str(place)]) == 0
    assert x_of(place) == 0.0
