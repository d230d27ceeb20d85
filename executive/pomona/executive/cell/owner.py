"""One owner for every device: the thread that alone touches its wire, and the links that move bytes.

A driver gives its `Owner` two functions and leaves everything that touches the wire to it:

    self._owner = Owner(name, self.step, self._lose, clock)
    self._owner.start()                            # from now on the thread calls `step` without end
    self._owner.post(lambda: self._send(request))  # leave a call: it is made between two steps, in order
    self._owner.ask(self._release)                 # the same, and wait for its result or its error
    self._owner.close()                            # makes the calls that are left, then ends the thread

Other threads read values that the owner publishes by single assignments of immutable objects (a frozen state, a
problem), and never iterate over its mutable data. The caller decides immediate refusals on such values, and the call
checks again when it is made: a safe stop may have come between.

Before `start` and after `close` the caller is the owner: calls are made at once, under a lock. So a test needs no
thread: it calls `step` by hand. A simulated clock may provide the thread, which then takes turns with the others.
"""

from __future__ import annotations

import contextlib
import ipaddress
import math
import os
import re
import select
import socket
import threading
from collections import deque
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from typing import Protocol, TypeVar, runtime_checkable

from pomona.executive.cell.errors import DeviceLost, DriverError
from pomona.executive.clock import Clock
from pomona.executive.values.kinds import ScalarKind, Schema
from pomona.executive.values.yaml_nodes import Unfit

_PAGE = re.compile(rb"\s*(HTTP/\d|<(!doctype )?html)", re.IGNORECASE)


class Malformed(DriverError):
    """Bytes that are no message of the protocol."""

    def __init__(self, received: bytes, message: str) -> None:
        self.received = received
        shown = received[:32].hex(" ") + (" …" if len(received) > 32 else "") or "no byte"
        super().__init__(
            f"{message}: {'a web server (HTTP) answers there' if _PAGE.match(received) else shown}"
        )


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
        self._socket.settimeout(
            0.05
        )  # of a send: a full buffer means that the peer does not read any more

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
    OCTET = r"(?:25[0-5]|2[0-4]\d|1?\d?\d)"  # of an IPv4 address, 0 to 255
    HOST = rf"((?:{OCTET}\.){{3}}{OCTET}|(?![\d.]+(?::|$))[\w.-]+)"  # that address, or a name

    def __init__(self, port: int) -> None:
        self.port = port

    def parse(self, text: str) -> tuple[str, int]:
        found = re.fullmatch(
            rf"({self.HOST}|\[(?P<six>.+)\])(?::(?P<port>\d{{1,5}}))?", text.strip(), re.A
        )
        with contextlib.suppress(ValueError):
            if found is not None and 0 < int(found["port"] or 1) < 65536:
                six = found["six"] and str(ipaddress.IPv6Address(found["six"]))
                return six or found[1], int(found["port"] or self.port)
        raise Unfit(f"'{text}' is not an address: write HOST, HOST:PORT or [IPv6]:PORT")

    def plain_schema(self) -> Schema:
        return {"type": "string", "examples": [f"192.168.1.2:{self.port}"]}


def tcp_opener(host: str, port: int, wires: Mapping[str, Callable[[], Link]]) -> Callable[[], Link]:
    """How to connect to a device: by TCP, unless one of `wires` leads to this address."""
    return wires.get(f"{host}:{port}") or (lambda: TcpLink(host, port))


T = TypeVar("T")

ANSWER = 0.5  # deadline of a call with a waiting caller [s]: steps take a few milliseconds
# time without a step after which the thread counts as hung [s]; a blocked send takes 50 ms
HUNG = 1.0


class Thread(Protocol):
    """The used part of `threading.Thread`."""

    def start(self) -> None:
        """Begin to run."""

    def join(self, timeout: float | None = None) -> None:
        """Wait until it has ended, at most `timeout` seconds."""

    def is_alive(self) -> bool:
        """Return True if it still runs."""


@runtime_checkable
class TurnTaking(Protocol):
    """A clock whose threads run one at a time, in an order that is the same in every run: a simulated one's."""

    def thread(self, name: str, run: Callable[[], None]) -> Thread:
        """Return a thread that runs when it is its turn."""


