"""Threads, locks and processes: waiting that is bounded, locks on open files, and the process that a run belongs to.

A skill or a library may fork. A child that comes back into the run (`sys.exit` in it, or no end at all) would stop and
close the devices that it shares with its parent, and dismiss the parent's supervisor: it leaves at once instead.
"""

from __future__ import annotations

import contextlib
import os
import select
import threading
from collections.abc import Callable, Iterator
from typing import IO, TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    import logging


T = TypeVar("T")

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


CHILD = 3  # exit status of a child that came back into the run

_process: int | None = None  # process of the run in progress here, or in the parent of this copy


def leave_if_forked() -> None:
    """End a child of the run's process; called wherever foreign code comes back into the run."""
    if _process is not None and os.getpid() != _process:
        write_if_read(2, b"a process that was forked in the run came back into it, and was ended\n")
        os._exit(CHILD)


def continue_here() -> None:
    """Go on with the run in this copy of its process, on purpose: it is another run from here on."""
    global _process
    _process = os.getpid()


@contextlib.contextmanager
def run_in_progress() -> Iterator[None]:
    """From the connecting of a cell to its closing, in the thread of the tick."""
    global _process
    before, _process = _process, os.getpid()
    try:
        yield
    finally:
        leave_if_forked()
        _process = before
