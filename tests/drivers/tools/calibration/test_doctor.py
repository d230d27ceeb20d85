import argparse
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, cast

import cv2
import numpy as np
import pytest

from pomona.drivers.interfaces import LoadSensor, PressSensor, Subscription, WrenchSample
from pomona.executive.cell.cell import Cell
from pomona.executive.cell.connect import load_cell
from pomona.executive.cell.device import Device
from pomona.executive.recording.folder import EVENTS_FILE
from pomona.executive.values.installation import installed_trees
from pomona.executive.values.sentences import ReportLine
from pomona.tools.calibration.command_doctor import add
from pomona.tools.calibration.doctor import _device, _Watched, examine


@pytest.fixture
def frames_cell(tmp_path: Path) -> Path:
    cv2.imwrite(str(tmp_path / "a_color.png"), np.zeros((30, 40, 3), np.uint8))
    cv2.imwrite(str(tmp_path / "a_depth_mm.png"), np.full((30, 40), 500, np.uint16))
    path = tmp_path / "cell.yaml"
    intrinsics = "{fx: 600 px, fy: 600 px, cx: 20 px, cy: 15 px, width: 40, height: 30}"
    path.write_text(
        "name: bench\nkind: real\nclock: manual\ndevices:\n"
        f"  camera: {{driver: frames, folder: '{tmp_path}', intrinsics: {intrinsics}}}\n"
        "  gripper: {driver: wsg, tcp: '127.0.0.1:9'}\n"
    )
    return path


def by_name(checks: Iterable[ReportLine]) -> dict[str, ReportLine]:
    return {check.name: check for check in checks}


def test_one_unreachable_device_is_reported_with_its_place_and_the_others_are_still_looked_over(
    frames_cell: Path,
) -> None:
    checks = by_name(examine(frames_cell))
    assert checks["cell file"].ok
    assert checks["camera"].ok
    assert checks["camera intrinsics"].ok
    assert "100 %" in checks["camera depth"].found
    gripper = checks["gripper"]
    assert not gripper.ok
    assert f"{frames_cell}:6:31" in gripper.found
    assert "switched on" in gripper.advice
    assert "→" in str(gripper)


