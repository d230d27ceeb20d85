"""A bench of every force sensor that ships."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from pomona.devices.emulators.motoman import FreeJoints
from pomona.devices.emulators.pipes import Pipe
from pomona.devices.emulators.suntouch import SunTouchEmulator
from pomona.devices.emulators.switches import finger_switch
from pomona.devices.fingertips.driver import TsfFingertips, TsfSession
from pomona.devices.laboratory_emulators.ft300 import Ft300Emulator
from pomona.devices.laboratory_emulators.tsf85 import COUNT, Tsf85Emulator
from pomona.devices.laboratory_emulators.universal_robots import UrEmulator
from pomona.devices.suntouch.driver import SunTouchFingers
from pomona.devices.suntouch.finger import Finger
from pomona.devices.wrist_sensors.sensor import StreamOptions, WristSensor
from pomona.devices.wrist_sensors.sessions import Ft300Session, UrForceSession
from pomona.drivers import FaultSwitch
from pomona.drivers.conformance import ForceBench, Press, Wire
from pomona.tools.mock import MockClock, MockForceSensor
from tests.drivers.conformance.grippers import timed
from tests.drivers.conformance.simulated import simulated
from tests.drivers.devices.suntouch.test_driver import CALIBRATION

NOT_NOTICED = ("deaf", "half")
"""Of a sensor that streams: it need not hear, and its next packet is whole again."""


def ft300() -> ForceBench:
    """The FT 300 on its serial line."""
    clock, time = timed()
    press = Press(clock)
    device = Ft300Emulator(press.wrench)
    clock.each_step.append(device.advance)
    wire = Wire(Pipe(device, time).open, keeps=False)
    sensor = WristSensor(
        lambda: Ft300Session("load", wire.open(), time),
        time,
        StreamOptions(100.0, 0.1, 300.0),
        1.5,
        0.5,
    )
    sensor.connect()
    return ForceBench(sensor, time, press, wire, device, without=("silent", *NOT_NOTICED))


def ur_force() -> ForceBench:
    """The force at the tool of a Universal Robots arm."""
    clock, time = timed()
    press = Press(clock)
    device = UrEmulator(FreeJoints(np.zeros(6)), np.full(6, 3.0))
    rng = np.random.default_rng(1)
    device.tcp_force = lambda: (  # type: ignore[method-assign]
        press.wrench() + rng.normal(0.0, 0.01, 6)
    ).tolist()
    clock.each_step.append(device.advance)
    wire = Wire(Pipe(device.rtde, time).open)
    sensor = WristSensor(
        lambda: UrForceSession("load", wire.open(), time, 125.0),
        time,
        StreamOptions(125.0, 0.1, 50.0),
        1.5,
        0.5,
    )
    sensor.connect()
    return ForceBench(sensor, time, press, wire, without=NOT_NOTICED)


def tsf85() -> ForceBench:
    """The fingertips."""
    clock, time = timed()
    press = Press(clock)
    device = Tsf85Emulator(lambda: (press.force(), press.force()))
    clock.each_step.append(device.advance)
    wire = Wire(Pipe(device, time).open, keeps=False)
    zero: list[Any] = [None]

    def opened() -> TsfSession:
        session = TsfSession("fingers", wire.open(), time, 0.01, COUNT, zero[0])
        zero[0] = tuple(session.zero)
        return session

    sensor = TsfFingertips(opened, time, StreamOptions(100.0, 0.1, 30.0), "fingers")
    sensor.connect()
    return ForceBench(sensor, time, press, wire, device, without=("silent", *NOT_NOTICED))


class Lies(FaultSwitch):
    """What mock fingers say instead of the truth."""

    known_faults = ("dead", "nan", "odd", "stuck")

    def __init__(self, sensor: MockForceSensor) -> None:
        super().__init__()
        self._sensor = sensor
        self._feel = sensor.feel

    def inject_fault(self, kind: str) -> None:
        super().inject_fault(kind)
        if kind == "dead":
            self._sensor.lose(1e9)
        else:
            value = {"nan": np.nan, "odd": 1e4, "stuck": 0.0}[kind]
            self._sensor.feel = lambda _now: np.full((2, 6), value)

    def clear_fault(self) -> None:
        super().clear_fault()
        self._sensor.lose(0.0)
        self._sensor.feel = self._feel


class InStep(ForceBench):
    """A sensor that its clock moves."""

    def step(self) -> None:
        self.clock.advance(0.002)
        self.problem()


def mock() -> ForceBench:
    """The mock fingers."""
    clock = MockClock()
    press = Press(clock)
    sensor = MockForceSensor(clock, lambda _now: np.array([press.wrench()] * 2))
    return InStep(sensor, clock, press, Lies(sensor), without=("stuck",))  # its ripple is live


SEEN = ("lost", "stuck_left", "stuck_right", "stuck", "zero", "late_120")
"""Faults of the simulated fingers that their stream alone can show."""


def sim() -> ForceBench:
    """The simulated fingers, which nothing touches."""
    cell = simulated("fingers")
    sensor: Any = cell.devices["fingers"]
    press = Press(cell.clock)
    others = tuple(fault for fault in sensor.known_faults if fault not in SEEN)
    bench = InStep(sensor, cell.clock, press, sensor, without=others)
    press.began = np.inf
    return bench


def suntouch() -> ForceBench:
    """Two fingers, each on its line; the left one's can be harmed."""
    clock, time = timed()
    press = Press(clock)
    pads = [SunTouchEmulator(press.wrench, seed) for seed in (0, 1)]
    left = Wire(Pipe(pads[0], time).open, keeps=False)
    fingers = (
        Finger(left.open, CALIBRATION, time),
        Finger(Pipe(pads[1], time).open, replace(CALIBRATION, finger="other"), time),
    )
    sensor = SunTouchFingers(*fingers, time)
    sensor.connect()
    return ForceBench(
        sensor,
        time,
        press,
        left,
        finger_switch(pads[0]),
        tolerance=2.0,  # its calibration is one of grips: it errs by 40 % under a plain press
        without=("deaf", "half", "lost", "slow", "noise"),  # its answers have no check sum
    )


BENCHES: dict[str, Callable[[], ForceBench]] = {
    "ft300": ft300,
    "ur_force": ur_force,
    "tsf85": tsf85,
    "suntouch": suntouch,
    "sim": sim,
    "mock": mock,
}
