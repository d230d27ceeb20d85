"""How the writing of a record ended, in a small file beside it: what tells a killed process from a full disk.

The file has its full length from the start, so that what is written last needs no room that a full disk does not have.
Nothing is believed because of it: it gives a reason for what the record itself shows.
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
LENGTH = 1024
"""Bytes of the file, filled with spaces."""
_BOOT = Path("/proc/sys/kernel/random/boot_id")


class EndingFile:
    """Keeps the file of one record while it is written."""

    def __init__(self, folder: Path, number: int) -> None:
        """
        Args:
            number: of the record (`pomona.executive.recording.order`).

        Raises:
            OSError: it cannot be written.
        """
        self._number = number
        self._stream = (folder / ENDING_FILE).open("w+b", buffering=0)  # open to the end: handles may run out
        self._stream.write(_filled(state="writing", number=number, boot=_boot()))

    def write(self, state: str, **facts: Any) -> None:
        """Write how it ended: `closed` with `bytes`, `failed` with `why`. A file that cannot be written stays."""
        with contextlib.suppress(OSError):
            self._stream.seek(0)
            self._stream.write(_filled(state=state, number=self._number, **facts))

    def close(self) -> None:
        """Close the file."""
        with contextlib.suppress(OSError):
            self._stream.close()


def why_cut(record: Path, size: int | None = None) -> str:
    """Why a record ends too early, and what the supervisor did then, as the second half of a sentence.

    Args:
        record: its folder.
        size: of its MCAP file [bytes], where known.
    """
    why, stopped = _why(record, size), _stopped(record)
    return f"{why}; {stopped}" if stopped else why


def read_ending(record: Path) -> dict[str, Any]:
    """What the file of a record says; nothing when it is missing or damaged."""
    return _read(record / ENDING_FILE)


def _stopped(record: Path) -> str:
    """What the supervisor process says that it did; empty when there was none, or nothing to do."""
    report = _read(record / REPORT)
    devices = report.get("devices")
    if not isinstance(devices, dict):
        return ""
    done = ", ".join(f"{device} {what}"[:200] for device, what in list(devices.items())[:10])
    return f"its supervisor found that {str(report.get('reason', ''))[:200]}: {done}"


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
    from pomona.executive.encode import encoded  # only who writes needs numpy

    facts = {key: value[:300] if isinstance(value, str) else value for key, value in facts.items()}
    return encoded(facts).ljust(LENGTH - 1)[: LENGTH - 1] + b"\n"


def _boot() -> str:
    """What names this start of the machine; empty where the system does not say."""
    with contextlib.suppress(OSError):
        return _BOOT.read_text(encoding="ascii").strip()
    return f"process {os.getpid()}"
