"""Two Robotiq TSF-85 fingertips that speak their bytes: one command starts packets of taxels, another ends them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pomona.devices.emulators.emulated import EmulatedDevice, EmulatedWire, EmulatorKind
from pomona.devices.emulators.server import Peer
from pomona.devices.fingertips.codec import AUTOSEND, START, TAXELS, packet
from pomona.drivers import Cell, FaultSwitch, ForceSensor

COUNT = 2e-4  # force of one count of a finger's sum [N]
IDLE, NOISE = 900, 2.0  # counts of a taxel without contact, and their standard deviation: plausible, not measured


class Tsf85Emulator(FaultSwitch):
    """The fingertips. Faults: `silent`, `garbage` (other bytes), `stuck` (the same values again).

    Attributes:
        pressing: called for the pressing forces of the left and the right finger [N].
    """

    known_faults = ("silent", "garbage", "stuck")

    def __init__(self, pressing: Callable[[], tuple[float, float]]) -> None:
        super().__init__()
        self.pressing = pressing
        self._peers: dict[int, tuple[Peer, bytearray]] = {}
        self._period, self._next = 0.0, 0.0
        self._rng = np.random.default_rng(85)
        self._sent = b""

    def connected(self, peer: Peer) -> None:
        self._peers[id(peer)] = (peer, bytearray())

    def disconnected(self, peer: Peer) -> None:
        self._peers.pop(id(peer), None)

    def received(self, peer: Peer, chunk: bytes) -> None:
        buffer = self._peers[id(peer)][1]
        buffer += chunk
        while len(buffer) >= 5:
            if buffer[0] == START and buffer[2] == AUTOSEND:
                self._period = 1e-3 * buffer[4]
            del buffer[: 4 + buffer[3] if buffer[0] == START else 1]

    def advance(self, now: float) -> None:
        """Send the packets that are due by `now` [s]."""
        if not self._period or now < self._next:
            return
        self._next = max(self._next + self._period, now)
        if self.fault == "silent":
            return
        if self.fault != "stuck" or not self._sent:
            idle = self._rng.normal(IDLE, NOISE, (2, TAXELS))
            pressed = np.maximum(self.pressing(), 0.0)[:, None] / COUNT / TAXELS
            self._sent = packet(np.clip(np.round(idle + pressed), 0, 65535).astype(int).tolist())
        for peer, _ in tuple(self._peers.values()):
            peer.send(bytes(len(self._sent)) if self.fault == "garbage" else self._sent)


def _make(cell: Cell, addresses: tuple[str, ...]) -> EmulatedDevice:
    fingers = cell.device(ForceSensor)

    def pressing() -> tuple[float, float]:
        sample = fingers.latest()
        return (0.0, 0.0) if sample is None else (-float(sample.wrenches[0, 2]), -float(sample.wrenches[1, 2]))

    emulator = Tsf85Emulator(pressing)
    return EmulatedDevice((EmulatedWire("wire", addresses[0], emulator),), emulator.advance, {"controller": emulator})


TSF85 = EmulatorKind(lambda address: (address,), _make)
"""On a serial line."""
