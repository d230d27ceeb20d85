"""A port of an emulated controller: its peers and their bytes, unless a fault keeps them away; a sensor on a line."""

from __future__ import annotations

from abc import abstractmethod
from functools import lru_cache
from typing import Any

from pomona.devices.emulators.server import Peer
from pomona.drivers import FaultSwitch


@lru_cache(64)
def crc(message: bytes) -> bytes:
    """Return the check sum of Modbus on a serial line, low byte first."""
    check = 0xFFFF
    for bit in range(8 * len(message)):
        odd = (check ^ message[bit // 8] >> bit % 8) & 1
        check = check >> 1 ^ 0xA001 * odd
    return check.to_bytes(2, "little")


class ControllerPort:
    """One of the ports of a controller with the attributes `fault` and `deaf` (nothing passes at any port)."""

    def __init__(self, controller: Any) -> None:
        self._robot = controller
        self._peers: dict[int, tuple[Peer, bytearray]] = {}

    def connected(self, peer: Peer) -> None:
        if self._robot.fault == "killed":
            peer.close()
        else:
            self._peers[id(peer)] = (peer, bytearray())

    def disconnected(self, peer: Peer) -> None:
        self._peers.pop(id(peer), None)

    def received(self, peer: Peer, chunk: bytes) -> None:
        if not self._robot.deaf and id(peer) in self._peers:
            buffer = self._peers[id(peer)][1]
            buffer += chunk
            self.on_bytes(peer, buffer)

    def send(self, chunk: bytes) -> None:
        """Send bytes to all peers."""
        for peer, _ in tuple(self._peers.values()):
            peer.send(chunk)

    def hang_up(self) -> None:
        """End all connections."""
        for peer, _ in tuple(self._peers.values()):
            peer.close()

    def on_bytes(self, peer: Peer, buffer: bytearray) -> None:
        """Take the complete messages."""

    def advance(self, now: float) -> None:
        """Time belongs to the controller."""


class SensorLine(FaultSwitch, ControllerPort):
    """A sensor that streams on one serial line. Faults: `silent`, `stuck` (the same bytes again), and one that spoils.

    Attributes:
        period: of the stream [s]; 0 while there is none. intact: bytes at the beginning that are not spoiled.
    """

    deaf = False
    period = 0.0
    intact = 0
    _next = 0.0
    _sent = b""

    def __init__(self) -> None:
        super().__init__()
        ControllerPort.__init__(self, self)

    @abstractmethod
    def measured(self) -> bytes:
        """Return the bytes of a new measurement."""

    def advance(self, now: float) -> None:
        """Send the measurement that is due by `now` [s]."""
        if not self.period or now < self._next:
            return
        self._next = max(self._next + self.period, now)
        if self.fault != "stuck" or not self._sent:
            self._sent = self.measured()
        if self.fault != "silent":
            whole = self.fault in (None, "stuck")
            self.send(
                self._sent if whole else self._sent[: self.intact].ljust(len(self._sent), b"\0")
            )
