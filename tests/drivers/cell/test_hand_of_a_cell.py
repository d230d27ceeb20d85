"""A cell without force sensor refuses a run that would open a holding hand, and recovers."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from pomona.drivers.errors import DeviceFault
from pomona.drivers.interfaces import ForceSensor, Gripper
from pomona.drivers.services import ConnectContext
from pomona.executive.cell import registration
from pomona.executive.cell.connect import load_cell
from pomona.executive.cell.registration import Driver, Settings
from pomona.executive.errors import UsageError
from pomona.executive.execute import RunOrder, execute
from pomona.executive.files import find_cell, find_tree
from pomona.executive.judging import judge
from pomona.executive.language.check import read_document
from pomona.executive.registry import Registry
from pomona.tools.mock import MockClock, MockGripper

PLAIN = """
name: plain
kind: mock
workspace: {table_z: 0 m, lower: -1 -1 0 m, upper: 1 1 1 m, poses: {home: 0 0 0 0 0 0 0 rad}}
world: {driver: mock}
devices:
  arm: {driver: mock-arm, start: home}
  gripper: {driver: mock-gripper}
"""
REAL = "name: lab\nkind: real\nclock: manual\ndevices:\n  gripper: {driver: lasting}\n"
TREE = "pomona: 1\ntree: t\nroot: {wait: 20 ms}\n"


class LastingGripper(MockGripper):
    """A gripper that keeps its fingers where they are when the process ends."""

    outlives = True
    width_now = 0.08

    def close(self) -> None:
        type(self).width_now = self.width


def connect_lasting(settings: Settings[Any], context: ConnectContext) -> LastingGripper:
    return LastingGripper(MockClock(), LastingGripper.width_now)


class Entry:
    value = "test"

    def load(self) -> Driver[Any]:
        return Driver(LastingGripper, registration.NoOptions, connect_lasting)


@pytest.fixture
def lasting(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> RunOrder:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setattr(registration, "installed_drivers", lambda: {"lasting": Entry()})
    LastingGripper.width_now = 0.08
    (tmp_path / "cell.yaml").write_text(REAL)
    (tmp_path / "tree.yaml").write_text(TREE)
    return RunOrder(tmp_path / "tree.yaml", tmp_path / "cell.yaml", record=tmp_path / "runs")


def test_a_real_hand_that_was_never_known_is_refused_until_an_operator_clears_it(
    lasting: RunOrder,
) -> None:
    with pytest.raises(
        UsageError, match="the last state of the hand is unknown before the run has begun"
    ):
        execute(lasting)
    assert execute(replace(lasting, cleared=True)).result.outcome == "success"
    assert (
        execute(lasting).result.outcome == "success"
    )  # it is known to be empty, and stands where it stood


def test_a_real_hand_that_was_stopped_while_it_closed_is_refused_in_the_next_process(
    lasting: RunOrder,
) -> None:
    execute(replace(lasting, cleared=True))
    cell = load_cell(lasting.cell)
    gripper = cell.device(Gripper)
    assert isinstance(gripper, LastingGripper)
    assert cell.in_hand() == ""
    gripper.blocked_at = 0.07
    gripper.move(0.05, 0.1)
    gripper._clock.advance(1.0)
    assert cell.in_hand() == "the fingers stopped at 70.0 mm on their way to 50.0 mm"
    cell.close()
    with pytest.raises(
        UsageError, match=r"at 70\.0 mm, where they may hold something before the run has begun"
    ):
        execute(lasting)
    LastingGripper.width_now = 0.1  # opened by hand, outside this process
    with pytest.raises(UsageError, match="stood at 70"):
        execute(lasting)
    assert execute(replace(lasting, cleared=True)).result.outcome == "success"


def test_a_cell_that_ends_with_its_process_begins_with_an_empty_hand(tmp_path: Path) -> None:
    (tmp_path / "cell.yaml").write_text(PLAIN)
    cell = load_cell(tmp_path / "cell.yaml")
    assert ForceSensor not in cell.interfaces()
    assert cell.in_hand() == ""


def test_a_paused_cell_without_force_sensor_notices_that_the_fruit_is_gone(tmp_path: Path) -> None:
    (tmp_path / "cell.yaml").write_text(PLAIN)
    cell = load_cell(tmp_path / "cell.yaml")
    gripper, clock = cell.device(Gripper), cell.clock
    assert isinstance(gripper, MockGripper)
    gripper.blocked_at, gripper.motor_force = 0.08, 5.0
    gripper.move(0.05, 0.1)
    clock.advance(1.0)
    assert cell.in_hand() == "something is between the fingers"
    cell.pause()
    cell.check()
    cell.resume()
    cell.pause()
    cell.check()
    gripper.motor_force = 0.0
    with pytest.raises(DeviceFault, match="presses no more while the run was paused"):
        cell.resume()


def test_recover_runs_on_a_cell_without_force_sensor() -> None:
    judged = judge(
        read_document(find_tree("recover")), Registry.installed(), {}, find_cell("sim_plain")
    )
    assert {found.severity for found in judged.findings.sorted()} == {"note"}


def test_the_check_names_the_gripper_of_a_cell_without_force_sensor() -> None:
    cell = find_cell("sim_plain")
    judged = judge(read_document(find_tree("pick_apple_plain")), Registry.installed(), {}, cell)
    found, _note = judged.findings.sorted()
    assert (found.severity, Path(found.path).name) == ("warning", "sim_plain.yaml")
    assert "gripper:" in cell.read_text().splitlines()[found.line - 1]
    assert "no minimum grip force and no slip detection" in found.message
    with_fingers = judge(
        read_document(find_tree("pick_apple_plain")), Registry.installed(), {}, find_cell("sim")
    )
    assert {found.severity for found in with_fingers.findings.sorted()} == {"note"}
