"""Right to begin a run: one on each cell and wire, with a permit that others can withdraw; and where a run stands."""

from __future__ import annotations

import contextlib
import errno
import hashlib
import os
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any

from pomona.executive.errors import PomonaError, UsageError
from pomona.executive.reasons import Reason
from pomona.executive.running.events import RunEnded
from pomona.executive.running.requests import Requests
from pomona.executive.values.processes import lock


class Permit:
    """One byte in a pipe that both processes read: only one of them takes it, and none waits for the other."""

    def __init__(self, read_fd: int, write_fd: int | None = None) -> None:
        """
        Args:
            read_fd: non-blocking end of the pipe.
            write_fd: its other end, in the process that prepares runs.
        """
        self.read_fd = read_fd
        self._write_fd = write_fd
        self._closed = False

    @classmethod
    def create(cls) -> Permit:
        """Create the pipe; the other process inherits `read_fd`."""
        read_fd, write_fd = os.pipe()
        os.set_blocking(read_fd, False)
        return cls(read_fd, write_fd)

    def issue(self) -> None:
        """Permit the run whose preparation begins now, and no other."""
        self.take()
        if self._write_fd is not None and not self._closed:
            os.write(self._write_fd, b"1")

    def take(self) -> bool:
        """Return True if the permission was there; it is then used up."""
        if self._closed:
            return False
        with contextlib.suppress(BlockingIOError):
            return bool(os.read(self.read_fd, 16))
        return False

    def close(self) -> None:
        """Close the pipe; nothing can begin any more. Harmless when closed already."""
        if self._closed:
            return
        self._closed = True
        for fd in (self.read_fd, self._write_fd):
            if fd is not None:
                os.close(fd)


class RunState(Enum):
    """Where a run stands."""

    IDLE = "idle"
    RUNNING = "running"
    PAUSING = "pausing"
    PAUSED = "paused"
    STOPPING = "stopping"
    STOPPED = "stopped"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    FAULTED = "faulted"

    @property
    def ended(self) -> bool:
        """Whether the run is over."""
        return self in (RunState.STOPPED, RunState.SUCCEEDED, RunState.FAILED, RunState.FAULTED)


@dataclass(frozen=True, slots=True)
class RunResult:
    """How a run ended."""

    outcome: str  # success, partial, failure, stopped or error
    reason: Reason | None  # why it did not succeed, or not wholly
    ticks: int  # number of ticks
    time: float  # time, wall: seconds on the run's clock (pauses left out) and really
    wall: float
    truth: Mapping[str, Any] | None  # the simulated world's score
    account: Mapping[str, Any] | None = None  # the robot's own: `Account.report`
    interrupted: bool = False  # it was ended by Ctrl-C

    def event(self, t: float, tick: int) -> RunEnded:
        """Return the event of it, at a time of the run [s] and in a tick."""
        return RunEnded(
            t,
            tick,
            self.outcome,
            self.reason,
            self.ticks,
            self.time,
            self.wall,
            self.truth,
            self.account,
        )


class CellInUseError(UsageError):
    """Another run is going on on this cell, or with another cell file on the same wire."""

    def __init__(self, cell: Path, wire: str = "") -> None:
        self.cell = cell
        self.wire = wire
        super().__init__(
            f"{cell}: another run is going on on {wire or 'this cell'}. Nothing was run."
        )


@contextlib.contextmanager
def alone_on(cell: Path, kind: str, wires: Iterable[str] = ()) -> Iterator[None]:
    """Keep other processes from a real cell, and from the wires of any cell, for as long as it lasts.

    The locks are the system's, on the file of a real cell and on a name for each wire: they end with their process. A
    second name of the same device is not recognised. The file of a cell of another kind may serve several runs.

    Raises CellInUseError: another run has one of them.
    """
    with contextlib.ExitStack() as stack:
        if kind == "real":
            stack.enter_context(_alone_with_file(cell))
        for wire in wires:
            stack.enter_context(_alone_on_wire(cell, wire))
        yield


