"""A run belongs to the process that began it: a forked child of it ends when it comes back into the run.

A skill or a library may fork. A child that comes back into the run (`sys.exit` in it, or no end at all) would stop and
close the devices that it shares with its parent, and dismiss the parent's supervisor: it leaves at once instead.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator

from pomona.executive.values.bounded import write_if_read

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
