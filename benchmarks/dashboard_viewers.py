"""Viewers of a dashboard that cost little themselves, for benchmarks with many."""

from __future__ import annotations

import selectors
import socket
import time
from typing import Any

HANDSHAKE = (
    b"GET /live HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n"
)
PING, PONG = 0x89, 0x8A


class RawViewer:
    """A live stream that is read and discarded, with pings answered: it leaves out a viewer's own cost."""

    def __init__(self, port: int) -> None:
        self.socket = socket.create_connection(("127.0.0.1", port))
        self.socket.sendall(HANDSHAKE)
        self._head, self._skip = b"", 0
        while b"\r\n\r\n" not in self._head:
            self._head += self.socket.recv(4096)
        self._head = self._head.partition(b"\r\n\r\n")[2]
        self.socket.setblocking(False)
        self._walk()

    def read(self) -> None:
        """Read the waiting messages."""
        self._head += self.socket.recv(1 << 16)
        self._walk()

    def _walk(self) -> None:
        while self._head:
            if self._skip:
                left = self._head[self._skip :]
                self._skip = max(0, self._skip - len(self._head))
                self._head = left
                continue
            wide = {126: 2, 127: 8}.get(self._head[1] if len(self._head) > 1 else 127, 0)
            if len(self._head) < 2 + wide:
                return
            length = int.from_bytes(self._head[2 : 2 + wide], "big") if wide else self._head[1]
            if self._head[0] == PING:
                if len(self._head) < 2 + length:
                    return
                self.socket.send(
                    bytes((PONG, 0x80 | length, 0, 0, 0, 0)) + self._head[2 : 2 + length]
                )
            self._skip = 2 + wide + length


def watch(port: int, viewers: int, stuck: bool, stop: Any) -> None:
    """Viewers in a process of their own; stuck ones read nothing."""
    chosen = selectors.DefaultSelector()
    for _ in range(viewers):
        viewer = RawViewer(port)
        chosen.register(viewer.socket, selectors.EVENT_READ, viewer)
    while not stop.is_set():
        if stuck:
            time.sleep(0.2)
            continue
        for key, _events in chosen.select(0.2):
            key.data.read()
