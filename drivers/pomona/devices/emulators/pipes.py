"""Wires inside one process: the driver's bytes reach the device at once; its answers arrive when time advances."""

from __future__ import annotations

import contextlib
from collections import deque

from pomona.devices.emulators.server import Emulator
from pomona.devices.emulators.virtual_time import VirtualTime
from pomona.drivers import FaultSwitch

LATE = 0.15  # delay that the fault `late` adds to bytes for the driver [s]


class Pipe(FaultSwitch):
    """A place where a driver finds an emulated device; `open` gives the driver's end, a `pomona.drivers.Link`.

    Faults: `cut` (every connection breaks, and none can be opened), `silent` (nothing arrives at either end), `late`,
    `lossy` and `garbage` (of the bytes to the driver).
    """

    known_faults = ("cut", "silent", "late", "lossy", "garbage")

    def __init__(self, emulator: Emulator, time: VirtualTime, latency: float = 0.0) -> None:
        """
        Args:
            latency: from the device to the driver [s].
        """
        super().__init__()
        self.emulator = emulator
        self.time = time
        self.latency = latency
        self._ends: list[PipeEnd] = []

    def open(self) -> PipeEnd:
        """Connect. Raises ConnectionRefusedError: the wire is cut."""
        if self.fault == "cut":
            raise ConnectionRefusedError("no answer: the wire is cut")
        end = PipeEnd(self)
        self._ends.append(end)
        self.emulator.connected(end.peer)
        return end

    def inject_fault(self, kind: str) -> None:
        super().inject_fault(kind)
        if kind == "cut":
            self.hang_up()

    def hang_up(self) -> None:
        """Break every connection; new ones can be opened."""
        for end in tuple(self._ends):
            self.drop(end)

    def drop(self, end: PipeEnd) -> None:
        """End a connection, from either side."""
        if end in self._ends:
            self._ends.remove(end)
            end.broken = True
            self.emulator.disconnected(end.peer)


class PipeEnd:
    """The driver's end of a connection, and the `Peer` that the emulated device sees."""

    def __init__(self, pipe: Pipe) -> None:
        self.broken = False
        self.peer = _Peer(self)
        self._pipe = pipe
        self._arriving: deque[tuple[float, bytes]] = deque()
        self._count = 0

    def send(self, chunk: bytes) -> None:
        """As `Link.send`."""
        self._need_connection()
        if self._pipe.fault != "silent":
            self._pipe.emulator.received(self.peer, chunk)

    def receive(self, timeout: float) -> bytes:
        """As `Link.receive`; meanwhile time passes for everybody."""
        self._need_connection()
        self._pipe.time.wait(timeout, self._has_something)
        self._need_connection()
        now = self._pipe.time.now()
        chunks = []
        while self._arriving and self._arriving[0][0] <= now + 1e-9:
            chunks.append(self._arriving.popleft()[1])
        return b"".join(chunks)

    def close(self) -> None:
        """Hang up."""
        self._pipe.drop(self)

    def arrive(self, chunk: bytes) -> None:
        """Bytes from the device."""
        pipe = self._pipe
        if pipe.fault == "silent":
            return
        if pipe.fault == "lossy":
            # interval of lost bytes of the fault `lossy`, towards the driver
            kept = [byte for place, byte in enumerate(chunk, self._count) if place % 7]
            self._count += len(chunk)
            chunk = bytes(kept)
        elif pipe.fault == "garbage":
            chunk = bytes(byte ^ 0x5A for byte in chunk)
        due = pipe.time.now() + pipe.latency + (LATE if pipe.fault == "late" else 0.0)
        self._arriving.append((due, chunk))

    def _has_something(self) -> bool:
        now = self._pipe.time.now()
        return self.broken or bool(self._arriving and self._arriving[0][0] <= now + 1e-9)

    def _need_connection(self) -> None:
        if self.broken:
            raise ConnectionResetError("the connection is broken")


class _Peer:
    def __init__(self, end: PipeEnd) -> None:
        self._end = end

    def send(self, chunk: bytes) -> None:
        self._end.arrive(chunk)

    def close(self) -> None:
        with contextlib.suppress(OSError):
            self._end.close()
