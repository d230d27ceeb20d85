"""Zip archives and files of arrays (.npz) that a person names: their contents are bounded before they are unpacked."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any, BinaryIO
from zipfile import ZIP_DEFLATED, ZIP_STORED, BadZipFile, ZipFile

import numpy as np

MOST_MEMBERS = 2000  # a checkpoint of PyTorch has one for each tensor: a few hundred
_ENTRY = 1024  # of the archive's directory: 46 bytes, name and extra fields [byte for each member]
# signatures of the records at an archive's end
_END = b"PK\5\6"
_END_64 = b"PK\6\6"
_LOCATOR_64 = b"PK\6\7"
_LONGEST_COMMENT = 0xFFFF


class ArchiveTooLarge(BadZipFile):
    """An archive with more members, or more bytes in them, than its reader takes."""


def open_archive(path: Path | str, most_bytes: int, most_members: int = MOST_MEMBERS) -> ZipFile:
    """Open an archive of bounded contents for reading.

    A member is unpacked to the size that the archive's directory states, and no further: only deflation and no
    compression are taken, since the decoders of other methods unpack as much as the data hold.

    Args:
        most_bytes: of all members together, unpacked.

    Raises:
        ArchiveTooLarge: measured and allowed value.
        OSError, BadZipFile: it cannot be read, or is no archive.
    """
    with Path(path).open("rb") as stream:
        directory = _directory_size(stream)
    if directory > most_members * _ENTRY:
        words = (
            f"has a directory of {directory / 1e6:.1f} MB; at most {most_members} members are read"
        )
        raise ArchiveTooLarge(words)
    archive = ZipFile(path)
    members = archive.infolist()
    size = sum(member.file_size for member in members)
    problem = ""
    if len(members) > most_members:
        problem = f"has {len(members)} members; {most_members} are read at most"
    elif size > most_bytes:
        problem = f"unpacks to {size / 1e6:.0f} MB; {most_bytes / 1e6:.0f} MB are read at most"
    elif any(member.compress_type not in (ZIP_STORED, ZIP_DEFLATED) for member in members):
        problem = "is packed with another method than deflation: pack it again"
    if problem:
        archive.close()
        raise ArchiveTooLarge(problem)
    return archive


def _directory_size(stream: BinaryIO) -> int:
    """Return the size of an archive's directory according to its last records [byte]; 0 if it has none."""
    stream.seek(0, 2)
    size = stream.tell()
    stream.seek(max(0, size - _LONGEST_COMMENT - 22 - 20))
    tail = stream.read()
    at = tail.rfind(_END)
    if at < 0 or at + 22 > len(tail):
        return 0
    stated = int(struct.unpack_from("<L", tail, at + 12)[0])
    if at < 20 or tail[at - 20 : at - 16] != _LOCATOR_64:
        return stated
    stream.seek(max(0, size - len(tail) + at - 20 - 56))
    record = stream.read(56)
    if record[:4] != _END_64:
        return stated
    return max(stated if stated != 0xFFFFFFFF else 0, int(struct.unpack_from("<Q", record, 40)[0]))


# of all arrays of one file, unpacked: an hour of two fingers at 500 Hz is 0.4 of it
MOST_BYTES = 1 << 30


class UnreadableArraysError(ValueError):
    """The file holds no arrays, or none that can be read."""


def read_plain_arrays(path: Path) -> dict[str, np.ndarray[Any, Any]]:
    """Return the arrays of a .npz file by their names.

    Raises UnreadableArraysError: it is no such file, is damaged, too large, or holds objects.
    """
    if path.exists() and not path.is_file():
        raise UnreadableArraysError("it is not a file")
    try:
        with path.open("rb") as stream:
            open_archive(path, MOST_BYTES).close()
            with np.load(stream, allow_pickle=False) as loaded:
                return {name: np.asarray(loaded[name]) for name in loaded.files}
    # Errors of zlib, tokenize and zipfile have no common base, and a size in a header may ask for all memory there is.
    except Exception as error:
        raise UnreadableArraysError(str(error) or type(error).__name__) from error
