"""Files of a record: only plain ones are opened, their JSON is bounded, and new ones are written whole or not."""

from __future__ import annotations

import contextlib
import json
import math
import os
import re
import shutil
import stat
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import orjson

from pomona.executive.errors import UsageError

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


MOST_DEPTH = 200  # deepest nesting of objects and lists. A chain of reasons needs two levels per node up the tree.
LONGEST = 1e12  # largest valid number of seconds, of a run [s]: 30 000 years
LATEST = 253_370_764_800.0  # latest valid moment, since 1970 [s]: the year 9999, the last that can be written as a date

_STRINGS = re.compile(rb'"(?:[^"\\]|\\.)*"', re.DOTALL)
_HUGE = re.compile(rb"[eE]\+?\d{3}")
_HALF = re.compile(rb"\\u[dD][89a-fA-F]")


def parse(content: bytes | str) -> Any:
    """Return the value; NaN and infinity, which JSON lacks, become None, unpaired surrogates "?".

    Raises ValueError: the text is no JSON, or deeper than `MOST_DEPTH`.
    """
    if not isinstance(content, (bytes, str)):
        raise ValueError("a text is expected here")
    coded = content.encode(errors="replace") if isinstance(content, str) else content
    if is_deep(coded):
        raise ValueError(f"nested more than {MOST_DEPTH} levels deep")
    with contextlib.suppress(ValueError):
        return orjson.loads(coded)  # it refuses the cases that the lines below repair
    hooks: dict[str, Any] = {"parse_float": _finite} if _HUGE.search(coded) else {}
    try:
        value = json.loads(
            coded.decode(errors="replace"),
            parse_constant=lambda _name: None,
            parse_int=_whole,
            **hooks,
        )
    except RecursionError as error:  # `is_deep` took a part for a string
        raise ValueError("nested too deep") from error
    if _HALF.search(coded) is None:
        return value
    return json.loads(json.dumps(value, ensure_ascii=False).encode(errors="replace"))


def parse_object(content: bytes | str) -> dict[str, Any]:
    """Return the object. Raises ValueError: the text is no object."""
    value = parse(content)
    if not isinstance(value, dict):
        raise ValueError(f"an object is expected here, not {str(value)[:40]!r}")
    return value


def moment_of(value: Any) -> float:
    """Return a moment in seconds since 1970; null becomes 0, unknown. Raises ValueError: it is none up to year 9999."""
    if value is None:
        return 0.0
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0.0 <= value <= LATEST:
        raise ValueError(
            f"{str(value)[:40]!r} stands where a moment in seconds since 1970 is expected"
        )
    return float(value)


def is_deep(content: bytes) -> bool:
    """Return True for a text deeper than `MOST_DEPTH`."""
    if content.count(b"{") + content.count(b"[") <= MOST_DEPTH:
        return False
    import numpy as np  # rarely needed; a list of runs does without

    step = np.zeros(256, np.int8)
    step[[ord("["), ord("{")]], step[[ord("]"), ord("}")]] = 1, -1
    steps = step[np.frombuffer(_STRINGS.sub(b"", content), np.uint8)]
    return bool(np.cumsum(steps, dtype=np.int64).max(initial=0) > MOST_DEPTH)


def _whole(digits: str) -> int | float | None:
    """Return a whole number; one of more than 20 digits becomes a float, in linear time."""
    return int(digits) if len(digits) <= 20 else _finite(digits)


def _finite(digits: str) -> float | None:
    value = float(digits)
    return value if math.isfinite(value) else None


@contextmanager
def made_whole(place: Path) -> Iterator[Path]:
    """Yield a temporary path beside `place` for its content; it is moved to `place` when the block succeeds.

    An incomplete file would look complete and block the next attempt.

    Raises UsageError: `place` exists, or cannot be written.
    """
    refuse_taken(place)
    beside = None
    try:
        beside = Path(tempfile.mkdtemp(prefix=f".{place.name}.", dir=place.parent))
        yield beside / place.name
        refuse_taken(place)  # another process may have made it
        (beside / place.name).rename(place)
    except OSError as error:
        raise UsageError(f"{place}: {error.strerror or error}") from error
    finally:
        if beside is not None:
            shutil.rmtree(beside, ignore_errors=True)


def replace_file(path: Path, data: bytes) -> None:
    """Write a file whole or not at all; mode and owner of the one that it replaces stay. Raises OSError: it cannot be."""
    number, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=".saving")
    try:
        with os.fdopen(number, "wb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())
        about = path.stat() if path.exists() else None
        os.chmod(name, 0o644 & ~_umask() if about is None else about.st_mode & 0o7777)
        if about is not None:
            with contextlib.suppress(PermissionError):  # of another owner: the content counts more
                os.chown(name, about.st_uid, about.st_gid)
        os.replace(name, path)
    except OSError:
        with contextlib.suppress(OSError):
            os.unlink(name)
        raise


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def refuse_taken(place: Path) -> None:
    """Raises UsageError: the path exists, also as a broken link."""
    if os.path.lexists(place):
        raise UsageError(
            f"{place} exists, and nothing is overwritten: name another place, or move it away"
        )
