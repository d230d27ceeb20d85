import argparse
from pathlib import Path

import numpy as np
import pytest

from pomona.devices.emulators.suntouch import Pad, random_wrenches
from pomona.devices.suntouch.calibration import FingerCalibration
from pomona.tools.calibration import command_calibrate as calibrate


def run(*arguments: str) -> int:
    parser = argparse.ArgumentParser()
    calibrate.add(parser.add_subparsers())
    options = parser.parse_args(["calibrate", *arguments])
    status: int = options.main(options)
    return status


def test_fingers_writes_a_calibration_and_prints_its_error(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pad, wrenches = Pad(0), random_wrenches(600, 0)
    volts = np.array([pad.volts(wrench) for wrench in wrenches]) - pad.rest
    np.savez(tmp_path / "r.npz", volts=volts, wrenches=wrenches)
    out = tmp_path / "finger.json"
    assert (
        run("fingers", str(tmp_path / "r.npz"), "--out", str(out), "--hidden", "6", "--epochs", "3")
        == 0
    )
    assert FingerCalibration.load(out).finger == "r"
    printed = capsys.readouterr().out.splitlines()
    assert printed[0].startswith("fitted to 600 samples")
    assert printed[-1] == f"written to {out}"


@pytest.mark.parametrize("option", ["--epochs=0", "--epochs=-5", "--hidden=0", "--seed=-1"])
def test_numbers_that_give_no_fit_are_refused(
    option: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        run("fingers", "r.npz", "--out", "x.json", option)
    assert ended.value.code == 2
    assert "must be at least" in capsys.readouterr().err


def test_unusable_input_is_reported_without_a_traceback(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("fingers", str(tmp_path / "none.npz"), "--out", "x") == 2
    assert "cannot be read" in capsys.readouterr().err
    assert run("hand-eye", str(tmp_path), "--square", "30mm", "--board", "nine", "--out", "x") == 2
    assert "write the inner corners as 9x6" in capsys.readouterr().err
