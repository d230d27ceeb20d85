"""Locks on open files, which end with their process. Windows has none of this kind: nothing is locked there."""

from __future__ import annotations

from typing import IO, Any

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
