"""Loading a cell: devices by name, one clock, errors before anything moves, nothing left open after one."""

from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from pomona.drivers.errors import CellFileError, DeviceLost
from pomona.drivers.interfaces import (
    Arm,
    Camera,
    Cameras,
    ForceSensor,
    Gripper,
    Hands,
    Pads,
    StreamedArm,
    Workspace,
)
from pomona.drivers.services import ConnectContext
from pomona.executive.cell import registration as driver_module
from pomona.executive.cell.connect import load_cell
from pomona.executive.cell.device import Device
from pomona.executive.cell.registration import Driver, NoOptions, installed_drivers
from pomona.executive.clock import ManualClock, SystemClock
from pomona.executive.values.kinds import Text
from pomona.executive.values.sections import value

CELLS = Path(__file__).resolve().parents[3] / "trees" / "cells"

MOCK = """
name: bench
kind: mock
workspace:
  table_z: 0 m
  lower: -1 -1 0 m
  upper: 1 1 1 m
  obstacles: [{name: wall, centre: 0 1 0 m, size: [2 m, 20 mm, 1 m], yaw: 90 deg}]
  poses: {home: 0 0 0 0 0 0 0 rad}
world: {driver: mock}
devices:
  arm: {driver: mock-arm, start: home}
  gripper: {driver: mock-gripper}
  fingers: {driver: mock-fingers, fruit: 80 mm}
  camera: {driver: mock-camera}
"""


@pytest.fixture
def load(tmp_path):
    def load_text(text, **arguments):
        path = tmp_path / "cell.yaml"
        path.write_text(text)
        return load_cell(path, **arguments)

    return load_text


def test_a_mock_cell_has_everything_a_pick_needs(load):
    cell = load(MOCK)
    assert (cell.name, cell.kind) == ("bench", "mock")
    assert set(cell.interfaces()) == {Arm, StreamedArm, Gripper, ForceSensor, Camera, Workspace}
    assert cell.links() == dict.fromkeys(("world", "arm", "gripper", "fingers", "camera"), "ok")
    assert cell.device(Workspace).poses["home"].shape == (7,)
    wall = cell.device(Workspace).obstacles[0]
    assert wall.half_extents == (1.0, 0.01, 0.5)
    assert wall.T_base_box[:3, 0] == pytest.approx([0.0, 1.0, 0.0])
    assert isinstance(cell.device(Arm), Arm)
    cell.check()
    cell.clock.advance(0.1)
    assert cell.clock.now() == pytest.approx(0.1)
    cell.close()


def test_an_obstacle_with_a_wall_is_a_crate_open_at_the_top(load):
    crate = "{name: crate, centre: 0.4 0.1 0.05 m, size: 0.3 0.2 0.1 m, wall: 1 cm, yaw: 90 deg}"
    boxes = (
        load(MOCK.replace("yaw: 90 deg}]", f"yaw: 90 deg}}, {crate}]"))
        .device(Workspace)
        .obstacles[1:]
    )
    assert [box.name for box in boxes] == ["crate"] * 5

    def filled(point: list[float]) -> bool:
        inside = [np.linalg.inv(box.T_base_box) @ [*point, 1.0] for box in boxes]
        return any(
            (np.abs(p[:3]) <= box.half_extents).all() for p, box in zip(inside, boxes, strict=True)
        )

    assert filled([0.4, 0.1, 0.005])  # the floor
    assert not filled([0.4, 0.1, 0.011])
    assert not filled(
        [0.4 + 0.089, 0.1 + 0.139, 0.099]
    )  # turned by a quarter: 0.2 along x, 0.3 along y
    assert filled([0.4 + 0.091, 0.1, 0.099])
    assert filled([0.4, 0.1 - 0.141, 0.099])
    assert not filled([0.4, 0.1, 0.101])


@pytest.mark.parametrize("wall", ["0 mm", "10 cm", "-1 mm", "soon"])
def test_a_crate_whose_walls_leave_no_room_is_refused_with_its_line(load, wall):
    crate = f"{{name: crate, centre: 0 0 0 m, size: 0.2 0.2 0.1 m, wall: {wall}}}"
    with pytest.raises(CellFileError, match=r"cell\.yaml:8:.*wall"):
        load(
            MOCK.replace(
                "{name: wall, centre: 0 1 0 m, size: [2 m, 20 mm, 1 m], yaw: 90 deg}", crate
            )
        )


def test_the_shipped_simulated_cell_loads():
    cell = load_cell(CELLS / "sim.yaml", seed=1)
    assert cell.kind == "simulated"
    assert cell.clock.simulated
    assert set(cell.interfaces()) == {
        Arm,
        StreamedArm,
        Gripper,
        ForceSensor,
        Pads,
        Camera,
        Hands,
        Workspace,
    }
    assert cell.device(Arm).description.name == "sia5f_wsg32.xml"
    assert cell.device(Workspace).table_z == pytest.approx(-0.12)
    assert np.abs(cell.device(Arm).state().q - cell.device(Workspace).poses["observe"]).max() < 1e-3
    assert cell.truth()["fruit"] == "apple_1"
    cell.close()


@pytest.mark.parametrize(
    ("overrides", "says"),
    [
        ({"fruit": "apple_9"}, "did you mean 'apple_"),
        ({"place": "7"}, "cannot be '7'"),
        ({"others": "9"}, "must be between 0 and 4"),
        ({"frut": "apple_1"}, "did you mean 'fruit'"),
        ({"friction": "slippery"}, "not a number"),
        ({"skin": "blue"}, "known: any, red, striped, yellow, green, lemon"),
        ({"mass": "3 m"}, "no unit of mass"),
    ],
)
def test_bad_overrides_of_the_simulated_cell_are_reported(overrides, says):
    with pytest.raises(CellFileError) as error:
        load_cell(CELLS / "sim.yaml", overrides=overrides)
    assert says in str(error.value)


