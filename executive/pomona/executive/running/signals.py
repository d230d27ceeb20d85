"""Signals that request the end of a process: Ctrl-C, SIGTERM, and SIGHUP of a closed terminal or ssh session.

While nothing moves they raise. If a callback of a compiled library swallows the exception, the signal is sent again
shortly after, and raised again before a run begins. During a run they request the safe state; while the record and the
cell are closed they wait. A process that was started to ignore a signal (nohup, a shell's background job, a campaign's
worker for Ctrl-C) continues to ignore it. Signals reach the main thread only.
"""

from __future__ import annotations

import contextlib
import os
import queue
import signal
import struct
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import Enum
from types import FrameType, TracebackType
from typing import TYPE_CHECKING, Any

from pomona.executive.values.processes import WORDS

if TYPE_CHECKING:  # the command line listens to signals before it loads anything else
    from pomona.executive.running.requests import Requests

STUCK = 1.0  # time after which a signal has visibly had no effect: the next one interrupts a call that hangs [s]
AGAIN = 0.1  # seconds after which a signal that was swallowed comes again
CLOSING = 5.0  # seconds for which closing the record and the cell is not disturbed


REPORT = struct.Struct(
    "<Bd"
)  # message to the launcher: signal and its time [s, monotonic], or 0 and exit status


Report = Callable[[int, float], None]
_launcher: Report | None = None


def report_to(file: int) -> Report:
    """Report each signal that this process takes, and what the caller adds, to the launcher behind a pipe."""
    global _launcher
    process = os.getpid()

    def report(number: int, value: float) -> None:
        if os.getpid() == process:  # a forked child has no launcher
            with contextlib.suppress(OSError):
                os.write(file, REPORT.pack(number, value))

    _launcher = report
    return report


def report_end(status: int) -> None:
    """Report the end of the command with its exit status to the launcher, if there is one."""
    if _launcher is not None:
        _launcher(0, status)


def _report(number: int) -> float:
    """Report a signal to the launcher; return the time [s, monotonic]."""
    now = time.monotonic()
    if _launcher is not None:
        _launcher(number, now)
    return now


class Terminated(KeyboardInterrupt):
    """A signal that ends the process while nothing moves; its text is the signal's description."""

    def __init__(self, number: int) -> None:
        self.number = number
        super().__init__(WORDS[signal.Signals(number)])


def status_of(error: KeyboardInterrupt) -> int:
    """Return the exit status of a process that a signal ended: 130 for Ctrl-C, 143 for SIGTERM, 129 for SIGHUP."""
    return 128 + (error.number if isinstance(error, Terminated) else signal.SIGINT)


def signalled(error: BaseException) -> KeyboardInterrupt | None:
    """Return the signal behind an error, if there is one.

    A signal that comes while a compiled module is being loaded leaves it as ImportError("initialization failed"),
    raised from the KeyboardInterrupt.
    """
    below: BaseException | None = error
    while below is not None and not isinstance(below, KeyboardInterrupt):
        below = below.__cause__
    return below


# the signal that `raising` has raised; if it is still set, no code has handled it
_raised: int | None = None
_came = False  # whether any signal was raised since `raising` began


@contextmanager
def raising() -> Iterator[None]:
    """Each signal raises `Terminated`."""
    global _raised, _came

    def handle(number: int, _frame: FrameType | None) -> None:
        global _raised, _came
        _report(number)
        _raised = number
        _came = True
        raise Terminated(number)

    _raised = None
    _came = False

    def send_again() -> None:
        if (
            _raised is not None and signal.getsignal(_raised) is handle
        ):  # a run detects a missed signal itself
            signal.pthread_kill(threading.main_thread().ident or 0, _raised)

    before = _install(handle, tuple(WORDS))
    tell = sys.unraisablehook
    sys.unraisablehook = _tell_unless_signalled(sys.unraisablehook, send_again)
    try:
        yield
    finally:
        _restore(before)
        if not _came:  # else the interrupted object is still being deleted
            sys.unraisablehook = tell
        _raised = None


def raise_again() -> None:
    """For long loops: a signal that a library swallowed, as ctypes does in a callback, ends them all the same.

    Raises Terminated: there was one since `raising` began.
    """
    if _raised is not None:
        raise Terminated(_raised)


