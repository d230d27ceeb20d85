"""Completing a record whose process was killed or whose file is damaged, and copying one for other tools."""

from __future__ import annotations

import contextlib
import io
import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, McapRecord, Message, Metadata, Schema
from mcap.writer import CompressionType, Writer

from pomona.executive.encode import plain
from pomona.executive.errors import UsageError
from pomona.executive.recording.folder import EVENTS, events_file, is_being_written, why_cut
from pomona.executive.recording.mcap_file import (
    LIBRARY,
    MAGIC,
    CutError,
    DamagedError,
    has_begun,
    next_chunk,
    raw_records,
    records_of,
    size_of,
)
from pomona.executive.recording.overview import OVERVIEW
from pomona.executive.recording.picture import Picture
from pomona.executive.recording.plain_file import open_plain
from pomona.executive.recording.read import read_events
from pomona.executive.recording.recorder import new_writer
from pomona.executive.recording.scan import REPAIR, examine
from pomona.executive.running.events import RunEnded, RunStarted

EVENT_START = b'{"event":"'  # start of every message on `/events`: it identifies a channel whose declaration was lost


@dataclass(frozen=True, slots=True)
class Copied:
    """Result of a copy."""

    messages: int = 0  # number of copied messages
    seconds: float = 0.0  # run time of the newest one [s]
    cut: int = 0  # bytes at the end of the source that are no complete record
    # lost parts, each as (first byte, bytes, run time before [s], run time after [s])
    gaps: tuple[tuple[int, int, float, float], ...] = ()

    @property
    def lost(self) -> str:
        """The lost parts as a phrase; empty without any."""
        parts = [
            f"{size} bytes between {before:.2f} and {after:.2f} s"
            for _at, size, before, after in self.gaps
        ]
        return " and ".join(parts)


@dataclass(frozen=True, slots=True)
class Repaired:
    """Result of a repair."""

    copied: Copied  # result of the copy
    why: str  # state of the file and reason for the repair
    kept: str  # name of the file with the bytes that could not be copied; empty without any
    made: tuple[str, ...]  # missing files that were made from the events


def repair(record: Path) -> Repaired | None:
    """Complete the MCAP file and make the missing files beside it; return the changes, or None for a whole record.

    No byte is lost: an incomplete end is kept in `run.mcap.tail`, and a file with damage in its middle as
    `run.mcap.damaged`.

    Raises UsageError: the run is in progress, or the file is no record.
    """
    path = events_file(record)
    if is_being_written(path):
        raise UsageError(f"{record}: the run is in progress: repair it when it has ended")
    verdict = examine(path)
    if verdict.state == "whole":
        return None
    why = verdict.why if verdict.state == "damaged" else why_cut(record, path.stat().st_size)
    fresh = path.with_name(f"{path.name}.repairing")
    try:
        copied = copy(path, fresh, compressed=False)
        kept = (
            f"{path.name}.damaged"
            if verdict.state == "damaged"
            else f"{path.name}.tail"
            if copied.cut
            else ""
        )
        if verdict.state == "damaged":
            os.replace(path, path.with_name(kept))
        elif kept:
            with open_plain(path) as stream:
                stream.seek(-copied.cut, os.SEEK_END)
                path.with_name(kept).write_bytes(stream.read())
        os.replace(fresh, path)
    except OSError as error:
        raise UsageError(f"{error.filename or path}: {error.strerror}") from error
    finally:
        fresh.unlink(missing_ok=True)
    return Repaired(
        copied,
        f"{verdict.state}: {why}",
        kept,
        tuple(_make_missing(record)) if record.is_dir() else (),
    )


def copy(source: Path, target: Path, *, compressed: bool) -> Copied:
    """Copy every undamaged record of an MCAP file; after a damaged one the copy goes on with the next undamaged chunk.

    It is compressed with zstd for other tools, or as a run writes it.

    Raises UsageError: the source is not an MCAP file, or one of the files cannot be used.
    """
    try:
        with open_plain(source) as stream, target.open("wb") as output:
            begun = has_begun(source, stream)
            writer = new_writer(
                output, CompressionType.ZSTD if compressed else CompressionType.NONE
            )
            writer.start(profile="pomona", library=LIBRARY)
            copied = _Copier(stream, writer).run(flush=not compressed) if begun else Copied()
            if copied.gaps:
                writer.add_metadata(REPAIR, {"lost": copied.lost})
            writer.finish()
            return copied
    except OSError as error:
        raise UsageError(f"{error.filename or target}: {error.strerror}") from error


