"""A record as a folder: its name, its file and topics, how a command finds it, whether it is being written."""

from __future__ import annotations

import contextlib
import errno
import hashlib
import os
import tempfile
from collections.abc import Callable, Iterable
from datetime import datetime
from pathlib import Path
from typing import TypeVar

from pomona.executive.errors import UsageError
from pomona.executive.recording.ending import read_ending
from pomona.executive.recording.plain_file import open_plain
from pomona.executive.values.findings import did_you_mean
from pomona.executive.values.processes import lock

EVENTS_FILE = "run.mcap"
EVENTS = "/events"
DEVICES = "/devices/"


PROBE = 4096  # size of the trial before a run: one block of a file system [bytes]


class RecordError(UsageError):
    """The record cannot be written."""


def refuse_unwritable(root: Path) -> None:
    """Test a folder of records before a run: a file is written there, or where the folder would be made.

    Raises:
        RecordError: no record can be written there.
    """
    try:
        there = next(folder for folder in (root, *root.absolute().parents) if folder.exists())
        with tempfile.TemporaryFile(dir=there, buffering=0) as probe:
            if probe.write(bytes(PROBE)) != PROBE:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    except OSError as error:
        raise RecordError(
            f"{root}: no record can be written there: {error.strerror}. Nothing was run. "
            "`--record DIR` names another folder, `--no-record` leaves none"
        ) from error


def new_record_folder(root: Path, tree: str, now: datetime | None = None) -> Path:
    """Make the folder `root/2026-11-21_08-41-07_tree`, with a number if it exists.

    Raises RecordError: the folder cannot be made.
    """
    # part of the tree's name in the folder's name [bytes]; file systems allow 255
    stem = f"{now or datetime.now():%Y-%m-%d_%H-%M-%S}_{tree.encode()[:120].decode(errors='ignore')}"
    for number in range(1000):
        folder = root / (stem if number == 0 else f"{stem}_{number + 1}")
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            continue
        except OSError as error:
            raise RecordError(f"cannot make the record's folder {folder}: {error.strerror}") from error
        return folder
    raise RecordError(f"{root} holds a thousand records of this second")


def is_being_written(path: Path) -> bool:
    """Return True while a process, this one or another, writes this MCAP file."""
    with contextlib.suppress(OSError), open_plain(path) as stream:  # a pipe is never a record
        try:
            lock(stream, shared=True)
        except BlockingIOError:
            return True
    return False


def find_record(name: str, root: Path) -> Path:
    """Return the folder of a record: from a path (folder or MCAP file), a name below `root`, or `last`.

    Raises UsageError: there is none; the text lists similar names.
    """
    records = sorted(path.parent for path in root.glob(f"*/{EVENTS_FILE}"))
    if name == "last":
        if not records:
            raise UsageError(f"no records in {root}: `pomona run` leaves one, --record names another folder")
        return in_order(records, lambda record: record.name)[-1]
    for path in (Path(name), root / name):
        if (path / EVENTS_FILE).is_file():
            return path
        if path.is_file():
            return path.parent if path.name == EVENTS_FILE else path
    alike = [record.name for record in records if record.name.startswith(name)]
    if len(alike) == 1:
        return root / alike[0]
    close = f"did you mean {', '.join(alike[-5:])}?" if alike else did_you_mean(name, (r.name for r in records))
    hint = close or f"`pomona runs list --record {root}` lists them"
    raise UsageError(f"no record '{name}' in {root}: {hint}")


def events_file(record: Path) -> Path:
    """Return the MCAP file of a record, given its folder or the file itself."""
    return record / EVENTS_FILE if record.is_dir() else record


def hash_of(*texts: str) -> str:
    """Return the hash that identifies the texts of a tree or a cell."""
    return hashlib.sha256("".join(texts).encode(errors="replace")).hexdigest()[:16]


T = TypeVar("T", str, int)


def next_number(root: Path) -> int:
    """Return the number of the record that begins now in a folder of records: one above the largest.

    Numbers give the order of records: clocks are set back, and repairs change old files.
    """
    return 1 + max((_number(record) for record in root.iterdir()), default=0)


def in_order(records: Iterable[Path], moment: Callable[[Path], T]) -> list[Path]:
    """Return folders of records, the oldest first.

    `moment` estimates the time of a record without a number (of an earlier version, or with a damaged file). Such a
    record comes after the numbered ones with an earlier estimate.
    """
    places: dict[Path, tuple[int, bool, T]] = {}
    greatest = 0
    for seems, record in sorted((moment(record), record) for record in records):
        number = _number(record)
        greatest = max(greatest, number)
        places[record] = (number or greatest, not number, seems)
    return sorted(places, key=lambda record: places[record])


def _number(record: Path) -> int:
    """Return a record's number; 0 without a valid one."""
    number = read_ending(record).get("number")
    return number if isinstance(number, int) and not isinstance(number, bool) and 0 < number < 2**53 else 0
