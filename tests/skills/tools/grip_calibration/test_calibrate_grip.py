"""`pomona calibrate grip`, from the command line to a parameter file that a tree can use."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml

from pomona.drivers.interfaces import Pads
from pomona.drivers.services import RobotServices
from pomona.executive.cell.cell import Cell
from pomona.executive.cell.connect import load_cell
from pomona.executive.cli import main as pomona
from pomona.executive.values.units import STIFFNESS
from pomona.tools.grip_calibration import command_calibrate_grip as calibrate_grip
from pomona.tools.grip_calibration.calibration import (
    GuidanceEnded,
    calibrate_grip as grip_of,
    write_calibration,
)
from pomona.tools.grip_calibration.command_calibrate_grip import GuidedPushes
from pomona.tools.mock.hand import MockClock, MockForceSensor, MockGripper, spring_fruit
from tests.skills.tools.grip_calibration.pushes import TRUE, all_pushes, middle

MU = 0.5


class Person:
    """Presses Enter, then pulls the held fruit of friction `MU` harder and harder until it slides."""

    def __init__(self, clock: MockClock, gripper: MockGripper) -> None:
        self._clock, self._since = clock, np.inf
        self._feel = spring_fruit(gripper, 0.07)

    def press_enter(self, sentence: str = "") -> str:
        self._since = self._clock.now() if "until it slides" in sentence else np.inf
        return ""

    def feel(self, now: float) -> np.ndarray:
        wrenches = self._feel(now)
        pull = min(max(now - self._since, 0.0) * 2.0, MU * -wrenches[0, 2])
        wrenches[:, 0] = pull
        return wrenches


def mock_cell() -> tuple[Cell, Person]:
    clock = MockClock()
    gripper = MockGripper(clock)
    person = Person(clock, gripper)
    sensor = MockForceSensor(clock, person.feel)
    devices = {"gripper": gripper, "fingers": sensor}
    return Cell("mock", "mock", clock, devices, RobotServices(devices)), person


@pytest.mark.slow
def test_pushes_become_a_parameter_file(tmp_path: Path) -> None:
    pushes, squeeze = all_pushes()
    out = tmp_path / "grip.yaml"
    write_calibration(grip_of(list(pushes), squeeze), out, "apple")
    written = yaml.safe_load(out.read_text())
    assert middle(written["pads"]["friction"]["any"]) == pytest.approx(TRUE.mu, rel=0.05)
    assert STIFFNESS.parse(written["pads"]["stiffness"]) == pytest.approx(2000.0, rel=0.03)
    assert written["quality"]["slides"] == 2 * len(pushes)


def test_a_cell_includes_the_file_as_its_pads(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pushes, _ = all_pushes()
    write_calibration(grip_of(list(pushes)), tmp_path / "grip.yaml")
    cell = tmp_path / "cell.yaml"
    cell.write_text(
        "name: mine\nkind: mock\nworld: {driver: mock}\n"
        "devices:\n  pads: {include: grip.yaml#pads}\n"
    )
    assert pomona(["check", str(cell)]) == 0, capsys.readouterr().out
    with contextlib.closing(load_cell(cell, seed=0)) as connected:
        assert connected.device(Pads).on("apple").mu == pytest.approx(TRUE.mu, rel=0.05)


def test_a_person_is_led_through_pushes_at_a_cell(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    cell, person = mock_cell()
    monkeypatch.setattr(calibrate_grip, "_cell", lambda name: cell)
    monkeypatch.setattr("builtins.input", person.press_enter)
    out = tmp_path / "grip.yaml"
    arguments = ["--forces", "2N", "5N", "--time", "3s", "--out", str(out)]
    assert pomona(["calibrate", "grip", "--cell", "mine", *arguments]) == 0, capsys.readouterr().err
    written = yaml.safe_load(out.read_text())
    assert middle(written["pads"]["friction"]["any"]) == pytest.approx(MU, rel=0.03)
    assert STIFFNESS.parse(written["pads"]["stiffness"]) == pytest.approx(2000.0, rel=0.05)
    assert "no push twisted the fruit" in written["quality"]["notes"][0]


def guide_of(cell: Cell, ask: Callable[[str], object] = lambda sentence: None) -> GuidedPushes:
    gripper, sensor = cell.devices["gripper"], cell.devices["fingers"]
    assert isinstance(gripper, MockGripper)
    assert isinstance(sensor, MockForceSensor)
    clock = cell.clock
    assert isinstance(clock, MockClock)
    return GuidedPushes(
        gripper,
        sensor,
        clock.now,
        clock.advance,
        lambda sentence: None,
        lambda s, task: ask(s) and None,
    )


def test_a_stream_that_stops_ends_it_with_the_fingers_at_rest() -> None:
    cell, _ = mock_cell()
    gripper, sensor = cell.devices["gripper"], cell.devices["fingers"]
    assert isinstance(gripper, MockGripper)
    assert isinstance(sensor, MockForceSensor)
    guide = guide_of(cell, lambda s: sensor.lose(60.0) if "slides" in s else None)
    with pytest.raises(GuidanceEnded, match="no valid sample"):
        guide.record([2.0], 1.0)
    width = gripper.width
    cell.clock.advance(1.0)  # type: ignore[attr-defined]
    assert gripper.width == pytest.approx(width, abs=1e-6)


def test_fingers_without_samples_or_without_a_fruit_are_reported() -> None:
    cell, _ = mock_cell()
    sensor = cell.devices["fingers"]
    assert isinstance(sensor, MockForceSensor)
    sensor.lose(60.0)
    with pytest.raises(GuidanceEnded, match="no samples"):
        guide_of(cell).record([2.0], 1.0)
    cell, _ = mock_cell()
    sensor = cell.devices["fingers"]
    assert isinstance(sensor, MockForceSensor)
    sensor.feel = lambda now: np.zeros((2, 6))
    with pytest.raises(GuidanceEnded, match="put the fruit between them"):
        guide_of(cell).record([2.0], 1.0)


def test_a_cell_that_is_not_there_is_refused_in_words(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = str(tmp_path / "x.yaml")
    assert pomona(["calibrate", "grip", "--cell", "nowhere", "--out", out]) == 2
    assert "no cell file 'nowhere'" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (
            ("calibrate", "grip", "--out", "x", "--forces", "5"),
            "'5' lacks a unit: a force is given in N, mN",
        ),
        (
            ("calibrate", "grip", "--out", "x", "--forces", "40 N"),
            "it is 40 N, but must be between 0.6 N and 15 N",
        ),
        (
            ("calibrate", "grip", "--out", "x", "--time", "0 s"),
            "it is 0 s, but must be between 100 ms and 2 min",
        ),
        (
            ("calibrate", "hand-eye", "looks", "--out", "x", "--square", "24.5"),
            "'24.5' lacks a unit",
        ),
        (("emulate", "wsg", "--obstacle", "30"), "'30' lacks a unit"),
        (("emulate", "suntouch", "--press", "3"), "'3' lacks a unit"),
        (("emulate", "motoman", "--queue", "1"), "'1' lacks a unit"),
    ],
)
def test_a_quantity_without_its_unit_is_refused(
    arguments: tuple[str, ...], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        pomona(list(arguments))
    assert ended.value.code == 2
    assert words in capsys.readouterr().err


def test_no_file_is_written_over(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mine = tmp_path / "mine"
    mine.write_text("mine")
    assert pomona(["calibrate", "grip", "--cell", "nothing", "--out", str(mine)]) == 2
    assert "mine exists, and nothing is overwritten" in capsys.readouterr().err
    assert mine.read_text() == "mine"
