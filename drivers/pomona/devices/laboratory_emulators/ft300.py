"""A Robotiq FT 300 that speaks its bytes: a write to register 410 starts its stream, 50 times ff ends it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pomona.devices.emulators.emulated import EmulatedDevice, EmulatedWire, EmulatorKind
from pomona.devices.emulators.server import Peer
from pomona.devices.laboratory_emulators.ports import SensorLine
from pomona.devices.robotiq.codec import crc
from pomona.devices.wrist_sensors.codec import STOP, frame, start_stream
from pomona.drivers import Cell, LoadSensor
from pomona.executive import Float64

PERIOD = 0.01  # of the stream [s]
NOISE = 0.03  # standard deviation of a force [N], a tenth of it of a torque [N·m]: plausible, not measured


class Ft300Emulator(SensorLine):
    """The sensor. Faults: `silent`, `noise` (wrong check sums), `stuck` (the same value again).

    Attributes:
        wrench: called for the wrench on the flange, shape (6,) [N, N·m].
    """

    # all but the check sum
    known_faults = ("silent", "noise", "stuck")
    intact = 14

    def __init__(self, wrench: Callable[[], Float64]) -> None:
        super().__init__()
        self.wrench = wrench
        self._rng = np.random.default_rng(300)

    def on_bytes(self, peer: Peer, buffer: bytearray) -> None:
        if STOP in buffer:
            self.period = 0.0
            del buffer[: buffer.index(STOP) + len(STOP)]
        while buffer[:1] == b"\xff":
            del buffer[:1]
        request = start_stream()
        if request in buffer:
            buffer.clear()
            self.period = PERIOD
            if self.fault != "silent":
                peer.send(request[:6] + crc(request[:6]))

    def measured(self) -> bytes:
        scale = np.array([NOISE] * 3 + [0.1 * NOISE] * 3)
        return frame(self.wrench() + self._rng.normal(0.0, 1.0, 6) * scale)


def _make(cell: Cell, addresses: tuple[str, ...]) -> EmulatedDevice:
    sensor = cell.device(LoadSensor)

    def wrench() -> Float64:
        sample = sensor.latest()
        return np.zeros(6) if sample is None else sample.wrenches[0]

    emulator = Ft300Emulator(wrench)
    return EmulatedDevice(
        (EmulatedWire("wire", addresses[0], emulator),), emulator.advance, {"controller": emulator}
    )


FT300 = EmulatorKind(lambda address: (address,), _make)
"""On a serial line."""
