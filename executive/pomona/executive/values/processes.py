"""Waiting that is bounded, locks on open files, and the signals that end a process."""

from __future__ import annotations

import contextlib
import os
import select
import signal
import threading
from collections.abc import Callable
from typing import IO, TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    import logging


T = TypeVar("T")

WORDS = {
    signal.SIGINT: "interrupted from the keyboard",
    signal.SIGTERM: "the process was terminated (SIGTERM)",
}
if hasattr(signal, "SIGHUP"):  # Windows has none
    WORDS[signal.SIGHUP] = "the terminal was closed (SIGHUP)"
"""Description of each signal in messages."""

LOGGING = 1.0  # longest wait for a log to take a warning [s]


def within(limit: float, work: Callable[[], T]) -> T:
    """Do the work in a thread of its own and return its result. Work that is late goes on there, unattended.

    Raises:
        TimeoutError: it has not ended within `limit` [s].
        BaseException: that of the work.
    """
    results: list[T] = []
    errors: list[BaseException] = []

    def do() -> None:
        try:
            results.append(work())
        except BaseException as error:  # raised again where it is awaited
            errors.append(error)

    thread = threading.Thread(target=do, name="pomona-bounded", daemon=True)
    thread.start()
    thread.join(limit)
    if errors:
        raise errors[0]
    if not results:
        raise TimeoutError(f"not done within {limit:g} s")
    return results[0]


def warn(logger: logging.Logger, text: str, *arguments: Any) -> None:
    """Log a warning. One that a lock of `logging` holds up for `LOGGING` is not waited for."""
    with contextlib.suppress(TimeoutError):
        within(LOGGING, lambda: logger.warning(text, *arguments))


def write_if_read(file: int, text: bytes) -> None:
    """Write a short text to a pipe or a terminal; leave it out if its reader takes nothing, or is gone.

    Args:
        file: file descriptor.
        text: at most 4096 bytes, which a pipe takes as a whole.
    """
    with contextlib.suppress(OSError, ValueError):
        if select.select([], [file], [], 0.0)[1]:
            os.write(file, text)


try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]


def lock(stream: IO[Any], *, shared: bool = False) -> None:
    """Lock an open file, for this process alone or shared with others that read.

    Raises BlockingIOError: another process holds it; OSError: the file system has no locks.
    """
    if fcntl is not None:
        fcntl.flock(stream, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
