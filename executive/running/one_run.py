"""One run at a time on a real cell, whoever starts it: a bus or a controller may well take two masters."""

from __future__ import annotations

import contextlib
import fcntl
from collections.abc import Iterator
from pathlib import Path

from executive.errors import UsageError


class CellInUseError(UsageError):
    """Another run is going on on this cell."""

    def __init__(self, cell: Path) -> None:
        self.cell = cell
        super().__init__(f"{cell}: another run is going on on this cell. Nothing was run.")


@contextlib.contextmanager
def alone_on(cell: Path, kind: str) -> Iterator[None]:
    """Keep other processes from this cell for as long as it lasts; simulated and mock ones are as many as runs.

    The lock is the system's and on the file itself: it ends with its process, however that ends, and never grows stale.

    Raises:
        CellInUseError: another run has it.
    """
    if kind != "real":
        yield
        return
    try:
        stream = cell.open("rb")
    except OSError:  # its text is not from the disk
        yield
        return
    with stream:
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise CellInUseError(cell) from None
        except OSError:  # a file system without locks
            pass
        yield