@contextlib.contextmanager
def _alone_on_wire(cell: Path, wire: str) -> Iterator[None]:
    if sys.platform != "linux":  # elsewhere there are no names without files
        yield
        return
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as name:
        try:
            name.bind(b"\0pomona-wire-" + hashlib.sha256(wire.encode()).hexdigest().encode())
        except OSError as error:
            if error.errno == errno.EADDRINUSE:
                raise CellInUseError(cell, wire) from None
        yield


@contextlib.contextmanager
def _alone_with_file(cell: Path) -> Iterator[None]:
    try:
        stream = cell.open("rb")
    except OSError:  # its text is not from the disk
        yield
        return
    with stream:
        try:
            lock(stream)
        except BlockingIOError:
            raise CellInUseError(cell) from None
        except OSError:  # a file system without locks
            pass
        yield


class StartCancelledError(PomonaError):
    """The operator stopped a run before it began."""


@dataclass(frozen=True, slots=True)
class StartingStage:
    """The current stage; `done` of `of` equal steps, if they can be counted."""

    what: str = "waiting"
    done: int = 0
    of: int = 0


class Starting:
    """From the order to the first tick. `execute` reports to it; anybody may cancel, from any thread."""

    def __init__(
        self, changed: Callable[[], None] = lambda: None, permit: Permit | None = None
    ) -> None:
        """
        Args:
            changed: called after each change.
            permit: needed to begin, where another process may withdraw it.
        """
        self._changed = changed
        self._permit = permit
        if permit is not None:
            permit.issue()
        self._lock = threading.Lock()
        self._run: Requests | None = None
        self._cancelled: tuple[str, str] | None = None
        self._leaving = False
        self._began = time.monotonic()
        self.stage: StartingStage | None = StartingStage()
        """The current stage of preparation, or None: the run is active."""
        self.cell_kind = ""

    @property
    def age(self) -> float:
        """Seconds since it was ordered."""
        return time.monotonic() - self._began

    @property
    def cancelled(self) -> str:
        """Why it must not begin, or nothing."""
        return self._cancelled[0] if self._cancelled is not None else ""

    def reach(self, what: str, done: int = 0, of: int = 0) -> None:
        """Report the next stage."""
        if (
            self.stage is None and self._permit is not None
        ):  # the run after a recovery, which has used its permit up
            self._permit.issue()
        self.stage = StartingStage(what, done, of)
        self._changed()

    def begin(self) -> None:
        """The run is active: its events report its progress. Without a permit it ends before its first tick."""
        if self._permit is not None and not self._permit.take():
            self.cancel("safe stop on the page during the preparation", "operator")
        self.stage = None
        self._changed()

    def refuse_cancelled(self) -> None:
        """Go no further once it was cancelled. Raises StartCancelledError: it was."""
        if self._cancelled is not None:
            raise StartCancelledError(self.cancelled)

    def attach(self, run: Requests) -> None:
        """Accept stop requests for a run with a cell from now on; apply an earlier request at once."""
        with self._lock:
            self._run = run
            cancelled = self._cancelled
            leaving = self._leaving
        if cancelled is not None:
            run.safe_stop(*cancelled)
        if leaving:
            run.leave()

    def cancel(self, reason: str, who: str) -> None:
        """The run must not begin. A cell that is connected goes into its safe state now."""
        with self._lock:
            self._cancelled = self._cancelled or (reason, who)
            run = self._run
        if run is not None:
            run.safe_stop(reason, who)
        self._changed()

    def abandon(self, reason: str) -> None:
        """End the process: no run begins, an active one is stopped, and its safe state stays unacknowledged."""
        self.cancel(reason, "system")
        with self._lock:
            self._leaving = True
            run = self._run
        if run is not None:
            run.leave()
