"""Open only plain files of a record: links are not followed, pipes and devices not opened."""

from __future__ import annotations

import os
import stat
from pathlib import Path
from typing import BinaryIO

_READING = os.O_RDONLY
for _flag in ("O_NOFOLLOW", "O_NONBLOCK", "O_CLOEXEC", "O_BINARY"):  # each system has some of these
    _READING |= getattr(os, _flag, 0)

_LINK = "is a link, and links in a record are not followed"


class NotPlainError(OSError):
    """The path is a link, a folder, a pipe or a device."""


def open_plain(path: Path) -> BinaryIO:
    """Open a plain file for reading.

    Raises NotPlainError: the path is a link, a pipe, a device or a folder; OSError: it cannot be opened.
    """
    if not hasattr(os, "O_NOFOLLOW") and path.is_symlink():
        raise NotPlainError(0, _LINK, str(path))
    try:
        handle = os.open(path, _READING)
    except OSError as error:
        if path.is_symlink():
            raise NotPlainError(error.errno, _LINK, str(path)) from error
        raise
    if not stat.S_ISREG(os.fstat(handle).st_mode):
        os.close(handle)
        raise NotPlainError(0, "is no plain file", str(path))
    return os.fdopen(handle, "rb")


def is_plain(path: Path) -> bool:
    """Return True for a plain file; a link to one is none."""
    try:
        return stat.S_ISREG(path.lstat().st_mode)
    except OSError:
        return False
