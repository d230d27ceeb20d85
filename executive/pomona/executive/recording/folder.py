"""A record as a folder: its name, its file and topics, how its writing ended, whether it is being written.

The file has its full length from the start, so its last write needs no space on a full disk. It only explains the state
that the record itself shows; no command trusts a record because of it.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import os
import tempfile
from collections.abc import Callable, Iterable
from datetime import datetime
from pathlib import Path
from typing import Any, TypeVar

from pomona.executive.errors import UsageError
from pomona.executive.recording.plain_file import open_plain, parse_object
from pomona.executive.running.supervise import REPORT
from pomona.executive.values.findings import did_you_mean
from pomona.executive.values.processes import lock

ENDING_FILE = "ending.json"
LENGTH = 1024  # size of the file, filled with spaces [bytes]
_BOOT = Path("/proc/sys/kernel/random/boot_id")


class EndingFile:
    """The file of one record while that is written."""

    def __init__(self, folder: Path, number: int) -> None:
        """Begin in a record's folder, with its number (`pomona.executive.recording.folder`).

        Raises OSError: it cannot be written.
        """
        self._number = number
        self._stream = (folder / ENDING_FILE).open(
            "w+b", buffering=0
        )  # kept open, since file handles may run out
        self._stream.write(_filled(state="writing", number=number, boot=_boot()))

    def write(self, state: str, **facts: Any) -> None:
        """Write the end: `closed` with `bytes`, or `failed` with `why`. An error leaves the file as it is."""
        with contextlib.suppress(OSError):
            self._stream.seek(0)
            self._stream.write(_filled(state=state, number=self._number, **facts))

    def close(self) -> None:
        """Close the file."""
        with contextlib.suppress(OSError):
            self._stream.close()


def why_cut(record: Path, size: int | None = None) -> str:
    """Return why a record ends too early, and the reaction of the supervisor, as a phrase."""
    why = _why(record, size)
    stopped = _stopped(record)
    return f"{why}; {stopped}" if stopped else why


def read_ending(record: Path) -> dict[str, Any]:
    """Return the content of the file; empty if it is missing or damaged."""
    return _read(record / ENDING_FILE)


def _stopped(record: Path) -> str:
    """Return the report of the supervisor process as a phrase; empty without one."""
    report = _read(record / REPORT)
    devices = report.get("devices")
    if not isinstance(devices, dict):
        return ""
    done = ", ".join(f"{device} {what}"[:200] for device, what in list(devices.items())[:10])
    return f"its supervisor reported that {str(report.get('reason', ''))[:200]}: {done}"


def _read(path: Path) -> dict[str, Any]:
    try:
        with open_plain(path) as stream:
            return parse_object(stream.read(4 * LENGTH))
    except (OSError, ValueError):
        return {}


def _why(record: Path, size: int | None) -> str:
    found = read_ending(record)
    if not found:
        if size == 0:
            return "nothing was written (full disk?)"
        return "the process was killed or lost its power, or the file was cut"
    match found.get("state"):
        case "failed":
            return (
                f"it could not be written: {str(found.get('why', 'the reason is unknown'))[:200]}"
            )
        case "closed":
            return f"it was whole once, with {found.get('bytes')} bytes, and the file was cut afterwards"
        case "writing" if found.get("boot") == _boot():
            return "the process was killed or crashed"
    return "the machine lost its power or was started anew"


def _filled(**facts: Any) -> bytes:
    from pomona.executive.encode import encoded  # only writing needs numpy

    facts = {key: value[:300] if isinstance(value, str) else value for key, value in facts.items()}
    return encoded(facts).ljust(LENGTH - 1)[: LENGTH - 1] + b"\n"


def _boot() -> str:
    """Return the id of this start of the machine, or of this process if the system has none."""
    with contextlib.suppress(OSError):
        return _BOOT.read_text(encoding="ascii").strip()
    return f"process {os.getpid()}"


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
    stem = (
        f"{now or datetime.now():%Y-%m-%d_%H-%M-%S}_{tree.encode()[:120].decode(errors='ignore')}"
    )
    for number in range(1000):
        folder = root / (stem if number == 0 else f"{stem}_{number + 1}")
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            continue
        except OSError as error:
            raise RecordError(
                f"cannot make the record's folder {folder}: {error.strerror}"
            ) from error
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
    records = sorted(path.parent for path in records_in(root))
    if name == "last":
        if not records:
            raise UsageError(
                f"no records in {root}: `pomona run` leaves one, --record names another folder"
            )
        return in_order(records, lambda record: record.name)[-1]
    for path in (Path(name), root / name):
        if (path / EVENTS_FILE).is_file():
            return path
        if path.is_file():
            return path.parent if path.name == EVENTS_FILE else path
    alike = [record.name for record in records if record.name.startswith(name)]
    if len(alike) == 1:
        return root / alike[0]
    close = (
        f"did you mean {', '.join(alike[-5:])}?"
        if alike
        else did_you_mean(name, (r.name for r in records))
    )
    hint = close or f"`pomona runs list --record {root}` lists them"
    raise UsageError(f"no record '{name}' in {root}: {hint}")


def records_in(root: Path) -> list[Path]:
    """Return the MCAP files of a folder's records, except those in folders with unprintable names."""
    return [path for path in root.glob(f"*/{EVENTS_FILE}") if path.parent.name.isprintable()]


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
    return (
        number
        if isinstance(number, int) and not isinstance(number, bool) and 0 < number < 2**53
        else 0
    )