def test_records_of_the_cell_are_looked_over_under_its_name(
    frames_cell: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []

    def check(records: list[Path], cell: str) -> list[ReportLine]:
        asked.append((records, cell))
        return [ReportLine("camera of bench", False, "sits beside its place")]

    monkeypatch.setattr("pomona.tools.calibration.doctor.further_checks", check)
    run = tmp_path / "runs" / "one"
    run.mkdir(parents=True)
    (run / EVENTS_FILE).touch()
    assert not by_name(examine(frames_cell, None, run.parent))["camera of bench"].ok
    assert asked == [([run], "bench")]


def test_a_doubtful_value_of_the_cell_file_is_reported_with_its_place(tmp_path: Path) -> None:
    robot = installed_trees() / "robots" / "ur5e_hand_e.xml"
    path = tmp_path / "cell.yaml"
    path.write_text(
        "kind: real\nclock: manual\ndevices:\n"
        f"  arm: {{driver: universal-robots, address: 127.0.0.81, model: ur5e, robot: {robot}}}\n"
        "  gripper: {driver: robotiq, model: hand-e, port: /dev/nothing}\n"
    )
    doubts = [check for check in examine(path) if check.name == "cell file" and not check.ok]
    assert [
        ":5:" in doubt.found and "53 mm apart, and here 0 mm" in doubt.found for doubt in doubts
    ] == [True]
    assert "both must agree" in doubts[0].advice


def test_the_command_takes_the_width_of_a_gauge(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "cell.yaml"
    path.write_text(
        "kind: mock\nworld: {driver: mock}\ndevices:\n  gripper: {driver: mock-gripper}\n"
    )
    parser = argparse.ArgumentParser()
    add(parser.add_subparsers())
    for gauge, sign in (("100 mm", "✓"), ("20 mm", "✗")):
        words = ["doctor", "--cell", str(path), "--record", str(tmp_path), "--gauge", gauge]
        options = parser.parse_args(words)
        options.main(options)
        (line,) = [one for one in capsys.readouterr().out.splitlines() if "gripper gauge" in one]
        assert line.startswith(sign)


def test_an_unusable_cell_file_is_one_line_with_its_place(tmp_path: Path) -> None:
    path = tmp_path / "cell.yaml"
    path.write_text("kind: real\ndevices:\n  gripper: {driver: wgs}\n")
    check = by_name(examine(path))["gripper"]
    assert not check.ok
    assert "wgs" in check.found
    missing = by_name(examine(tmp_path / "none.yaml"))["cell file"]
    assert "cannot be read" in missing.found


def test_the_command_prints_a_line_for_each_check_and_a_sum(
    frames_cell: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    parser = argparse.ArgumentParser()
    add(parser.add_subparsers())
    options = parser.parse_args(
        ["doctor", "--cell", str(frames_cell), "--record", str(frames_cell.parent)]
    )
    assert options.main(options) == 1
    lines = capsys.readouterr().out.splitlines()
    assert any(line.startswith("✓ numpy") for line in lines)
    assert any(line.startswith("✓ camera") for line in lines)
    assert lines[-1].startswith("1 of ")


def test_lines_are_printed_as_they_come(frames_cell: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    printed: list[str] = []

    def connect(*words: Any, **more: Any) -> Cell:
        assert printed[0].startswith("✓ first"), "nothing was said before the cell was connected"
        return load_cell(*words, **more)

    first = ReportLine("first", True, "")
    monkeypatch.setattr(
        "pomona.tools.calibration.command_doctor.examine_machine", lambda _records: iter([first])
    )
    monkeypatch.setattr("builtins.print", lambda *words, **_: printed.append(str(words[0])))
    monkeypatch.setattr("pomona.tools.calibration.doctor.load_cell", connect)
    parser = argparse.ArgumentParser()
    add(parser.add_subparsers())
    options = parser.parse_args(["doctor", "--cell", str(frames_cell)])
    assert options.main(options) == 1


class Tips(Device):
    """Fingertips that press."""

    interfaces = (PressSensor,)
    rate = 100.0

    def __init__(self, force: float) -> None:
        super().__init__("load")
        self.sample = WrenchSample(
            0.0, 1, np.array([[0.0, 0.0, -force, 0.0, 0.0, 0.0]]), (False, False)
        )

    def latest(self) -> WrenchSample:
        return self.sample

    def subscribe(self, listener: Callable[[WrenchSample], None]) -> Subscription:
        raise AssertionError("not watched here")


class Wrist(Tips):
    """A load sensor that carries 1 kg."""

    interfaces = (LoadSensor,)
    mass, least = 1.0, 0.5


@pytest.mark.parametrize(
    ("sensor", "line", "fine", "words"),
    [
        (
            Wrist(9.8),
            "load force",
            True,
            "9.8 N along an axis at rest; it carries 1 kg, and 0.5 N count",
        ),
        (Wrist(60.0), "load force", False, "60.0 N along an axis"),
        (Tips(0.1), "load bias", True, "0.10 N without contact"),
        (Tips(3.0), "load bias", False, "3.00 N without contact"),
    ],
)
def test_a_sensor_of_wrenches_has_its_rate_and_its_force_at_rest(
    sensor: Tips, line: str, fine: bool, words: str
) -> None:
    lines = by_name(_device("load", sensor, _Watched(stamps=100, gaps=0), cast(Any, None)))
    assert (lines[line].ok, lines["load rate"].ok) == (fine, True)
    assert words in str(lines[line])


def test_a_slow_stream_of_a_wrist_sensor_is_reported() -> None:
    lines = by_name(_device("load", Wrist(9.8), _Watched(stamps=50, gaps=12), cast(Any, None)))
    assert not lines["load rate"].ok
    assert "50 samples a second of 100, 12 gaps" in str(lines["load rate"])
