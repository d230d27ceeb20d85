"""A Robotiq FT 300 that speaks its bytes: a write to register 410 starts its stream, 50 times ff ends it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pomona.devices.emulators.emulated import EmulatedDevice, EmulatedWire, EmulatorKind
from pomona.devices.emulators.server import Peer
from pomona.devices.laboratory_emulators.ports import SensorLine, crc
from pomona.drivers import Cell, LoadSensor
from pomona.executive import Float64

STARTING = b"\x09\x10\x01\x9a\x00\x01\x02\x02\x00\xcd\xca"
ENDING = b"\xff" * 50
"""Bytes that start and end the stream (FT 300 instruction manual)."""
PERIOD = 0.01  # of the stream [s]
NOISE = 0.03  # standard deviation of a force [N], a tenth of it of a torque [N·m]: plausible, not measured

SHARES = np.array([1.0] * 3 + [0.1] * 3)  # of noise and of counts, 0.01 N, for force and torque


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
        if ENDING in buffer:
            self.period = 0.0
            del buffer[: buffer.index(ENDING) + len(ENDING)]
        while buffer[:1] == b"\xff":
            del buffer[:1]
        if STARTING in buffer:
            buffer.clear()
            self.period = PERIOD
            if self.fault != "silent":
                peer.send(STARTING[:6] + crc(STARTING[:6]))

    def measured(self) -> bytes:
        noisy = self.wrench() + NOISE * SHARES * self._rng.normal(0.0, 1.0, 6)
        counts = np.clip(np.round(100.0 * noisy / SHARES), -32768, 32767)
        body: bytes = b" N" + counts.astype("<i2").tobytes()
        return body + crc(body)


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
