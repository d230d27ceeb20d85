"""A run belongs to the process that began it: no child ends it, and the process does not leave it with a success.

A skill or a library may fork. A child that comes back into the run (`sys.exit` in it, or no end at all) would stop and
close the devices that it shares with its parent, and dismiss the parent's supervisor: it leaves at once instead. And
`os._exit(0)` would end the process in the middle of the run with the status of a success.
"""

from __future__ import annotations

import contextlib
import os
import threading
from collections.abc import Callable, Iterator
from typing import NoReturn

CHILD = 3
"""Exit status of a child that came back into the run."""

LEFT = 3
"""Exit status of a process that was to end with 0 in the middle of a run."""

_process: int | None = None
"""Of the run that is in progress here, or in the parent that this process is a copy of."""
_leave: Callable[[int], NoReturn] = os._exit


def leave_if_forked() -> None:
    """Called wherever foreign code comes back into the run; ends a child of the run's process, and does no more."""
    if _process is not None and os.getpid() != _process:
        with contextlib.suppress(OSError):
            os.write(2, b"a process that was forked in the run came back into it, and was ended\n")
        _leave(CHILD)


def continue_here() -> None:
    """The run goes on in this copy of its process, on purpose: it is another run from here on."""
    global _process
    _process = os.getpid()


def leave(status: int) -> NoReturn:
    """End this process at once, also in the middle of a run."""
    _leave(status)


@contextlib.contextmanager
def run_in_progress() -> Iterator[None]:
    """From the connecting of a cell to its closing, in the thread of the tick.

    In that thread `os._exit` raises SystemExit meanwhile: the safe state, and its place in the record. In another one
    it ends the process as ever, but never with 0. In a forked child it is what it was.
    """
    global _process
    before, process, thread = (_process, os._exit), os.getpid(), threading.get_ident()

    def guarded(status: int) -> NoReturn:
        if os.getpid() == process and threading.get_ident() == thread:
            raise SystemExit(f"os._exit({status}) was called during the run")
        _leave(status or (LEFT if os.getpid() == process else 0))

    _process, os._exit = process, guarded
    try:
        yield
    finally:
        leave_if_forked()
        _process, os._exit = before
