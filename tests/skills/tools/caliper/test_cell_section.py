"""Limits of a camera's error in a cell file."""

from __future__ import annotations

from pathlib import Path

import pytest

from pomona.executive.cell.cell_file import read_cell_file
from pomona.executive.cell.errors import CellFileError
from pomona.tools.caliper.cell_section import caliper_of

DEVICES = """name: sim
kind: mock
world: {driver: mock}
devices:
  arm: {driver: mock-arm}
  gripper: {driver: mock-gripper}
  fingers: {driver: mock-fingers}
  camera: {driver: mock-camera}
"""


def written(folder: Path, text: str) -> Path:
    place = folder / "cell.yaml"
    place.write_text(text)
    return place


def test_limits_stand_in_the_cell_file_with_defaults(tmp_path: Path):
    cell = read_cell_file(written(tmp_path, DEVICES + "  caliper: {driver: caliper, warn: 1 mm}\n"))
    said = caliper_of(cell)
    assert said is not None
    assert (said.values.warn, said.values.refuse) == (1e-3, 0.02)
    assert caliper_of(read_cell_file(written(tmp_path, DEVICES))) is None


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ("slow: 1 mm", "below 'warn' of 2 mm"),
        ("refuse: 9 mm", "below 'ask' of 10 mm"),
        ("self_calibration: apply", "self_calibration"),
        ("warn: 2", "unit"),
        ("warn: 0 mm", "0.5 mm"),
        ("first_speed: 0", "0.1"),
        ("worn: 2 mm", "warn"),
    ],
)
def test_a_wrong_limit_is_refused_at_its_place(tmp_path: Path, options: str, why: str):
    with pytest.raises(CellFileError, match=why) as caught:
        read_cell_file(
            written(tmp_path, DEVICES + f"  caliper:\n    driver: caliper\n    {options}\n")
        )
    assert caught.value.line == 11
    assert caught.value.column >= 5


def test_a_second_section_is_refused(tmp_path: Path):
    with pytest.raises(CellFileError, match="a cell has one caliper"):
        read_cell_file(
            written(tmp_path, DEVICES + "  one: {driver: caliper}\n  two: {driver: caliper}\n")
        )


@pytest.mark.parametrize(
    ("lacking", "name"), [("gripper", "gripper"), ("camera", "camera"), ("fingers", "force finger")]
)
def test_a_cell_without_looks_or_fingers_cannot_have_it(tmp_path: Path, lacking: str, name: str):
    text = "".join(
        line for line in DEVICES.splitlines(keepends=True) if f"  {lacking}:" not in line
    )
    with pytest.raises(CellFileError, match=f"needs a {name} above it"):
        read_cell_file(written(tmp_path, text + "  caliper: {driver: caliper}\n"))
