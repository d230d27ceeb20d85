"""A serial line to a device."""

from __future__ import annotations

import os
import select
from collections.abc import Callable, Mapping

import serial
from serial.tools import list_ports

from pomona.executive.cell.owner import Link


class SerialLink:
    """A serial port that is read as soon as something is there; POSIX only."""

    def __init__(self, port: str, baud: int) -> None:
        """Open the port exclusively, 8N1. Raises OSError: it cannot be opened."""
        self._port = serial.Serial(port, baud, timeout=0, exclusive=True)
        self._descriptor = self._port.fileno()
        self._port.reset_input_buffer()

    def send(self, chunk: bytes) -> None:
        """Hand bytes to the port.

        Raises:
            OSError: the port is gone, or its buffer is full because the device does not read.
        """
        # Not `Serial.write`: its timeout also strikes when this thread was held up after the bytes had gone.
        if os.write(self._descriptor, chunk) != len(chunk):
            raise BlockingIOError("the serial port takes no more bytes")

    def receive(self, timeout: float) -> bytes:
        ready, _, _ = select.select([self._descriptor], [], [], max(timeout, 0.0))
        if not ready:
            return b""
        chunk = os.read(self._descriptor, 4096)
        if not chunk:
            raise ConnectionResetError("the serial port is gone")
        return chunk

    def close(self) -> None:
        self._port.close()


def serial_opener(
    port: str, baud: int, wires: Mapping[str, Callable[[], Link]]
) -> Callable[[], Link]:
    """How to open a serial line, unless one of `wires` leads to this port."""
    return wires.get(port) or (lambda: SerialLink(port, baud))


def serial_ports() -> str:
    """Return the serial ports of this machine in words, with the names of connected devices if known."""
    found = [
        port.device if port.description in ("", "n/a") else f"{port.device} ({port.description})"
        for port in list_ports.comports()
    ]
    return f"serial ports of this machine: {', '.join(found) or 'none'}"
