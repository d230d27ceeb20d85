"""One MCAP file into another, as far as it is whole: to repair a record, and to export it indexed and compressed."""

from __future__ import annotations

import contextlib
import os
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

from mcap.exceptions import McapError
from mcap.records import Attachment, Channel, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer

from executive.errors import UsageError
from executive.recording.read import MAGIC, has_begun


@dataclass(frozen=True, slots=True)
class Copied:
    """What was copied: messages, seconds of the run, and bytes at the end that were no whole record."""

    messages: int
    seconds: float
    cut: int


def is_whole(path: Path) -> bool:
    """Whether an MCAP file was finished: it ends as it must."""
    with contextlib.suppress(OSError), path.open("rb") as stream:
        stream.seek(-min(len(MAGIC), os.fstat(stream.fileno()).st_size), os.SEEK_END)
        return stream.read() == MAGIC and path.stat().st_size > 2 * len(MAGIC)
    return False


def copy(source: Path, target: Path, *, compressed: bool) -> Copied:
    """Copy every whole record.

    Args:
        source, target: files; the target is replaced.
        compressed: with chunks, an index and zstd, for other tools; otherwise as a run writes it.

    Raises:
        UsageError: the source is no MCAP file, or one of the files cannot be used.
    """
    try:
        with source.open("rb") as stream, target.open("wb") as output:
            begun = has_begun(source, stream)
            stream.seek(0)
            if compressed:
                writer = Writer(output, compression=CompressionType.ZSTD)
            else:
                writer = Writer(output, compression=CompressionType.NONE, use_chunking=False)
            writer.start(profile="pomona", library="pomona")
            copied = _copy(stream, writer) if begun else Copied(0, 0.0, 0)
            writer.finish()
            return copied
    except OSError as error:
        raise UsageError(f"{target}: {error.strerror}") from error


def _copy(stream: BinaryIO, writer: Writer) -> Copied:
    schemas: dict[int, int] = {0: 0}
    channels: dict[int, int] = {}
    messages, last, good = 0, 0, 0
    for record, end in _records(stream):
        good = end
        if isinstance(record, Schema) and record.id not in schemas:
            schemas[record.id] = writer.register_schema(record.name, record.encoding, record.data)
        elif isinstance(record, Channel) and record.id not in channels:
            schema = schemas.get(record.schema_id, 0)
            channels[record.id] = writer.register_channel(
                record.topic, record.message_encoding, schema, record.metadata
            )
        elif isinstance(record, Message) and record.channel_id in channels:
            channel = channels[record.channel_id]
            writer.add_message(channel, record.log_time, record.data, record.publish_time, record.sequence)
            messages, last = messages + 1, max(last, record.log_time)
        elif isinstance(record, Attachment):
            writer.add_attachment(record.create_time, record.log_time, record.name, record.media_type, record.data)
        elif isinstance(record, Metadata):
            writer.add_metadata(record.name, record.metadata)
    size = os.fstat(stream.fileno()).st_size
    return Copied(messages, last / 1e9, size - good)


def _records(stream: BinaryIO) -> Iterator[tuple[Any, int]]:
    """Every record with the place where it ends, up to the first that is cut off or damaged."""
    records = StreamReader(stream, record_size_limit=os.fstat(stream.fileno()).st_size).records
    while True:
        try:
            record = next(records)
        except (StopIteration, McapError, EOFError, struct.error, ValueError, KeyError, OverflowError):
            return
        yield record, stream.tell()
