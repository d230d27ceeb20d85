import json
import math
from pathlib import Path

import numpy as np
import pytest

from pomona.devices.emulators.suntouch import Pad, encode, random_wrenches
from pomona.devices.suntouch.calibration import FingerCalibration, UnusableCalibration
from pomona.devices.suntouch.codec import decode
from pomona.devices.suntouch.fit import UnusableRecording, fit_calibration, read_recording


def small_network() -> FingerCalibration:
    """One component that sums the taxels, one neuron, and outputs that are easy to follow by hand."""
    return FingerCalibration(
        finger="test",
        mean=np.full(25, 0.1),
        components=np.ones((1, 25)),
        in_low=np.array([-2.5]),
        in_high=np.array([2.5]),
        layers=(
            (np.array([[2.0]]), np.array([0.5])),
            (np.arange(1.0, 7.0)[:, None] / 10.0, np.zeros(6)),
        ),
        out_low=np.full(6, -10.0),
        out_high=np.full(6, 10.0),
        error_n=0.05,
    )


def test_the_network_is_pca_mapminmax_tansig_linear_and_back() -> None:
    # 25 taxels at 0.15 V: sum of (v − mean) = 1.25, mapped from ±2.5 to 0.5; tansig(2·0.5 + 0.5); × row / 10; × 10 N
    hidden = 2.0 / (1.0 + math.exp(-2.0 * 1.5)) - 1.0
    expected = [10.0 * hidden * row / 10.0 for row in range(1, 7)]
    assert small_network().wrench(np.full(25, 0.15)) == pytest.approx(expected)


def test_a_calibration_survives_its_file(tmp_path: Path) -> None:
    path = tmp_path / "finger.json"
    calibration = small_network()
    calibration.save(path)
    back = FingerCalibration.load(path)
    volts = np.random.default_rng(0).normal(0.0, 0.2, (10, 25))
    assert back.wrench(volts) == pytest.approx(calibration.wrench(volts), rel=1e-7)
    assert (back.finger, back.error_n) == ("test", 0.05)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda content: content.update(format="other"), "no calibration of a finger"),
        (lambda content: content.pop("mean"), "mean"),
        (lambda content: content.update(mean=[1.0]), "does not fit together"),
        (
            lambda content: content.update(
                out_low=[0.0], out_high=[1.0], layers=content["layers"][:1]
            ),
            "a wrench has 6",
        ),
        (lambda content: content.update(in_low=[float("nan")]), "not finite"),
    ],
)
def test_a_spoilt_file_is_refused_in_words(tmp_path: Path, change, words: str) -> None:  # type: ignore[no-untyped-def]
    path = tmp_path / "finger.json"
    small_network().save(path)
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))
    with pytest.raises(UnusableCalibration, match=words):
        FingerCalibration.load(path)
    path.write_text("{")
    with pytest.raises(UnusableCalibration, match="cannot be read"):
        FingerCalibration.load(path)


def recording(count: int = 1500) -> tuple[np.ndarray, np.ndarray]:
    pad, wrenches = Pad(0), random_wrenches(count, 1)
    return np.array([decode(encode(pad.volts(w))).volts for w in wrenches]) - pad.rest, wrenches


def test_a_fit_finds_the_wrench_behind_the_voltages_and_reports_its_error() -> None:
    volts, wrenches = recording()
    calibration, report = fit_calibration(
        volts, wrenches, "left", components=20, hidden=(12,), epochs=10
    )
    force_error = np.abs(calibration.wrench(volts) - wrenches)[:, :3]
    assert np.sqrt((force_error**2).mean()) < 0.35  # of ± 7 N
    assert report.samples == 1500
    assert report.rms.shape == (6,)
    assert calibration.error_n == pytest.approx(np.sqrt((report.rms[:3] ** 2).mean()))
    assert "within 0.2 N" in str(report)


def test_recordings_are_read_from_both_formats(tmp_path: Path) -> None:
    volts, wrenches = recording(20)
    np.savez(tmp_path / "r.npz", volts=volts, wrenches=wrenches)
    np.savetxt(tmp_path / "r.csv", np.hstack([volts, wrenches]), delimiter=",")
    for name in ("r.npz", "r.csv"):
        back_volts, back_wrenches = read_recording(tmp_path / name)
        assert back_volts == pytest.approx(volts)
        assert back_wrenches == pytest.approx(wrenches)


def test_unusable_recordings_are_refused_in_words(tmp_path: Path) -> None:
    (tmp_path / "r.csv").write_text("1,2,3\n")
    with pytest.raises(UnusableRecording, match="needs"):
        read_recording(tmp_path / "r.csv")
    with pytest.raises(UnusableRecording, match="cannot be read"):
        read_recording(tmp_path / "missing.npz")
    volts, wrenches = recording(600)
    with pytest.raises(UnusableRecording, match="at least 500"):
        fit_calibration(volts[:100], wrenches[:100], "left")
    with pytest.raises(UnusableRecording, match="never changes"):
        fit_calibration(volts, wrenches * 0.0, "left")
    with pytest.raises(UnusableRecording, match="not finite"):
        fit_calibration(volts * np.nan, wrenches, "left")


def test_forces_that_the_voltages_do_not_explain_are_refused() -> None:
    rng = np.random.default_rng(0)
    with pytest.raises(
        UnusableRecording, match=r"explain 0% of the variance of f_[xyz], 50% are needed"
    ):
        fit_calibration(
            rng.normal(size=(600, 25)), rng.normal(size=(600, 6)), "left", hidden=(4,), epochs=2
        )


@pytest.mark.parametrize("name", ["r.npz", "r.csv"])
@pytest.mark.parametrize(
    "content", [b"", b"PK\x03\x04 cut off", bytes(range(256)), None], ids=lambda c: str(c)[:8]
)
def test_recordings_that_are_none_are_refused_in_words(
    name: str, content: bytes | None, tmp_path: Path
) -> None:
    with (tmp_path / name).open("wb") as stream:
        stream.truncate(2 << 30) if content is None else stream.write(
            content
        )  # sparse: it takes no room
    with pytest.raises(UnusableRecording, match=name):
        read_recording(tmp_path / name)


def test_a_recording_with_numbers_that_are_not_finite_is_refused(tmp_path: Path) -> None:
    volts, wrenches = recording(20)
    volts[3, 4] = math.nan
    np.savez(tmp_path / "r.npz", volts=volts, wrenches=wrenches)
    with pytest.raises(UnusableRecording, match="finite"):
        read_recording(tmp_path / "r.npz")


@pytest.mark.parametrize(
    "content", [b"", b"[" * 100_000, bytes(range(256)), b"[]", None], ids=lambda c: str(c)[:8]
)
def test_calibrations_that_are_none_are_refused_in_words(
    content: bytes | None, tmp_path: Path
) -> None:
    with (tmp_path / "finger.json").open("wb") as stream:
        stream.truncate(2 << 30) if content is None else stream.write(content)
    with pytest.raises(UnusableCalibration, match=r"finger\.json"):
        FingerCalibration.load(tmp_path / "finger.json")
