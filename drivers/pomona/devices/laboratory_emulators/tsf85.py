"""Two Robotiq TSF-85 fingertips that speak their bytes: one command starts packets of taxels, another ends them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pomona.devices.emulators.emulated import EmulatedDevice, EmulatedWire, EmulatorKind
from pomona.devices.emulators.server import Peer
from pomona.devices.laboratory_emulators.ports import SensorLine
from pomona.drivers import Cell, ForceSensor

TAXELS = 28  # of a finger
COUNT = 2e-4  # force of one count of a finger's sum [N]
# counts of a taxel without contact, and their standard deviation: plausible, not measured
IDLE = 900
NOISE = 2.0


class Tsf85Emulator(SensorLine):
    """The fingertips. Faults: `silent`, `garbage` (other bytes), `stuck` (the same values again).

    Attributes:
        pressing: called for the pressing forces of the left and the right finger [N].
    """

    known_faults = ("silent", "garbage", "stuck")

    def __init__(self, pressing: Callable[[], tuple[float, float]]) -> None:
        super().__init__()
        self.pressing = pressing
        self._rng = np.random.default_rng(85)

    def on_bytes(self, peer: Peer, buffer: bytearray) -> None:
        while len(buffer) >= 5:
            if buffer[0] == 0x9A and buffer[2] == 0x58:
                self.period = 1e-3 * buffer[4]
            del buffer[: 4 + buffer[3] if buffer[0] == 0x9A else 1]

    def measured(self) -> bytes:
        idle = self._rng.normal(IDLE, NOISE, (2, TAXELS))
        pressed = np.maximum(self.pressing(), 0.0)[:, None] / COUNT / TAXELS
        left, right = np.clip(np.round(idle + pressed), 0, 65535).astype(">u2")
        body: bytes = b"\x10" + left.tobytes() + b"\x14" + right.tobytes()
        return b"\x9a\0\x61" + bytes([len(body)]) + body


def _make(cell: Cell, addresses: tuple[str, ...]) -> EmulatedDevice:
    fingers = cell.device(ForceSensor)

    def pressing() -> tuple[float, float]:
        sample = fingers.latest()
        return (
            (0.0, 0.0)
            if sample is None
            else (-float(sample.wrenches[0, 2]), -float(sample.wrenches[1, 2]))
        )

    emulator = Tsf85Emulator(pressing)
    return EmulatedDevice(
        (EmulatedWire("wire", addresses[0], emulator),), emulator.advance, {"controller": emulator}
    )


TSF85 = EmulatorKind(lambda address: (address,), _make)
"""On a serial line."""
