"""A belt's encoder behind a PLC: travel and speed, an unknown value, wrong settings."""

from __future__ import annotations

from pathlib import Path

import pytest

from pomona.applications.conveyor import signal_encoder as leaf
from pomona.drivers import (
    CellFileError,
    ConnectContext,
    DeviceLost,
    StopFailed,
    Surroundings,
    read_cell_file,
)
from pomona.executive import ManualClock, find_cell
from pomona.executive.cell.cell_file import judge_cell_file
from pomona.executive.values.findings import Findings
from tests.drivers.device_settings import read_settings
from tests.drivers.devices.plc.mock_signals import MockSignals

USUAL = "driver: signal-conveyor\ntravel: encoder\nbeside: -360 mm\ntop: -120 mm\n"


def belt(
    folder: Path, plc: MockSignals, clock: ManualClock, text: str = USUAL
) -> leaf.SignalConveyor:
    path = folder / "belt.yaml"
    path.write_text(text)
    return leaf.connect(
        read_settings(leaf.connect, path), ConnectContext(path, clock, 0, devices={"plc": plc})
    )


def test_the_encoder_gives_travel_and_speed(tmp_path: Path) -> None:
    clock = ManualClock()
    plc = MockSignals(clock, {"encoder": 5.0, "start": False})
    conveyor = belt(tmp_path, plc, clock)
    for _ in range(50):
        clock.advance(0.02)
        plc.values["encoder"] += 0.15 * 0.02
        conveyor.check()
    state = conveyor.travelled()
    assert state is not None
    assert (state.stamp, state.position) == (pytest.approx(1.0), pytest.approx(5.15))
    assert state.speed == pytest.approx(0.15)
    for _ in range(10):
        clock.advance(0.02)
        state = conveyor.travelled()
    assert state is not None
    assert state.speed == pytest.approx(0.0)
    assert conveyor.belt.top == pytest.approx(-0.12)


def test_an_unknown_travel_ends_the_run_and_keeps_its_old_stamp(tmp_path: Path) -> None:
    clock = ManualClock()
    plc = MockSignals(clock, {"encoder": 5.0})
    conveyor = belt(tmp_path, plc, clock)
    conveyor.check()
    plc.inject_fault("stopped")
    clock.advance(0.3)
    with pytest.raises(DeviceLost, match="'encoder' is 300 ms old"):
        conveyor.check()
    assert conveyor.last_seen() == 0.0


def test_a_signal_that_is_no_number_is_refused_with_its_place(tmp_path: Path) -> None:
    clock = ManualClock()
    plc = MockSignals(clock, {"encoder": 5.0, "start": False})
    for wrong in ("start", "encodr"):
        with pytest.raises(
            CellFileError, match=f"(?s):2:9: .*no input '{wrong}' that is a number.*encoder"
        ):
            belt(tmp_path, plc, clock, USUAL.replace("travel: encoder", f"travel: {wrong}"))


def test_a_stop_takes_the_output_away_and_nothing_gives_it_again(tmp_path: Path) -> None:
    clock = ManualClock()
    plc = MockSignals(clock, {"encoder": 5.0}, ("belt_runs",))
    conveyor = belt(tmp_path, plc, clock, USUAL + "runs: belt_runs\n")
    plc.write("belt_runs", True)
    for _ in range(10):
        clock.advance(0.02)
        plc.values["encoder"] += 0.15 * 0.02
        assert conveyor.settled()  # nothing stopped it yet
    assert conveyor.stop()
    assert plc.read("belt_runs").value is False
    assert not conveyor.settled()  # its encoder still counts
    for _ in range(10):
        clock.advance(0.02)
        conveyor.check()
    assert conveyor.settled()
    assert plc.read("belt_runs").value is False


def test_an_output_that_cannot_be_taken_away_is_an_error(tmp_path: Path) -> None:
    clock = ManualClock()
    plc = MockSignals(clock, {"encoder": 5.0}, ("belt_runs",))
    conveyor = belt(tmp_path, plc, clock, USUAL + "runs: belt_runs\n")
    plc.safe_stop("an operator")
    with pytest.raises(StopFailed, match=r"the belt may run on: .*an operator"):
        conveyor.stop()


def test_a_belt_without_such_an_output_says_so_and_is_warned_of_in_a_cell_with_a_watch(
    tmp_path: Path,
) -> None:
    clock = ManualClock()
    plc = MockSignals(clock, {"encoder": 5.0}, ("belt_runs",))
    assert not belt(tmp_path, plc, clock).stop()
    around = Surroundings(read_cell_file(find_cell("conveyor")).workspace, {"plc": MockSignals})
    for text, warned in ((USUAL, True), (USUAL + "runs: belt_runs\n", False)):
        (tmp_path / "belt.yaml").write_text(text)
        found = list(read_settings(leaf.connect, tmp_path / "belt.yaml").values.fits(around))
        assert [problem.warning for problem in found] == [True] * warned
    with pytest.raises(
        CellFileError, match=r"(?s):5:7: .*no output 'belt_run' that is a switch.*belt_runs"
    ):
        belt(tmp_path, plc, clock, USUAL + "runs: belt_run\n")


def test_a_cell_without_a_plc_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "belt.yaml"
    path.write_text(USUAL)
    said = read_settings(leaf.connect, path).values
    assert [problem.message for problem in said.fits(Surroundings())] == ["it needs a PLC above it"]
    assert list(said.fits(Surroundings(above={"plc": MockSignals}))) == []


def test_a_simulated_belt_always_notes_that_its_camera_sees_no_person(tmp_path: Path) -> None:
    shipped = find_cell("conveyor")
    text = shipped.read_text().replace("../", f"{shipped.parent.parent}/")
    person = "  intruder: {start: 1 0 0 m, goal: 0 0 0.3 m}\n"
    line = text[: text.index("  table_z:")].count("\n") + 1
    for name, added in (("without", ""), ("with", person)):
        path = tmp_path / f"{name}.yaml"
        path.write_text(text.replace("  fruits:", f"{added}  fruits:"))
        findings = Findings()
        judge_cell_file(path, findings)
        assert [(found.severity, found.line) for found in findings.sorted()] == [("note", line)]