@pytest.mark.parametrize(
    ("old", "new", "line", "says"),
    [
        ("kind: mock", "kind: moc", 3, "did you mean 'mock'"),
        ("driver: mock-arm,", "driver: mock-amr,", 12, "did you mean 'mock-arm'"),
        ("start: home", "start: hoem", 12, "did you mean 'home'"),
        ("start: home", "speed: 3", 12, "no setting 'speed'"),
        ("home: 0 ", "home: 9 ", 9, "180.0°"),
        ("home: 0 0 ", "home: 0 ", 9, "has 6 joints, the arm has 7"),
        ("lower: -1", "lower: 7", 7, "above workspace.lower"),
        ("world: {driver: mock}", "clock: manual", 12, "needs the mock world"),
        ("name: bench", "nam: bench", 2, "no setting 'nam'"),
        ("80 mm", "80 kg", 14, "no unit of length"),
        ("driver: mock}", "driver: mock-camera}", 10, "simulates no world"),
        ("devices:", "device:", 2, "needs 'devices'"),
        ("size: [2 m, 20 mm, 1 m]", "size: 2 0 1 m", 8, "positive sizes"),
        (
            "camera: {driver: mock-camera}",
            "a: {driver: mock-gripper}",
            15,
            "'gripper' is a Gripper, too",
        ),
    ],
)
def test_mistakes_in_a_cell_file_have_a_place(load, old, new, line, says):
    assert old in MOCK
    with pytest.raises(CellFileError) as error:
        load(MOCK.replace(old, new))
    assert says in str(error.value)
    assert error.value.line == line


def test_of_several_cameras_a_skill_sees_through_all(load):
    with closing(load(f"{MOCK}  other: {{driver: mock-camera}}\n")) as cell:
        assert len(cell.device(Cameras).all) == 2


class Recorder(Device):
    interfaces = (Camera,)
    closed: ClassVar[list[str]] = []

    def close(self):
        self.closed.append(self.name)


@dataclass(frozen=True, kw_only=True)
class RecorderOptions:
    """Of a third party's camera."""

    label: str = value(Text())


def connect_recorder(settings, context: ConnectContext):
    assert context.cell.name == "cell.yaml"
    assert context.find(Device) is None or context.find(Camera).name == "first"
    return Recorder(settings.values.label)


def connect_lost(settings, context):
    raise DeviceLost("lost", "does not answer")


@pytest.mark.parametrize("kind", ["simulated", "mock", "frames"])
def test_a_cell_whose_devices_outlive_this_process_does_not_call_itself_a_simulated_one(load, kind):
    text = "kind: {}\ndevices: {{gripper: {{driver: wsg, tcp: 127.0.0.1:1}}}}\n"
    with pytest.raises(CellFileError, match=f"the cell's kind is real or emulated, not {kind}"):
        load(text.format(kind))
    with pytest.raises(CellFileError, match=r"is the gripper switched on"):
        load(text.format("real"))


def test_a_third_partys_driver_is_found_and_open_devices_are_closed_on_an_error(load, monkeypatch):
    drivers = {"recorder": RECORDER, "lost": Entry(Driver(Recorder, NoOptions, connect_lost))}
    monkeypatch.setattr(driver_module, "installed_drivers", lambda: drivers)
    text = "kind: real\ndevices:\n  first: {driver: recorder, label: a}\n  second: {driver: recorder, label: b}\n"
    cell = load(text)
    assert isinstance(cell.clock, SystemClock)
    assert cell.truth() is None
    cell.close()
    assert Recorder.closed == ["second", "first"]
    Recorder.closed.clear()
    with pytest.raises(DeviceLost):
        load(text + "  third: {driver: lost}\n")
    assert Recorder.closed == ["second", "first"]


class Entry:
    def __init__(self, function):
        self.value, self.load = "test", lambda: function


RECORDER = Entry(Driver(Recorder, RecorderOptions, connect_recorder))


def test_a_cell_without_world_can_have_a_manual_clock(load, monkeypatch):
    monkeypatch.setattr(driver_module, "installed_drivers", lambda: {"recorder": RECORDER})
    cell = load("kind: frames\nclock: manual\ndevices: {first: {driver: recorder, label: a}}\n")
    assert isinstance(cell.clock, ManualClock)
    with pytest.raises(KeyError, match="no Arm"):
        cell.device(Arm)


def test_the_shipped_drivers_are_known_by_name():
    assert {
        "mujoco",
        "sim-arm",
        "sim-gripper",
        "sim-fingers",
        "sim-camera",
        "mock-arm",
    } <= installed_drivers().keys()


@settings(max_examples=200)
@given(
    st.integers(0, len(MOCK) - 1),
    st.integers(0, 12),
    st.text("abz:{}[]-0.\"'#&*!|>%@\n\t, é", max_size=4),
)
def test_a_damaged_cell_file_is_refused_in_words_or_works(load, at, length, inserted):
    try:
        cell = load(MOCK[:at] + inserted + MOCK[at + length :])
    except CellFileError as refused:
        message = str(refused)
    else:
        message = "cell.yaml" if cell.devices is not None else ""
        cell.close()
    assert "cell.yaml" in message
