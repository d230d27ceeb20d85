"""Iterate over a record's messages without decoding them; each is checked before it is yielded.

A record is trusted as a whole or not at all: `examine` reads the file once and says whether it is as it was written;
`scan` yields messages only from files that are whole, or whole up to where they were cut off.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import BinaryIO, NamedTuple

from pomona.executive.errors import UsageError
from pomona.executive.recording.container import (
    ATTACHMENT,
    CHANNEL,
    CHUNK,
    HEAD,
    MAGIC,
    MESSAGE,
    MESSAGE_HEAD,
    MESSAGE_INDEX,
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
from pomona.executive.recording.folder import EVENTS
from pomona.executive.recording.plain_file import open_plain

_CHANNEL_HEAD = struct.Struct("<HHI")
REPAIR = "pomona.repair"
"""Name of the metadata that lists what a repair could not save."""


class DamagedRecordError(UsageError):
    """A record fails its checks, so nothing in it is trusted."""


class Chunk(NamedTuple):
    """Offset of a chunk in the file, its oldest and newest stamp [ns], and how many events precede it."""

    at: int
    oldest: int
    newest: int
    events_before: int


@dataclass(frozen=True, slots=True)
class ChunkTable:
    """The chunks of a file in order, and its topics by channel number."""

    chunks: tuple[Chunk, ...]
    topics: Mapping[int, str]

    def within(self, begin: int, end: int) -> list[Chunk]:
        """Chunks with messages from an interval of time [ns]."""
        return [chunk for chunk in self.chunks if chunk.oldest <= end and chunk.newest >= begin]


@dataclass(frozen=True, slots=True)
class Verdict:
    """What an examination found.

    Attributes:
        state: whole, cut off (whole up to there) or damaged.
        why: what is wrong, for people; empty when nothing is.
        t: run time up to which it is whole [s].
        good: number of bytes up to which it is whole.
        checked: whether everything read has a checksum. Files of older versions of Pomona, and of some other programs,
            have none.
        compressed: whether any chunk is compressed.
        lost: what an earlier repair could not save, for people; empty when there was none.
        attachments: their offsets in the file.
        table: its chunks, if each has its message indexes and no message lies outside a chunk; else None.
    """

    state: str
    why: str = ""
    t: float = 0.0
    good: int = 0
    checked: bool = True
    compressed: bool = False
    lost: str = ""
    attachments: tuple[int, ...] = ()
    table: ChunkTable | None = None


class Found(NamedTuple):
    """One message.

    Attributes:
        topic: its channel's.
        stamp: time on the run's clock [ns].
        content: its bytes, as written.
        at: offset of its record in the file; -1 in a compressed chunk.
    """  # a plain tuple, since a record has 100 000 of them

    topic: str
    stamp: int
    content: bytes
    at: int


def examine(path: Path) -> Verdict:
    """Check every byte of a file.

    Raises:
        UsageError: it is not an MCAP file, or cannot be read.
    """
    try:
        with open_plain(path) as stream:
            return _examined(path, stream)
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror}") from error


def is_whole(path: Path) -> bool:
    """Whether an MCAP file was finished and is as it was written.

    Raises:
        UsageError: it is not an MCAP file, or cannot be read.
    """
    return examine(path).state == "whole"


def believed(path: Path) -> Verdict:
    """The verdict on a file that can be trusted, at least up to where it was cut off.

    Raises:
        DamagedRecordError: it is damaged.
        UsageError: it is not an MCAP file, or cannot be read.
    """
    verdict = examine(path)
    if verdict.state == "damaged":
        raise DamagedRecordError(f"{path}: the record is damaged and is not trusted: {verdict.why}. {REMEDY}")
    return verdict


REMEDY = "`pomona runs repair` saves what is whole"


def scan(path: Path, verdict: Verdict | None = None) -> Iterator[tuple[str, bytes]]:
    """(topic, content) of every message; of a record that was cut off, up to there.

    Args:
        path: of the MCAP file.
        verdict: result of `believed`, if it is known already.

    Raises:
        DamagedRecordError: something in it is not as it was written.
        UsageError: it is not an MCAP file, or cannot be read.
    """
    return ((found.topic, found.content) for found in walk(path, verdict))


def walk(path: Path, verdict: Verdict | None = None) -> Iterator[Found]:
    """Every message, like `scan`.

    Raises:
        DamagedRecordError: something in it is not as it was written.
        UsageError: it is not an MCAP file, or cannot be read.
    """
    good = (verdict or believed(path)).good
    topics: dict[int, str] = {}
    try:
        with open_plain(path) as stream:
            if good <= len(MAGIC) or not has_begun(path, stream):
                return
            for piece in Pieces(stream):
                yield from messages_of(piece, topics)
                if piece.end >= good:  # the rest was written since the examination, or is incomplete
                    return
    except CutError:
        return
    except DamagedError as error:  # since it was examined
        raise DamagedRecordError(f"{path}: the record is damaged and is not trusted: {error}. {REMEDY}") from error
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror}") from error


def walk_topics(
    path: Path, wanted: Callable[[str], bool], begin: int = 0, end: int = 2**64, verdict: Verdict | None = None
) -> Iterator[Found]:
    """The messages of some topics, found by the chunks' indexes; outside begin ≤ stamp ≤ end their content is empty.

    Raises:
        DamagedRecordError, UsageError: as `walk`.
    """
    good = (verdict or believed(path)).good
    topics: dict[int, str] = {}
    chunk: TopLevelRecord | None = None
    indexes: list[bytes] = []
    try:
        with open_plain(path) as stream:
            if good <= len(MAGIC) or not has_begun(path, stream):
                return
            try:
                for piece in Pieces(stream):
                    if piece.opcode == MESSAGE_INDEX and chunk is not None:
                        indexes.append(piece.content)
                    else:
                        if chunk is not None:
                            yield from _indexed(chunk, indexes, topics, wanted, begin, end)
                        chunk, indexes = (piece, []) if piece.opcode == CHUNK else (None, [])
                        if chunk is None:
                            yield from (found for found in messages_of(piece, topics) if wanted(found.topic))
                    if piece.end >= good:
                        break
            except CutError:
                pass
            if chunk is not None:  # its indexes may be cut off
                yield from (found for found in messages_of(chunk, topics) if wanted(found.topic))
    except DamagedError as error:
        raise DamagedRecordError(f"{path}: the record is damaged and is not trusted: {error}. {REMEDY}") from error
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror}") from error


_INDEX_ENTRY = struct.Struct("<QQ")


def _indexed(
    chunk: TopLevelRecord,
    indexes: list[bytes],
    topics: dict[int, str],
    wanted: Callable[[str], bool],
    begin: int,
    end: int,
) -> Iterator[Found]:
    channels = [int.from_bytes(content[:2], "little") for content in indexes]
    if not indexes or not topics.keys() >= set(channels):
        for opcode, first, last in records_of(chunk.content, chunk.at):
            if opcode == CHANNEL:
                _add_channel(chunk, first, last, topics)
    if not indexes or chunk.compressed or not topics.keys() >= set(channels):
        yield from (found for found in messages_of(chunk, topics) if wanted(found.topic))
        return
    start = chunk.end - len(chunk.content)
    places = sorted(
        (offset, stamp, topics[channel])
        for channel, content in zip(channels, indexes, strict=True)
        if wanted(topics[channel])
        for stamp, offset in _INDEX_ENTRY.iter_unpack(content[6:])
    )
    for offset, stamp, topic in places:
        content = _message_at(chunk, offset) if begin <= stamp <= end else b""
        yield Found(topic, stamp, content, start + offset)


def _message_at(chunk: TopLevelRecord, offset: int) -> bytes:
    if offset + HEAD.size <= len(chunk.content):
        opcode, length = HEAD.unpack_from(chunk.content, offset)
        last = offset + HEAD.size + length
        if opcode == MESSAGE and MESSAGE_HEAD.size <= length and last <= len(chunk.content):
            return chunk.content[offset + HEAD.size + MESSAGE_HEAD.size : last]
    raise DamagedError(chunk.at, "a message index points to a place where no message begins")


def read_chunks(path: Path, chunks: Iterable[Chunk], table: ChunkTable) -> Iterator[tuple[Chunk, Iterator[Found]]]:
    """Some chunks of a trusted file, each with its messages; nothing else in the file is read.

    Raises:
        DamagedRecordError: something in them is not as it was written.
        UsageError: the file cannot be read.
    """
    topics = dict(table.topics)
    try:
        with open_plain(path) as stream:
            pieces = Pieces(stream)
            for chunk in chunks:
                pieces.go_to(chunk.at)
                yield chunk, messages_of(next(iter(pieces)), topics)
    except (CutError, DamagedError) as error:  # since it was examined
        raise DamagedRecordError(f"{path}: the record is damaged and is not trusted: {error}. {REMEDY}") from error
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror}") from error


def attachment(path: Path, name: str, verdict: Verdict) -> bytes | None:
    """The newest attachment of this name in a trusted file, or None.

    Raises:
        UsageError: the file cannot be read.
    """
    try:
        with open_plain(path) as stream:
            for at in reversed(verdict.attachments):
                stream.seek(at)
                opcode, length = HEAD.unpack(stream.read(HEAD.size))
                head = stream.read(min(length, _ATTACHMENT_HEAD + len(name.encode())))
                if opcode == ATTACHMENT and head[16:] == len(name.encode()).to_bytes(4, "little") + name.encode():
                    if length > MOST_BYTES:
                        return None
                    rest = stream.read(length - len(head) - 4)
                    start = 4 + int.from_bytes(rest[:4], "little") + 8  # after the media type and the size
                    return rest[start:]
    except (OSError, struct.error) as error:
        raise UsageError(f"{path}: {error}") from error
    return None


_ATTACHMENT_HEAD = 20


def messages_of(piece: TopLevelRecord, topics: dict[int, str]) -> Iterator[Found]:
    """The messages of a top-level record; channels found in it are added to `topics` (number → topic).

    Raises:
        DamagedError: it holds something other than messages of known channels.
    """
    if piece.opcode == CHUNK:
        offset = -1 if piece.compressed else piece.end - len(piece.content) - HEAD.size
        for opcode, begin, end in records_of(piece.content, piece.at):
            if opcode == MESSAGE:
                yield _message(piece, begin, end, topics, -1 if offset < 0 else offset + begin)
            elif opcode == CHANNEL:
                _add_channel(piece, begin, end, topics)
            elif opcode != SCHEMA:
                raise DamagedError(piece.at, f"a chunk holds a record with the opcode {opcode}")
    elif piece.opcode == CHANNEL:
        _add_channel(piece, 0, len(piece.content), topics)
    elif piece.opcode == MESSAGE:
        yield _message(piece, 0, len(piece.content), topics, piece.at)


def _message(piece: TopLevelRecord, begin: int, end: int, topics: dict[int, str], at: int) -> Found:
    if end - begin < MESSAGE_HEAD.size:
        raise DamagedError(piece.at, "a message is shorter than its header")
    channel, _sequence, stamp, _published = MESSAGE_HEAD.unpack_from(piece.content, begin)
    if channel not in topics:
        raise DamagedError(piece.at, f"a message belongs to channel {channel}, which is not declared")
    return Found(topics[channel], stamp, piece.content[begin + MESSAGE_HEAD.size : end], at)


def _add_channel(piece: TopLevelRecord, begin: int, end: int, topics: dict[int, str]) -> None:
    if end - begin < _CHANNEL_HEAD.size:
        raise DamagedError(piece.at, "a channel is shorter than its header")
    channel, _schema, size = _CHANNEL_HEAD.unpack_from(piece.content, begin)
    name = piece.content[begin + _CHANNEL_HEAD.size : begin + _CHANNEL_HEAD.size + size]
    topics[channel] = name.decode(errors="replace")


def has_begun(path: Path, stream: BinaryIO) -> bool:
    """Whether the file begins as MCAP; False when the process was killed before it wrote that. Rewinds the stream.

    Raises:
        UsageError: it is no MCAP file.
    """
    start = stream.read(len(MAGIC))
    stream.seek(0)
    if start != MAGIC and not MAGIC.startswith(start):
        raise UsageError(f"{path}: not a record of a run: it is not an MCAP file")
    return start == MAGIC


def _examined(path: Path, stream: BinaryIO) -> Verdict:
    if not has_begun(path, stream):
        return Verdict("cut off", "the file ends within its header")
    pieces = Pieces(stream)
    topics: dict[int, str] = {}
    stamp, compressed, lost = 0, False, ""
    attachments: list[int] = []
    table = _TableMaker()

    def verdict(state: str, why: str) -> Verdict:
        made = table.made()
        return Verdict(state, why, stamp / 1e9, pieces.at, pieces.checked, compressed, lost, tuple(attachments), made)

    try:
        for piece in pieces:
            compressed |= piece.compressed
            stamp = max(stamp, piece.stamp)
            table.take(piece)
            if piece.opcode in (CHANNEL, MESSAGE):  # a chunk's content is checked when it is read
                for found in messages_of(piece, topics):
                    stamp = max(stamp, found.stamp)
            if piece.opcode == ATTACHMENT:
                attachments.append(piece.at)
            if piece.opcode == METADATA and REPAIR.encode() in piece.content[:40]:
                lost = metadata_of(piece).get(REPAIR, {}).get("lost", lost)
        good = verdict("whole", "")
        pieces.pass_summary()
    except CutError as error:
        cut = _is_cut(stream, error.at)
        if pieces.finished and cut:
            return replace(good, state="cut off", why="its summary is missing")
        if cut:
            return verdict("cut off", f"the file ends after {error.at} bytes")
        return verdict("damaged", str(DamagedError(error.at, "a record has a wrong length")))
    except DamagedError as error:
        if _zeros_from(stream, error.at):
            return verdict("cut off", f"only zeros follow after {error.at} bytes, as after a power failure")
        return verdict("damaged", f"{error}, at {stamp / 1e9:.2f} s of the run")
    return replace(good, checked=pieces.checked)


class _TableMaker:
    """Builds the table of a file's chunks from its top-level records."""

    def __init__(self) -> None:
        self._chunks: list[Chunk] = []
        self._topics: dict[int, str] = {}
        self._events = 0
        self._chunk: TopLevelRecord | None = None  # whose indexes follow
        self._indexed, self._usable = True, True

    def take(self, piece: TopLevelRecord) -> None:
        """Take the next record."""
        if piece.opcode == CHUNK:
            self._usable &= self._indexed and not piece.compressed
            self._chunks.append(Chunk(piece.at, piece.oldest, piece.stamp, self._events))
            self._chunk, self._indexed = piece, False
        elif piece.opcode == MESSAGE_INDEX and self._chunk is not None:
            self._count(self._chunk, int.from_bytes(piece.content[:2], "little"), (len(piece.content) - 6) // 16)
        elif piece.opcode == MESSAGE:
            self._usable = False
        else:
            self._chunk = None

    def made(self) -> ChunkTable | None:
        """The table of the records taken; the last chunk may lack its indexes, since nothing is counted from them."""
        return ChunkTable(tuple(self._chunks), self._topics) if self._usable and self._chunks else None

    def _count(self, chunk: TopLevelRecord, channel: int, messages: int) -> None:
        self._indexed = True
        if channel not in self._topics:
            try:
                for opcode, begin, end in records_of(chunk.content, chunk.at):
                    if opcode == CHANNEL:
                        _add_channel(chunk, begin, end, self._topics)
            except DamagedError:  # reported when the chunk is read
                self._usable = False
        self._events += messages if self._topics.get(channel) == EVENTS else 0


def _is_cut(stream: BinaryIO, at: int) -> bool:
    """Whether a file that ends within a record was cut off there; otherwise the record's length is wrong."""
    end = stream.seek(0, os.SEEK_END) - len(MAGIC)
    if end >= len(MAGIC):
        stream.seek(end)
        if stream.read() == MAGIC:
            return False
    return next_chunk(stream, at + 1) is None


def _zeros_from(stream: BinaryIO, at: int) -> bool:
    stream.seek(at)
    while piece := stream.read(1 << 20):
        if piece.count(0) != len(piece):
            return False
    return True


def metadata_of(piece: TopLevelRecord) -> dict[str, dict[str, str]]:
    """The metadata of a record, by name; empty when it cannot be read."""
    words: list[str] = []
    place, content = 0, piece.content
    while place + 4 <= len(content):
        length = int.from_bytes(content[place : place + 4], "little")
        words.append(content[place + 4 : place + 4 + length].decode(errors="replace"))
        place += 4 + length + (4 if len(words) == 1 else 0)  # the name is followed by the map's length
    return {words[0]: dict(zip(words[1::2], words[2::2], strict=False))} if words else {}