class Owner:
    """Calls `step` repeatedly, and posted calls between the steps.

    Any exception of a step or a call is passed to `failed`, in the owner's thread: an unserved device must not look
    alive. The thread then goes on, so that the driver can open its wire again.
    """

    def __init__(
        self,
        device: str,
        step: Callable[[], None],
        failed: Callable[[BaseException], None],
        clock: Clock,
    ) -> None:
        """
        Args:
            clock: the cell's; a `TurnTaking` one makes the thread.
        """
        self._device = device
        self._step = step
        self._failed = failed
        self._clock = clock
        self._calls: deque[Callable[[], None]] = deque()
        self._closed = threading.Event()
        self._turning = threading.RLock()  # held during calls and steps
        self._thread: Thread | None = None
        self._ident: int | None = None
        self._turned_at = clock.now()

    def start(self) -> None:
        """Let a thread of its own be the owner."""
        threads: object = self._clock
        name = f"{self._device} owner"
        if isinstance(threads, TurnTaking):
            self._thread = threads.thread(name, self._run)
        else:
            self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._turned_at = self._clock.now()
        self._thread.start()

    def post(self, call: Callable[[], None]) -> None:
        """Leave a call for the owner; calls are made in the order in which they were left. Never waits for it."""
        self._calls.append(call)
        if self._is_caller():
            self._make_calls()

    def ask(self, call: Callable[[], T], deadline: float = ANSWER) -> T:
        """Post a call to the owner and wait for its result.

        Raises:
            DeviceLost: the owner did not come to it within `deadline` [s]; it is not made any more.
            Exception: the exception of the call.
        """
        answer: Future[T] = Future()

        def make() -> None:
            if answer.set_running_or_notify_cancel():
                try:
                    answer.set_result(call())
                except BaseException as error:
                    answer.set_exception(error)

        end = self._clock.now() + deadline
        self.post(make)
        while not answer.done():
            if self._clock.now() > end and answer.cancel():
                raise DeviceLost(self._device, f"its thread did nothing for {deadline:g} s")
            self._clock.advance(1e-3)  # period of a caller's polls for a result [s]
        return answer.result()

    def check(self) -> None:
        """Look whether the thread still serves the device. Raises DeviceLost: it hangs, or has ended by itself."""
        thread = self._thread
        if thread is None or self._closed.is_set():
            return
        if not thread.is_alive():
            raise DeviceLost(self._device, "its thread has ended")
        silent = self._clock.now() - self._turned_at
        if silent > HUNG:
            raise DeviceLost(self._device, f"its thread hangs for {silent:.1f} s")

    def close(self, deadline: float = 2.0) -> None:
        """Let the present step end, make the calls that are left, and end the thread."""
        self._closed.set()
        if self._thread is not None and self._ident != threading.get_ident():
            self._thread.join(deadline)

    def _is_caller(self) -> bool:
        """Return True if the present thread may make calls by itself: it is the owner, or there is no other."""
        return (
            self._thread is None
            or not self._thread.is_alive()
            or self._ident == threading.get_ident()
        )

    def _make_calls(self) -> None:
        with self._turning:
            while self._calls:
                try:
                    self._calls.popleft()()
                except Exception as error:
                    self._failed(error)

    def _run(self) -> None:
        self._ident = threading.get_ident()
        if not isinstance(self._clock, TurnTaking):
            raise_priority()
        while not self._closed.is_set():
            self._turned_at = self._clock.now()
            try:
                with self._turning:
                    self._make_calls()
                    self._step()
            except (
                BaseException
            ) as error:  # SystemExit of a listener would end the thread without a word
                self._failed(error)
                self._clock.advance(
                    0.01
                )  # pause before the next try [s]: a wire that is cut fails at once
        self._make_calls()


class Watchdog:
    """End of a streamed command that is not renewed, the same for every driver.

    It adds up the intervals between calls of `has_expired`, and an interval is never negative: a clock that steps back
    costs one interval, and cannot keep a command alive.
    """

    def __init__(self, limit: float) -> None:
        """Expired until the first `renew`.

        Args:
            limit: a command ends when it is older than this [s].
        """
        self.limit = limit
        self._age = math.inf
        self._looked_at = 0.0

    def renew(self, now: float) -> None:
        """A command has come.

        Args:
            now: the cell's clock [s].
        """
        self._age = 0.0
        self._looked_at = now

    def has_expired(self, now: float) -> bool:
        """Return True when the command is too old; called again and again.

        Args:
            now: the cell's clock [s].
        """
        self._age += max(now - self._looked_at, 0.0)
        self._looked_at = now
        return self._age > self.limit + 1e-9
