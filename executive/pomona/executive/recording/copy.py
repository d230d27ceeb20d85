"""One MCAP file into another, as far as it is whole: to repair a record, and to export it indexed and compressed."""

from __future__ import annotations

import io
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.records import Attachment, Channel, Schema
from mcap.writer import CompressionType, Writer

from pomona.executive.errors import UsageError
from pomona.executive.recording.container import (
    ATTACHMENT,
    CHANNEL,
    CHUNK,
    HEAD,
    LIBRARY,
    MESSAGE,
    MESSAGE_HEAD,
    METADATA,
    MOST_BYTES,
    SCHEMA,
    CutError,
    DamagedError,
    Pieces,
    TopLevelRecord,
    next_chunk,
    records_of,
)
from pomona.executive.recording.overview import OVERVIEW
from pomona.executive.recording.plain_file import open_plain
from pomona.executive.recording.recorder import new_writer
from pomona.executive.recording.scan import REPAIR, has_begun, metadata_of

_UNREADABLE = (McapError, struct.error, ValueError, OverflowError)
EVENT_START = b'{"event":"'
"""How a message on /events begins: that is what is known of a channel whose description was lost."""


@dataclass(frozen=True, slots=True)
class Copied:
    """What was copied.

    Attributes:
        messages: how many.
        seconds: of the run, up to the last of them.
        cut: bytes at the end that are no whole piece.
        gaps: pieces in the middle that were lost, each as (first byte, bytes, seconds of the run before, after).
    """

    messages: int = 0
    seconds: float = 0.0
    cut: int = 0
    gaps: tuple[tuple[int, int, float, float], ...] = ()

    @property
    def lost(self) -> str:
        """What was lost in the middle, for people; empty when nothing was."""
        parts = [f"{size} bytes between {before:.2f} and {after:.2f} s" for _at, size, before, after in self.gaps]
        return " and ".join(parts)


def copy(source: Path, target: Path, *, compressed: bool) -> Copied:
    """Copy every whole piece; behind a damaged one it goes on with the next whole chunk.

    Args:
        source, target: files; the target is replaced.
        compressed: with zstd, for other tools; otherwise as a run writes it.

    Raises:
        UsageError: the source is not an MCAP file, or one of the files cannot be used.
    """
    try:
        with open_plain(source) as stream, target.open("wb") as output:
            begun = has_begun(source, stream)
            writer = new_writer(output, CompressionType.ZSTD if compressed else CompressionType.NONE)
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
        self._stream, self._writer = stream, writer
        self._schemas: dict[int, int] = {0: 0}
        self._channels: dict[int, int] = {}
        self._messages, self._newest = 0, 0

    def run(self, flush: bool) -> Copied:
        pieces = Pieces(self._stream)
        gaps: list[tuple[int, int, float, float]] = []
        lost_since: tuple[int, float] | None = None
        while not pieces.finished:
            try:
                for piece in pieces:
                    oldest = self._copy(piece)
                    if lost_since is not None and oldest is not None:
                        begin, t = lost_since
                        gaps.append((begin, piece.at - begin, t, oldest / 1e9))
                        lost_since = None
                    if flush and piece.opcode == CHUNK:
                        self._writer.flush()
            except (CutError, DamagedError) as error:
                at = max(error.at, pieces.at)
                upcoming = next_chunk(self._stream, at + 1)
                lost_since = lost_since or (at, self._newest / 1e9)
                if upcoming is None:
                    break
                pieces.go_to(upcoming)
        if pieces.finished and lost_since is None:
            return Copied(self._messages, self._newest / 1e9, 0, tuple(gaps))
        begin = pieces.at if lost_since is None else lost_since[0]
        return Copied(self._messages, self._newest / 1e9, pieces.size - begin, tuple(gaps))

    def _copy(self, piece: TopLevelRecord) -> int | None:
        """Copy one piece; the oldest time of its messages [ns], if it has any."""
        if piece.opcode == CHUNK:
            stamps = [
                self._record(opcode, piece.content, begin, end, piece.at)
                for opcode, begin, end in records_of(piece.content, piece.at)
            ]
            return min((stamp for stamp in stamps if stamp is not None), default=None)
        if piece.opcode == ATTACHMENT:
            self._attach(piece)
        elif piece.opcode == METADATA:
            for name, facts in metadata_of(piece).items():
                self._writer.add_metadata(name, facts)
        elif piece.opcode in (SCHEMA, CHANNEL, MESSAGE):
            return self._record(piece.opcode, piece.content, 0, len(piece.content), piece.at)
        return None

    def _record(self, opcode: int, content: bytes, begin: int, end: int, at: int) -> int | None:
        try:
            if opcode == SCHEMA:
                schema = Schema.read(_stream_of(content, begin, end))
                if schema.id not in self._schemas:
                    self._schemas[schema.id] = self._writer.register_schema(schema.name, schema.encoding, schema.data)
            elif opcode == CHANNEL:
                channel = Channel.read(_stream_of(content, begin, end))
                if channel.id not in self._channels:
                    self._channels[channel.id] = self._writer.register_channel(
                        channel.topic, channel.message_encoding, self._schemas.get(channel.schema_id, 0)
                    )
            elif opcode == MESSAGE:
                return self._message(content, begin, end)
        except _UNREADABLE as error:
            raise DamagedError(at, "a description of a channel cannot be read") from error
        return None

    def _message(self, content: bytes, begin: int, end: int) -> int | None:
        channel, sequence, stamp, published = MESSAGE_HEAD.unpack_from(content, begin)
        data = content[begin + MESSAGE_HEAD.size : end]
        if channel not in self._channels:
            if not data.startswith(EVENT_START):
                return None  # its description stood in a piece that was lost: nobody knows what it is
            self._channels[channel] = self._writer.register_channel("/events", "json", 0)
        self._writer.add_message(self._channels[channel], stamp, data, published, sequence)
        self._messages, self._newest = self._messages + 1, max(self._newest, stamp)
        return int(stamp)

    def _attach(self, piece: TopLevelRecord) -> None:
        size = piece.end - piece.at - HEAD.size
        if size > MOST_BYTES:
            raise DamagedError(piece.at, f"an attachment of {size} bytes: at most {MOST_BYTES} are read")
        back = self._stream.tell()
        self._stream.seek(piece.at + HEAD.size)
        content = self._stream.read(size)
        self._stream.seek(back)
        try:
            found = Attachment.read(_stream_of(content, 0, size))
        except _UNREADABLE as error:
            raise DamagedError(piece.at, "an attachment cannot be read") from error
        if found.name != OVERVIEW:  # it counts events and images of the original
            self._writer.add_attachment(found.create_time, found.log_time, found.name, found.media_type, found.data)


def _stream_of(content: bytes, begin: int, end: int) -> ReadDataStream:
    return ReadDataStream(io.BytesIO(content[begin:end]))
