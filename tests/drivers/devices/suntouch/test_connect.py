from pathlib import Path

import pytest

from pomona.devices.suntouch.connect import connect
from pomona.drivers.errors import CellFileError
from pomona.drivers.services import ConnectContext
from pomona.executive.clock import ManualClock
from tests.drivers.device_settings import read_settings

CALIBRATION = (
    Path(__file__).resolve().parents[4] / "trees" / "cells" / "emulated_fingers" / "left.json"
)
RIGHT = f"right: {{port: p, calibration: {CALIBRATION.with_name('right.json')}}}"


def refuse(folder: Path, text: str) -> CellFileError:
    path = folder / "cell.yaml"
    path.write_text(f"driver: suntouch\n{text}\n")
    with pytest.raises(CellFileError) as caught:
        connect(read_settings(connect, path), ConnectContext(path, ManualClock(), 0))
    return caught.value


def test_a_missing_port_is_refused_with_its_place_and_the_ports_that_are_there(
    tmp_path: Path,
) -> None:
    finger = f"{{port: /dev/nothing, calibration: {CALIBRATION}}}"
    error = refuse(tmp_path, f"left: {finger}\n{RIGHT}")
    assert (error.line, error.column) == (2, 7)
    assert "/dev/nothing" in error.message
    assert "serial ports of this machine" in error.hint


def test_two_fingers_at_one_port_are_refused(tmp_path: Path) -> None:
    error = refuse(tmp_path, f"left: {{port: p, calibration: {CALIBRATION}}}\n{RIGHT}")
    assert "both fingers are at p: each has a port of its own" in error.message


def test_a_missing_or_wrong_calibration_is_refused_with_the_command_that_makes_one(
    tmp_path: Path,
) -> None:
    missing = refuse(tmp_path, "left: {port: p, calibration: none.json}\n" + RIGHT)
    assert "does not exist" in missing.message
    assert "pomona calibrate fingers" in str(missing)
    (tmp_path / "empty.json").write_text("{}")
    error = refuse(tmp_path, "left: {port: p, calibration: empty.json}\n" + RIGHT)
    assert "no calibration of a finger" in error.message
    assert "pomona calibrate fingers" in error.hint


def test_exchanged_calibrations_are_refused_by_the_names_they_were_made_with(
    tmp_path: Path,
) -> None:
    other = CALIBRATION.with_name("right.json")
    error = refuse(
        tmp_path, f"left: {{port: p, calibration: {other}}}\n{RIGHT.replace('port: p', 'port: q')}"
    )
    assert (error.line, error.column) == (2, 7)
    assert "right.json was made for the finger 'emulated right'" in error.message
    assert "exchanged" in error.hint


def test_an_unknown_baud_rate_is_refused(tmp_path: Path) -> None:
    assert "1000000, 500000, 115200" in str(refuse(tmp_path, "baud: 9600"))
