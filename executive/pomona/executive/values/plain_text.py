"""Text files that a person names: read whole, of a bounded length; a device or a pipe is refused, not waited for."""

from __future__ import annotations

import errno
from pathlib import Path

MOST_BYTES = 16 * 1024 * 1024  # of a file: four for each character of a Groot2 project of 4 Mi characters


def read_plain_text(path: Path, most: int = MOST_BYTES) -> str:
    """Read the text of a file or of the target of a link; lines end with "\\n".

    Raises:
        UnicodeDecodeError: it is not UTF-8.
        OSError: it is not a file, is longer than `most` bytes, or cannot be opened; `strerror` holds the reason.
        ValueError: the path holds a character that no path may.
    """
    if path.exists() and not path.is_file():
        directory = path.is_dir()
        raise OSError(errno.EISDIR if directory else errno.EINVAL, "Is a directory" if directory else "Not a file")
    with path.open(encoding="utf-8") as stream:
        if path.stat().st_size > most:
            raise OSError(errno.EFBIG, f"Larger than {most // 1024} KiB")
        return stream.read(most)


def not_utf8(error: UnicodeDecodeError) -> str:
    """Return the reason why a file is no text, and the remedy."""
    if error.object.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "it is UTF-16; save it as UTF-8"
    return f"byte {error.start} is not UTF-8"


def is_file(path: Path) -> bool:
    """Return True if there is such a file, or a link to one; False for an impossible name."""
    try:
        return path.is_file()
    except (OSError, ValueError, RuntimeError):
        return False


def exists(path: Path) -> bool:
    """Return True if anything has this path, as above."""
    try:
        return path.exists()
    except (OSError, ValueError, RuntimeError):
        return False