def _tell_unless_signalled(
    tell: Callable[[sys.UnraisableHookArgs], Any], send_again: Callable[[], None]
) -> Callable[[sys.UnraisableHookArgs], Any]:
    """Report an exception that cannot be raised, except one caused by a signal; the signal is sent again."""

    def told(what: sys.UnraisableHookArgs) -> None:
        if not _came:
            tell(what)
        elif isinstance(what.exc_value, KeyboardInterrupt):
            later = threading.Timer(AGAIN, send_again)
            later.daemon = True
            later.start()

    return told


class _Phase(Enum):
    RAISING = "nothing moves, or the operator decides how to continue"
    RUNNING = "the run is asked for its safe state"
    CLOSING = "record and cell are closed"


class RunSignals:
    """Handling of signals from the connection of a cell to its closing. `number` keeps the first one."""

    def __init__(self) -> None:
        self.number: int | None = None
        self._phase = _Phase.RAISING
        self._raised: int | None = None
        self._since = self._last = 0.0
        self._run: Requests | None = None
        self._asked: queue.SimpleQueue[int | None] = (
            queue.SimpleQueue()
        )  # put() may be called by a signal's handler
        self._before: dict[int, Any] = {}

    def __enter__(self) -> RunSignals:
        raise_again()
        self._before = _install(self._handle, tuple(WORDS))
        return self

    def __exit__(
        self, _type: type[BaseException] | None, error: object, _trace: TracebackType | None
    ) -> None:
        _restore(self._before)
        # A library that swallowed the signal while something was prepared may then fail in words of its own.
        if isinstance(error, Exception) and self._raised is not None and self._run is None:
            raise Terminated(self._raised) from error

    @contextmanager
    def ask(self, run: Requests) -> Iterator[None]:
        """For the time of a run: the first signal requests the safe state, a later one interrupts a call that hangs.

        Raises Terminated: an earlier signal has not been handled.
        """
        # The cell is stopped by a thread: the tick that the handler interrupts may hold the cell's lock, or hang.
        self._run = run
        thread = threading.Thread(target=self._stop_when_asked, name="pomona-signals", daemon=True)
        thread.start()
        self._enter(_Phase.RUNNING)
        try:
            if self._raised is not None:
                raise Terminated(self._raised)
            yield
        finally:
            self._enter(_Phase.CLOSING)
            self._asked.put(None)
            thread.join()

    @contextmanager
    def raise_again(self) -> Iterator[None]:
        """Raise signals again while the operator decides how to continue: a signal is a decision, too."""
        self._enter(_Phase.RAISING)
        try:
            yield
        finally:
            self._enter(_Phase.CLOSING)

    def wait(self) -> None:
        """From now on signals wait: record and cell are closed."""
        self._enter(_Phase.CLOSING)

    def _enter(self, phase: _Phase) -> None:
        self._phase, self._since = phase, time.monotonic()

    def _stop_when_asked(self) -> None:
        while (number := self._asked.get()) is not None:
            assert self._run is not None
            keyboard = number == signal.SIGINT
            self._run.interrupt("keyboard" if keyboard else "system", WORDS[signal.Signals(number)])

    def _handle(self, number: int, _frame: FrameType | None) -> None:
        global _came
        before = self._last
        self._last = _report(number)
        if self._phase is _Phase.RAISING:
            self._raised = number
            _came = True
            raise Terminated(number)
        first = self.number is None
        self.number = self.number or number
        if self._phase is _Phase.CLOSING:
            if self._last - self._since > CLOSING:
                raise KeyboardInterrupt
        elif first:
            self._asked.put(number)
        elif self._run is not None and self._run.breakable and self._last - before > STUCK:
            raise KeyboardInterrupt


def _install(
    handler: Callable[[int, FrameType | None], None], numbers: tuple[int, ...]
) -> dict[int, Any]:
    """Set a handler where a signal is not ignored; returns those that were there."""
    if threading.current_thread() is not threading.main_thread():
        return {}
    before = {}
    for number in numbers:
        now = signal.getsignal(number)
        if now is signal.SIG_IGN or now is None:
            continue
        if number == signal.SIGINT and now is not signal.default_int_handler and not _is_ours(now):
            continue
        before[number] = signal.signal(number, handler)
    return before


def _is_ours(handler: object) -> bool:
    return getattr(handler, "__module__", "") == __name__


def _restore(before: dict[int, Any]) -> None:
    for number, handler in before.items():
        signal.signal(number, handler)
