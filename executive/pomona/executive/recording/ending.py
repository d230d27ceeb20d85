"""The file `ending.json` beside a record: how its writing ended, so a killed process differs from a full disk.

The file has its full length from the start, so its last write needs no space on a full disk. It only explains the state
that the record itself shows; no command trusts a record because of it.
"""

from __future__ import annotations

import contextlib
import os
from pathlib import Path
from typing import Any

from pomona.executive.recording.json_text import parse_object
from pomona.executive.recording.plain_file import open_plain
from pomona.executive.running.supervise import REPORT

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
        self._stream = (folder / ENDING_FILE).open("w+b", buffering=0)  # kept open, since file handles may run out
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
    why, stopped = _why(record, size), _stopped(record)
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
            return f"it could not be written: {str(found.get('why', 'the reason is unknown'))[:200]}"
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
