"""Measurements of a cell's devices reach the record once, in order, with names that carry units."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pomona.drivers.errors import CellFileError
from pomona.executive.cell.cell import Cell
from pomona.executive.cell.connect import load_cell

MOCK = """\
name: bench
kind: mock
clock: manual
{more}
devices: {{}}
"""


@pytest.fixture
def cell() -> Cell:
    return load_cell(Path("trees/cells/sim.yaml"), seed=1)


def test_every_wrench_and_every_ticks_joints_are_read_once(cell: Cell) -> None:
    assert cell.readings() == {}  # listening begins here
    for _ in range(3):
        cell.clock.advance(0.02)
        cell.check()
    readings = cell.readings()
    assert readings["fingers"]["stamp_s"].shape == (30,)  # 500 Hz
    assert np.all(np.diff(readings["fingers"]["stamp_s"]) > 0.0)
    assert list(readings["fingers"])[1:4] == [
        "finger_1_force_x_N",
        "finger_1_force_y_N",
        "finger_1_force_z_N",
    ]
    assert len(readings["fingers"]) == 13
    joints, rates = [f"q_{k}_rad" for k in range(1, 8)], [f"qd_{k}_rad_per_s" for k in range(1, 8)]
    assert list(readings["arm"]) == ["stamp_s", *joints, *rates]
    assert readings["arm"]["q_1_rad"].shape == (3,)
    assert readings["gripper"]["width_m"].shape == (3,)
    assert cell.readings() == {}
    cell.close()


@pytest.mark.parametrize(
    ("more", "required"), [("record: required", True), ("record: optional", False), ("", False)]
)
def test_a_cell_file_states_whether_a_run_needs_its_record(
    tmp_path: Path, more: str, required: bool
) -> None:
    path = tmp_path / "cell.yaml"
    path.write_text(MOCK.format(more=more))
    assert load_cell(path).record_required is required


def test_another_word_about_the_record_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "cell.yaml"
    path.write_text(MOCK.format(more="record: always"))
    with pytest.raises(CellFileError, match="cannot be 'always'"):
        load_cell(path)


def test_a_cell_can_be_made_from_a_text_instead_of_its_file(tmp_path: Path) -> None:
    assert (
        load_cell(
            tmp_path / "gone.yaml", texts={str(tmp_path / "gone.yaml"): MOCK.format(more="")}
        ).name
        == "bench"
    )
