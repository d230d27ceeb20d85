"""One run at a time on a real cell and on each wire: a bus or a controller may accept two masters."""

from __future__ import annotations

import contextlib
import errno
import hashlib
import socket
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

from pomona.executive.errors import UsageError
from pomona.executive.values.processes import lock


class CellInUseError(UsageError):
    """Another run is going on on this cell, or with another cell file on the same wire."""

    def __init__(self, cell: Path, wire: str = "") -> None:
        self.cell, self.wire = cell, wire
        super().__init__(f"{cell}: another run is going on on {wire or 'this cell'}. Nothing was run.")


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
