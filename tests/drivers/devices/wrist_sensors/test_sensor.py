"""Sensors at the wrist against their emulators, byte for byte, on a clock that the test moves."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pomona.devices.emulators.motoman import FreeJoints
from pomona.devices.laboratory_emulators.ft300 import Ft300Emulator
from pomona.devices.laboratory_emulators.universal_robots import UrEmulator
from pomona.devices.wrist_sensors.connect import UR_RANGE, connect_ft300, connect_ur_force
from pomona.devices.wrist_sensors.sensor import RECONNECT, StreamOptions, WristSensor
from pomona.devices.wrist_sensors.sessions import Ft300Session, UrForceSession
from pomona.drivers import CellFileError, ConnectContext, DeviceFault, DeviceLost, LoadSensor
from pomona.executive import ManualClock, SystemClock
from tests.drivers.device_settings import read_settings
from tests.drivers.devices.motoman.test_driver import Connection

PULL = np.array([1.5, -2.0, 10.0, 0.1, 0.2, -0.3])


class Cell:
    """An emulated sensor on a clock that the test moves; `cut` is the cable."""

    def __init__(self, kind: str) -> None:
        self.clock = ManualClock(30.0)
        self.cut, self.wrench = False, PULL.copy()
        self.opened: list[Connection] = []
        if kind == "ft300":
            self.device: Any = Ft300Emulator(lambda: self.wrench)
            self.port = self.device
        else:
            self.device = UrEmulator(FreeJoints(np.zeros(6)), np.full(6, 3.0))
            rng = np.random.default_rng(1)
            self.device.tcp_force = lambda: (self.wrench + rng.normal(0.0, 0.01, 6)).tolist()
            self.port = self.device.rtde
        self.kind = kind

    def open(self) -> Ft300Session | UrForceSession:
        if self.cut:
            raise ConnectionRefusedError("nothing answers")
        link = Connection(self, self.port)  # type: ignore[arg-type]
        self.opened.append(link)
        if self.kind == "ft300":
            return Ft300Session("load", link, self.clock)
        return UrForceSession("load", link, self.clock, 125.0)

    def let_pass(self, seconds: float, until: Callable[[], bool] = lambda: False) -> None:
        end = self.clock.now() + seconds
        while not until() and self.clock.now() < end - 1e-9:
            self.clock.advance(0.001)
            self.device.advance(self.clock.now())


def connected(cell: Cell) -> WristSensor:
    sensor = WristSensor(cell.open, cell.clock, StreamOptions(100.0, 0.1, 50.0), 1.5, 0.5)
    sensor.connect()
    return sensor


def serve(sensor: WristSensor, cell: Cell, seconds: float) -> None:
    end = cell.clock.now() + seconds
    while cell.clock.now() < end:
        before = cell.clock.now()
        sensor.step()
        if cell.clock.now() == before:
            cell.let_pass(0.001)


@pytest.fixture(params=["ft300", "ur"])
def cell(request: pytest.FixtureRequest) -> Cell:
    return Cell(request.param)


def test_it_streams_the_wrench_on_the_flange(cell: Cell) -> None:
    sensor = connected(cell)
    assert isinstance(sensor, LoadSensor)
    samples: list[Any] = []
    sensor.subscribe(samples.append)
    serve(sensor, cell, 0.5)
    assert 45 <= len(samples) <= 70
    assert all(
        sample.wrenches.shape == (1, 6) and sample.saturated == (False, False) for sample in samples
    )
    np.testing.assert_allclose(
        np.mean([sample.wrenches[0] for sample in samples], axis=0), PULL, atol=0.03
    )
    assert [b.sequence - a.sequence for a, b in itertools.pairwise(samples)] == [1] * (
        len(samples) - 1
    )
    sensor.check()
    assert sensor.link() == "ok"


def test_a_force_at_the_end_of_the_range_is_marked(cell: Cell) -> None:
    cell.wrench = np.array([0.0, 0.0, -60.0, 0.0, 0.0, 0.0])
    assert connected(cell).latest().saturated == (True, True)


def test_a_silent_sensor_is_lost_within_its_time_and_stays_so_until_it_is_acknowledged(
    cell: Cell,
) -> None:
    sensor = connected(cell)
    cell.device.inject_fault("silent")
    serve(sensor, cell, 0.115)
    with pytest.raises(DeviceLost, match=r"no sample for 1\d\d ms"):
        sensor.check()
    with pytest.raises(DeviceLost, match="still lost"):
        sensor.acknowledge()
    cell.device.clear_fault()
    serve(sensor, cell, 3.0)
    with pytest.raises(DeviceLost):
        sensor.check()
    sensor.acknowledge()
    sensor.check()
    before = sensor.latest().sequence
    serve(sensor, cell, 0.1)
    assert sensor.latest().sequence > before


def test_a_cut_cable_is_a_loss_and_the_wire_is_opened_again(cell: Cell) -> None:
    sensor = connected(cell)
    cell.cut = True
    cell.opened[-1].closed = True
    serve(sensor, cell, 0.2)
    with pytest.raises(DeviceLost):
        sensor.check()
    cell.cut = False
    serve(sensor, cell, RECONNECT + 1.5)
    sensor.acknowledge()
    sensor.check()


def test_a_sensor_that_repeats_its_value_is_faulty() -> None:
    cell = Cell("ft300")
    sensor = connected(cell)
    cell.device.inject_fault("stuck")
    serve(sensor, cell, 0.2)
    with pytest.raises(DeviceFault, match="the load sensor has reported the same to the last bit"):
        sensor.check()


def test_bytes_that_are_no_frames_are_no_sensor() -> None:
    cell = Cell("ft300")
    sensor = connected(cell)
    cell.device.inject_fault("noise")
    serve(sensor, cell, 0.3)
    with pytest.raises(DeviceLost):
        sensor.check()


def test_nothing_at_the_address_is_a_reason(cell: Cell) -> None:
    cell.device.inject_fault("silent")
    with pytest.raises(DeviceLost, match=r"no sample within 1 s|did not answer"):
        connected(cell)
    cell.cut = True
    with pytest.raises(DeviceLost, match="cannot be reached: nothing answers"):
        connected(cell)


def test_forces_of_a_universal_robots_arm_are_turned_into_the_tool() -> None:
    cell = Cell("ur")
    cell.device.tcp_pose = [0.3, 0.2, 0.1, np.pi, 0.0, 0.0]
    np.testing.assert_allclose(
        connected(cell).latest().wrenches[0], PULL * [1, -1, -1, 1, -1, -1], atol=0.06
    )


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        (
            "robotiq-ft300",
            "port: /dev/none\nmass: 1.2 kg",
            r"(?s):2:7: .*cannot be reached.*Modbus address 9",
        ),
        ("robotiq-ft300", "port: /dev/none", "mass"),
        (
            "universal-robots-force",
            "address: 127.0.0.88\nmass: 1.2 kg",
            r"(?s):2:10: .*cannot be reached.*30004",
        ),
        ("universal-robots-force", "address: h\nmass: 1.2 N", "mass"),
    ],
)
def test_a_wrong_setting_is_refused_with_its_place(
    tmp_path: Path, name: str, text: str, words: str
) -> None:
    path = tmp_path / "cell.yaml"
    path.write_text(f"driver: {name}\n{text}\n")
    connect = connect_ft300 if name == "robotiq-ft300" else connect_ur_force
    with pytest.raises(CellFileError, match=words):
        connect.connect(read_settings(connect, path), ConnectContext(path, SystemClock(), 0))
    assert UR_RANGE > 0.0
