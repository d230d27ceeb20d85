"""A record whose process was killed, made whole again."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from pathlib import Path

from executive.encode import plain
from executive.errors import UsageError
from executive.recording.copy import Copied, copy, is_whole
from executive.recording.picture import Picture
from executive.recording.read import events_file, read_events
from executive.recording.recorder import is_being_written
from executive.running.events import RunEnded, RunStarted


@dataclass(frozen=True, slots=True)
class Repaired:
    """What a repair found. `made` names the files that were missing and were made from the events."""

    copied: Copied
    made: tuple[str, ...]


def repair(record: Path) -> Repaired | None:
    """Finish the MCAP file and make what is missing beside it. Nothing is lost: bytes at the end that are no whole
    message are kept in `run.mcap.tail`.

    Returns:
        what was done, or None: the record is whole.

    Raises:
        UsageError: the run is still going on, or the file is no record.
    """
    path = events_file(record)
    if is_being_written(path):
        raise UsageError(f"{record}: the run is still going on")
    if is_whole(path):
        return None
    fresh = path.with_name(f"{path.name}.repairing")
    try:
        copied = copy(path, fresh, compressed=False)
        if copied.cut > 0:
            with path.open("rb") as stream:
                stream.seek(-copied.cut, os.SEEK_END)
                path.with_name(f"{path.name}.tail").write_bytes(stream.read())
        os.replace(fresh, path)
    finally:
        fresh.unlink(missing_ok=True)
    return Repaired(copied, tuple(_make_missing(record)) if record.is_dir() else ())


def _make_missing(record: Path) -> list[str]:
    texts: dict[str, str] = {}
    picture, title = Picture(), record.name
    for event in read_events(record):
        picture.hear(event)
        if isinstance(event, RunStarted):
            texts |= {"tree.yaml": event.tree_text, "cell.yaml": event.cell_text}
            title = f"{event.tree}: cut off, seed {event.seed}"
        elif isinstance(event, RunEnded):
            texts["summary.json"] = json.dumps(plain(event), ensure_ascii=False, indent=1)
    made = []
    for name, text in texts.items():
        if not (record / name).is_file():
            (record / name).write_text(text, encoding="utf-8")
            made.append(name)
    if not (record / "picture.png").is_file() and not picture.empty:
        picture.save(record / "picture.png", title)
        made.append("picture.png")
    return made
