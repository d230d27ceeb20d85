"""A port of an emulated controller: its peers and their bytes, unless a fault keeps them away."""

from __future__ import annotations

from typing import Any

from pomona.devices.emulators.server import Peer


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
