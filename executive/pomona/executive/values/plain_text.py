"""Texts and tables that a person names: read whole, of a bounded length; devices and pipes are refused at once."""

from __future__ import annotations

import csv
import errno
from collections.abc import Sequence
from pathlib import Path

# of a file: four for each character of a Groot2 project of 4 Mi characters
MOST_BYTES = 16 * 1024 * 1024


class NotUtf8Error(UnicodeDecodeError):
    """A file that is no text; the text is the reason, and the remedy."""

    def __str__(self) -> str:
        utf_16 = self.object.startswith((b"\xff\xfe", b"\xfe\xff"))
        return (
            f"{'it is UTF-16' if utf_16 else f'byte {self.start} is not UTF-8'}; save it as UTF-8"
        )


def read_plain_text(path: Path, most: int = MOST_BYTES) -> str:
    """Read the text of a file or of the target of a link, without a byte order mark; lines end with "\\n".

    Raises:
        NotUtf8Error: it is not UTF-8.
        OSError: it is not a file, is longer than `most` bytes, or cannot be opened; `strerror` holds the reason.
        ValueError: the path holds a character that no path may.
    """
    if path.exists() and not path.is_file():
        raise OSError(
            *((errno.EISDIR, "Is a directory") if path.is_dir() else (errno.EINVAL, "Not a file"))
        )
    with path.open(encoding="utf-8-sig") as stream:
        if path.stat().st_size > most:
            raise OSError(errno.EFBIG, f"Larger than {most // 1024} KiB")
        try:
            return stream.read(most)
        except UnicodeDecodeError as error:
            raise NotUtf8Error(*error.args) from None


class NoTableError(ValueError):
    """The file is no table, or not the one that is needed; the text holds the reason."""


def read_table(
    path: Path, needed: Sequence[str], most: int = MOST_BYTES
) -> list[tuple[int, dict[str, str]]]:
    """Return the rows of a table of comma-separated values, each with the number of its line.

    Raises NoTableError: it cannot be read, or a needed column is missing or there twice.
    """
    try:
        reader = csv.DictReader(read_plain_text(path, most).split("\n"))
        rows = [(reader.line_num, row) for row in reader]
    except OSError as error:
        raise NoTableError(f"cannot be read: {error.strerror}") from error
    except (csv.Error, NotUtf8Error) as error:
        raise NoTableError(f"is no table: {error}") from error
    columns = reader.fieldnames or []
    missing = [name for name in needed if name not in columns]
    if missing and len(columns) == 1 and any(mark in columns[0] for mark in ";\t"):
        raise NoTableError(
            "its columns are not parted by commas: save it with commas, and numbers with a point"
        )
    if missing:
        raise NoTableError(f"has no column {', '.join(missing)}")
    twice = [name for name in needed if columns.count(name) > 1]
    if twice:
        raise NoTableError(f"has the column {', '.join(twice)} twice")
    return rows


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
