"""Common parts of drivers on a wire: links that move bytes, priority for their threads, typed errors."""

from __future__ import annotations

import contextlib
import os
import select
import socket
import threading
from collections.abc import Callable, Mapping
from typing import Protocol

from pomona.executive.cell.errors import DeviceLost, DriverError
from pomona.executive.values.kinds import ScalarKind, Schema
from pomona.executive.values.yaml_nodes import Unfit


class Malformed(DriverError):
    """Bytes that are no message of the protocol."""

    def __init__(self, received: bytes, message: str) -> None:
        self.received = received
        shown = received[:32].hex(" ") + (" …" if len(received) > 32 else "")
        super().__init__(f"{message}: {shown or 'no byte'}")


class Nonsense(DeviceLost):
    """A device that answers with bytes outside its protocol: the peer counts as lost."""

    def __init__(self, device: str, malformed: Malformed) -> None:
        self.received = malformed.received
        super().__init__(device, f"answered nonsense: {malformed}")


class Link(Protocol):
    """Moves bytes. Everything that goes wrong with the wire is an OSError."""

    def send(self, chunk: bytes) -> None:
        """Send bytes; raises OSError when the link is gone."""

    def receive(self, timeout: float) -> bytes:
        """Return the received bytes, waiting up to `timeout` [s] for the first one; empty without any."""

    def close(self) -> None: ...


class TcpLink:
    """A TCP connection to a device."""

    def __init__(self, host: str, port: int, deadline: float = 2.0) -> None:
        """Connect within `deadline` [s]. Raises OSError: there is no answer."""
        self._socket = socket.create_connection((host, port), deadline)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket.settimeout(0.05)  # of a send: a full buffer means that the peer does not read any more

    def send(self, chunk: bytes) -> None:
        self._socket.sendall(chunk)

    def receive(self, timeout: float) -> bytes:
        ready, _, _ = select.select([self._socket], [], [], max(timeout, 0.0))
        if not ready:
            return b""
        chunk = self._socket.recv(65536)
        if not chunk:
            raise ConnectionResetError("the device closed the connection")
        return chunk

    def close(self) -> None:
        with contextlib.suppress(OSError):
            self._socket.shutdown(socket.SHUT_RDWR)
        self._socket.close()


URGENT = -10  # niceness of threads that serve a wire, where the system allows it


def raise_priority() -> None:
    """Let the calling thread run before others; without the right to do so (CAP_SYS_NICE) nothing changes."""
    with contextlib.suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), URGENT)


class Address(ScalarKind[tuple[str, int]]):
    """HOST or HOST:PORT, as (host, port)."""

    words = "an address: HOST or HOST:PORT"

    def __init__(self, port: int) -> None:
        self.port = port

    def parse(self, text: str) -> tuple[str, int]:
        host, _, port = text.strip().rpartition(":") if ":" in text else (text.strip(), "", "")
        if not host or (port and not (port.isascii() and port.isdigit() and 0 < int(port) < 65536)):
            raise Unfit(f"'{text}' is not an address: write HOST or HOST:PORT")
        return host, int(port) if port else self.port

    def plain_schema(self) -> Schema:
        return {"type": "string", "examples": [f"192.168.1.2:{self.port}"]}


def tcp_opener(host: str, port: int, wires: Mapping[str, Callable[[], Link]]) -> Callable[[], Link]:
    """How to connect to a device: by TCP, unless one of `wires` leads to this address."""
    return wires.get(f"{host}:{port}") or (lambda: TcpLink(host, port))
