"""What drivers of devices on a wire share: links that move bytes, the loop that serves one, typed complaints."""

from __future__ import annotations

import contextlib
import os
import select
import socket
import threading
from collections.abc import Callable
from queue import Empty, SimpleQueue
from typing import Protocol, runtime_checkable

from drivers.cell_file import Settings
from drivers.errors import DeviceFault, DriverError
from executive.clock import Clock


class Malformed(DriverError):
    """Bytes that are no message of the protocol."""

    def __init__(self, received: bytes, message: str) -> None:
        self.received = received
        shown = received[:32].hex(" ") + (" …" if len(received) > 32 else "")
        super().__init__(f"{message}: {shown or 'no byte'}")


class Nonsense(DeviceFault):
    """A device that answers with bytes that its protocol does not know."""

    def __init__(self, device: str, malformed: Malformed) -> None:
        self.received = malformed.received
        super().__init__(device, f"answered nonsense: {malformed}")


class Link(Protocol):
    """Moves bytes. Everything that goes wrong with the wire is an OSError."""

    def send(self, chunk: bytes) -> None: ...

    def receive(self, timeout: float) -> bytes:
        """What has arrived, waiting up to `timeout` [s] for the first byte; empty when nothing came."""
        ...

    def close(self) -> None: ...


class TcpLink:
    """A TCP connection to a device."""

    def __init__(self, host: str, port: int, deadline: float = 2.0) -> None:
        """Connect within `deadline` [s].

        Raises:
            OSError: nobody answers there.
        """
        self._socket = socket.create_connection((host, port), deadline)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._socket.settimeout(0.05)  # of a send: a full buffer means that nobody reads any more

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


URGENT = -10
"""Niceness of threads that serve a wire, where the system allows it."""


def raise_priority() -> None:
    """Let the calling thread run before others; without the right to do so (CAP_SYS_NICE) nothing changes."""
    with contextlib.suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), URGENT)


class Thread(Protocol):
    """What is needed of a `threading.Thread`."""

    def start(self) -> None: ...

    def join(self, timeout: float | None = None) -> None: ...

    def is_alive(self) -> bool: ...


@runtime_checkable
class TurnTaking(Protocol):
    """A clock whose threads run one at a time, in an order that is the same in every run: a simulated one's."""

    def thread(self, name: str, run: Callable[[], None]) -> Thread: ...


class ServiceLoop:
    """The one thread that owns a device's wire: it calls `step` again and again until it is closed.

    Other threads never touch the wire; they hand over what shall be done with `post`, and it is carried out in
    the order of the posts before the next step. `step` and what is posted must return within a moment. An exception
    is handed to `failed`; one of a step ends the thread, too: a device that nobody serves must not look alive.
    """

    def __init__(
        self, name: str, step: Callable[[], None], failed: Callable[[Exception], None], clock: Clock | None = None
    ) -> None:
        """
        Args:
            clock: the cell's; a `TurnTaking` one makes the thread.
        """
        self._step, self._failed = step, failed
        self._closed = threading.Event()
        self._posted: SimpleQueue[Callable[[], None]] = SimpleQueue()
        threads: object = clock
        if isinstance(threads, TurnTaking):
            self._thread: Thread = threads.thread(name, self._run)
        else:
            self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    def start(self) -> None:
        self._thread.start()

    def post(self, command: Callable[[], None]) -> None:
        """Have this done by the loop's thread, before its next step; from any thread, without waiting."""
        self._posted.put(command)

    def turn(self) -> None:
        """Do what was posted, then one step: what the thread does without end, and a test by hand."""
        while True:
            try:
                command = self._posted.get_nowait()
            except Empty:
                break
            try:
                command()
            except Exception as error:
                self._failed(error)
        self._step()

    def close(self, deadline: float = 2.0) -> None:
        """Let the present step end, then the thread."""
        self._closed.set()
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self._thread.join(deadline)

    def _run(self) -> None:
        raise_priority()
        try:
            while not self._closed.is_set():
                self.turn()
        except Exception as error:
            self._failed(error)


def read_address(settings: Settings, key: str, default_port: int) -> tuple[str, int]:
    """A setting HOST or HOST:PORT.

    Raises:
        CellFileError: it is none.
    """
    host, _, port = settings.text(key).rpartition(":") if ":" in settings.text(key) else (settings.text(key), "", "")
    if not host or (port and not (port.isdigit() and 0 < int(port) < 65536)):
        raise settings.error(f"'{settings.text(key)}' is not an address: write HOST or HOST:PORT", key)
    return host, int(port) if port else default_port
