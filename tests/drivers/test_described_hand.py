"""The fingers of a description are measured by its pads; without pads a finding says so, in the check and in doctor."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from pomona.drivers.described_hand import described_opening
from pomona.executive.cell.cell_file import judge_cell_file
from pomona.executive.values.findings import Finding, Findings
from pomona.tools.calibration.doctor import examine

ROBOTS = Path(__file__).resolve().parents[2] / "trees" / "robots"
HANDS = {
    "robotiq": "driver: robotiq\n    model: hand-e\n    port: /dev/nothing\n    finger_offset: 53 mm",
    "wsg": "driver: wsg\n    tcp: 127.0.0.1:9",
}


def cell_with(folder: Path, hand: str, pads: bool) -> Path:
    """A cell of a UR5e with a Hand-E, whose pads are called otherwise unless `pads`."""
    for file in ROBOTS.glob("*hand_e*.xml"):
        shutil.copy(file, folder)
    body = folder / "hand_e_body.xml"
    if not pads:
        body.write_text(
            body.read_text("utf-8").replace('site name="pad_', 'site name="tip_'), "utf-8"
        )
    path = folder / "cell.yaml"
    arm = f"driver: universal-robots\n    address: 127.0.0.1\n    model: ur5e\n    robot: {folder / 'ur5e_hand_e.xml'}"
    path.write_text(
        f"name: bench\nkind: real\ndevices:\n  arm:\n    {arm}\n  gripper:\n    {HANDS[hand]}\n",
        "utf-8",
    )
    return path


def findings_of_the_description(cell: Path) -> list[Finding]:
    findings = Findings()
    judge_cell_file(cell, findings)
    return [found for found in findings.sorted() if "ur5e_hand_e.xml" in found.message]


def test_the_opening_is_that_of_the_pads() -> None:
    assert described_opening(ROBOTS / "ur5e_hand_e.xml") == pytest.approx((0.053, 0.103), abs=1e-3)


@pytest.mark.parametrize("hand", HANDS)
def test_a_description_without_pads_is_a_finding_of_the_check(tmp_path: Path, hand: str) -> None:
    path = cell_with(tmp_path, hand, pads=False)
    assert described_opening(tmp_path / "ur5e_hand_e.xml") is None
    (found,) = findings_of_the_description(path)
    assert found.severity == "warning"
    assert found.line == path.read_text("utf-8").splitlines().index("  gripper:") + 2
    assert "ur5e_hand_e.xml has no two sites 'pad_…'" in found.message
    assert "pad_left" in found.hint
    doubts = [check for check in examine(path) if check.name == "cell file" and not check.ok]
    assert [found.message in doubt.found and doubt.advice == found.hint for doubt in doubts] == [
        True
    ]


@pytest.mark.parametrize("hand", HANDS)
def test_pads_of_this_hand_are_compared_instead(tmp_path: Path, hand: str) -> None:
    found = findings_of_the_description(cell_with(tmp_path, hand, pads=True))
    assert [each.severity for each in found] == ([] if hand == "robotiq" else ["error"])
