"""A record whose process was killed, made whole again."""

from __future__ import annotations

import contextlib
import io
import json
import os
from dataclasses import dataclass
from pathlib import Path

from pomona.executive.encode import plain
from pomona.executive.errors import UsageError
from pomona.executive.recording.copy import Copied, copy
from pomona.executive.recording.ending import why_cut
from pomona.executive.recording.folder import events_file, is_being_written
from pomona.executive.recording.picture import Picture
from pomona.executive.recording.plain_file import open_plain
from pomona.executive.recording.read import read_events
from pomona.executive.recording.scan import examine
from pomona.executive.running.events import RunEnded, RunStarted


@dataclass(frozen=True, slots=True)
class Repaired:
    """What a repair found: what it could copy, why that was needed, and the files that were missing and were made from
    the events."""

    copied: Copied
    why: str
    made: tuple[str, ...]


def repair(record: Path) -> Repaired | None:
    """Finish the MCAP file and make what is missing beside it.

    Nothing is lost: what is no whole piece at the end is kept in `run.mcap.tail`, and a file with damage in its middle
    stays beside the repaired one as `run.mcap.damaged`.

    Returns:
        what was done, or None: the record is whole.

    Raises:
        UsageError: the run is still going on, or the file is no record.
    """
    path = events_file(record)
    if is_being_written(path):
        raise UsageError(f"{record}: the run is still going on")
    verdict = examine(path)
    if verdict.state == "whole":
        return None
    why = verdict.why if verdict.state == "damaged" else why_cut(record, path.stat().st_size)
    fresh = path.with_name(f"{path.name}.repairing")
    try:
        copied = copy(path, fresh, compressed=False)
        if verdict.state == "damaged":
            os.replace(path, path.with_name(f"{path.name}.damaged"))
        elif copied.cut > 0:
            with open_plain(path) as stream:
                stream.seek(-copied.cut, os.SEEK_END)
                path.with_name(f"{path.name}.tail").write_bytes(stream.read())
        os.replace(fresh, path)
    except OSError as error:
        raise UsageError(f"{error.filename or path}: {error.strerror}") from error
    finally:
        fresh.unlink(missing_ok=True)
    return Repaired(copied, f"{verdict.state}: {why}", tuple(_make_missing(record)) if record.is_dir() else ())


def _make_missing(record: Path) -> list[str]:
    texts: dict[str, str] = {}
    picture, title = Picture(), record.name
    try:
        for event in read_events(record):
            picture.on_event(event)
            if isinstance(event, RunStarted):
                texts |= {"tree.yaml": event.tree_text, "cell.yaml": event.cell_text}
                title = f"{event.tree}: cut off, seed {event.seed}"
            elif isinstance(event, RunEnded):
                texts["summary.json"] = json.dumps(plain(event), ensure_ascii=False, indent=1)
    except UsageError:  # whole, but not a run's: there is nothing to make of it
        return []
    made = [name for name, text in texts.items() if _make(record / name, text.encode(errors="replace"))]
    if not picture.empty:
        with contextlib.suppress(Exception):  # views of a shape that nothing draws: the record is whole without it
            drawn = io.BytesIO()
            picture.save(drawn, title)
            made += ["picture.png"] if _make(record / "picture.png", drawn.getvalue()) else []
    return made


def _make(path: Path, content: bytes) -> bool:
    """Write a file that is missing; one that is there, or a link, stays."""
    try:
        with path.open("xb") as stream:
            stream.write(content)
    except FileExistsError:
        return False
    return True