class _Copier:
    def __init__(self, stream: BinaryIO, writer: Writer) -> None:
        self._stream = stream
        self._writer = writer
        self._schemas: dict[int, int] = {0: 0}
        self._channels: dict[int, int] = {}
        self._messages = 0
        self._newest = 0

    def run(self, flush: bool) -> Copied:
        gaps: list[tuple[int, int, float, float]] = []
        at: int | None = len(MAGIC)
        good = len(MAGIC)
        lost_since = None
        finished = False
        while at is not None and not finished:
            try:
                for raw in raw_records(self._stream, at):
                    stamps = [self._take(record) for record in records_of(raw)]
                    known = [stamp for stamp in stamps if stamp is not None]
                    if lost_since is not None and known:
                        gaps.append(
                            (lost_since[0], raw.at - lost_since[0], lost_since[1], min(known) / 1e9)
                        )
                        lost_since = None
                    if flush and raw.opcode == Opcode.CHUNK:
                        self._writer.flush()
                    good = raw.end
                    finished = raw.opcode == Opcode.DATA_END
                    if finished:
                        break
            except (CutError, DamagedError) as error:
                lost_since = lost_since or (error.at, self._newest / 1e9)
                at = next_chunk(self._stream, error.at + 1)
        cut = 0
        if lost_since is not None or not finished:
            cut = size_of(self._stream) - (good if lost_since is None else lost_since[0])
        return Copied(self._messages, self._newest / 1e9, cut, tuple(gaps))

    def _take(self, record: McapRecord) -> int | None:
        """Copy one record; returns the stamp of a message [ns]."""
        match record:
            case Schema() if record.id not in self._schemas:
                self._schemas[record.id] = self._writer.register_schema(
                    record.name, record.encoding, record.data
                )
            case Channel() if record.id not in self._channels:
                self._channels[record.id] = self._writer.register_channel(
                    record.topic, record.message_encoding, self._schemas.get(record.schema_id, 0)
                )
            case Message():
                return self._take_message(record)
            case Attachment() if record.name != OVERVIEW:  # it holds the overview of the original
                self._writer.add_attachment(
                    record.create_time, record.log_time, record.name, record.media_type, record.data
                )
            case Metadata():
                self._writer.add_metadata(record.name, record.metadata)
        return None

    def _take_message(self, message: Message) -> int | None:
        if message.channel_id not in self._channels:
            if not message.data.startswith(EVENT_START):
                return None  # the declaration of its channel was in a lost part
            self._channels[message.channel_id] = self._writer.register_channel(EVENTS, "json", 0)
        self._writer.add_message(
            self._channels[message.channel_id],
            message.log_time,
            message.data,
            message.publish_time,
            message.sequence,
        )
        self._messages, self._newest = self._messages + 1, max(self._newest, message.log_time)
        return int(message.log_time)


def _make_missing(record: Path) -> list[str]:
    texts: dict[str, str] = {}
    picture = Picture()
    title = record.name
    try:
        for event in read_events(record):
            picture.on_event(event)
            if isinstance(event, RunStarted):
                texts |= {"tree.yaml": event.tree_text, "cell.yaml": event.cell_text}
                title = f"{event.tree}: cut off, seed {event.seed}"
            elif isinstance(event, RunEnded):
                texts["summary.json"] = json.dumps(plain(event), ensure_ascii=False, indent=1)
    except UsageError:  # a valid file of another program
        return []
    made = [
        name for name, text in texts.items() if _make(record / name, text.encode(errors="replace"))
    ]
    if not picture.empty:
        with contextlib.suppress(
            Exception
        ):  # a view that cannot be drawn: the record is valid without it
            drawn = io.BytesIO()
            picture.save(drawn, title)
            made += ["picture.png"] if _make(record / "picture.png", drawn.getvalue()) else []
    return made


def _make(path: Path, content: bytes) -> bool:
    """Write a missing file; an existing one, or a link, stays."""
    try:
        with path.open("xb") as stream:
            stream.write(content)
    except FileExistsError:
        return False
    return True
