"""Write a record as one portable file; its suffix selects the format."""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path

from pomona.executive.errors import UsageError
from pomona.executive.recording.folder import EVENTS, events_file
from pomona.executive.recording.plain_file import is_plain, made_whole, parse_object
from pomona.executive.recording.scan import require_valid, scan


def _zip(record: Path, target: Path) -> None:
    """Write the whole folder and its events as text; unpacked among other records it is a record again."""
    name = record.stem if record.is_file() else record.resolve().name
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
        for path in sorted(record.iterdir()) if record.is_dir() else [record]:
            if is_plain(path):  # a link could lead outside the record
                archive.write(path, f"{name}/{path.name}")
        archive.writestr(
            f"{name}/events.jsonl", b"".join(content + b"\n" for content in _events(record))
        )


def _json_lines(record: Path, target: Path) -> None:
    """Write every event on one line, without the pixels."""
    with target.open("wb") as stream:
        for content in _events(record):
            stream.write(content + b"\n")


def _mcap(record: Path, target: Path) -> None:
    """Write one indexed and compressed file, for Foxglove and other readers."""
    from pomona.tools.library.repair import copy  # it loads the picture's library

    require_valid(events_file(record))
    copy(events_file(record), target, compressed=True)


FORMATS: Mapping[str, tuple[Callable[[Path, Path], None], str]] = {
    ".zip": (_zip, "the whole record"),
    ".mcap": (_mcap, "one compressed file for Foxglove"),
    ".jsonl": (_json_lines, "the events as text"),
}
"""By suffix: the writer and the name of the format."""


def export(record: Path, target: Path) -> None:
    """Write a record into one file with the suffix `.zip`, `.jsonl` or `.mcap`.

    Raises UsageError: the file exists, it cannot be written, or the record cannot be read.
    """
    write, _what = FORMATS[target.suffix]
    with made_whole(target) as place:
        write(record, place)


def _events(record: Path) -> list[bytes]:
    found = [found.content for found in scan(events_file(record), topics=EVENTS.__eq__)]
    for content in found[:1]:
        try:
            parse_object(content)["event"]
        except (ValueError, KeyError) as error:
            raise UsageError(f"{record}: not a record of a run") from error
    return found
