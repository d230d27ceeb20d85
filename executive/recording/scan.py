"""Through a record's messages without decoding them, each checked before it is given away.

A record is believed as a whole or not at all: `examine` goes through the file once and says whether everything in it is
as it was written, and `scan` gives messages only of files that are whole, or whole up to where they were cut off.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, NamedTuple

from executive.errors import UsageError
from executive.recording.container import (
    CHANNEL,
    CHUNK,
    HEAD,
    MAGIC,
    MESSAGE,
    MESSAGE_HEAD,
    METADATA,
    SCHEMA,
    CutError,
    DamagedError,
    Piece,
    Pieces,
    next_chunk,
    records_of,
)
from executive.recording.plain_file import open_plain

_CHANNEL_HEAD = struct.Struct("<HHI")
REPAIR = "pomona.repair"
"""Name of the metadata that say what a repair could not save."""


class DamagedRecordError(UsageError):
    """A record fails its checks, so nothing in it is believed."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """What an examination found.

    Attributes:
        state: whole, cut off (everything up to there is), damaged.
        why: what is wrong, for people; empty when nothing is.
        t: seconds of the run up to which it is whole.
        good: bytes up to which it is whole.
        checked: everything that was read has a checksum. Not so in files that Pomona wrote before it had them, and in
            some of other programs.
        compressed: messages do not stand in the file as they are.
        lost: what a repair before could not save, for people; empty when there was none.
    """

    state: str
    why: str = ""
    t: float = 0.0
    good: int = 0
    checked: bool = True
    compressed: bool = False
    lost: str = ""


class Found(NamedTuple):
    """One message.

    Attributes:
        topic: of its channel.
        stamp: nanoseconds of the run's clock.
        content: as it was written.
        at: where its record begins in the file; -1 in a compressed chunk.
    """  # a plain tuple, since a record has 100 000 of them

    topic: str
    stamp: int
    content: bytes
    at: int


def examine(path: Path) -> Verdict:
    """Check every byte of a file.

    Raises:
        UsageError: it is no MCAP file, or cannot be read.
    """
    try:
        with open_plain(path) as stream:
            return _examined(path, stream)
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror}") from error


def is_whole(path: Path) -> bool:
    """Whether an MCAP file was finished and is as it was written.

    Raises:
        UsageError: it is no MCAP file, or cannot be read.
    """
    return examine(path).state == "whole"


def believed(path: Path) -> Verdict:
    """The verdict on a file that may be believed, as far as it goes.

    Raises:
        DamagedRecordError: it is damaged.
        UsageError: it is no MCAP file, or cannot be read.
    """
    verdict = examine(path)
    if verdict.state == "damaged":
        raise DamagedRecordError(f"{path}: the record is damaged and is not believed: {verdict.why}. {REMEDY}")
    return verdict


REMEDY = "`pomona runs repair` saves what is whole"


def scan(path: Path, verdict: Verdict | None = None) -> Iterator[tuple[str, bytes]]:
    """(topic, content) of every message. A record that was cut off gives the messages up to there.

    Args:
        path: of the MCAP file.
        verdict: of `believed`, if that was asked just now.

    Raises:
        DamagedRecordError: something in it is not as it was written.
        UsageError: it is no MCAP file, or cannot be read.
    """
    return ((found.topic, found.content) for found in walk(path, verdict))


def walk(path: Path, verdict: Verdict | None = None) -> Iterator[Found]:
    """Every message, like `scan`.

    Raises:
        DamagedRecordError: something in it is not as it was written.
        UsageError: it is no MCAP file, or cannot be read.
    """
    good = (verdict or believed(path)).good
    topics: dict[int, str] = {}
    try:
        with open_plain(path) as stream:
            if good <= len(MAGIC) or not has_begun(path, stream):
                return
            for piece in Pieces(stream):
                yield from messages_of(piece, topics)
                if piece.end >= good:  # what follows was written since it was examined, or is not whole
                    return
    except CutError:
        return
    except DamagedError as error:  # since it was examined
        raise DamagedRecordError(f"{path}: the record is damaged and is not believed: {error}. {REMEDY}") from error
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror}") from error


def messages_of(piece: Piece, topics: dict[int, str]) -> Iterator[Found]:
    """The messages of a piece; `topics` are the channels' by number, and grow.

    Raises:
        DamagedError: it holds something else than messages of channels that are known.
    """
    if piece.opcode == CHUNK:
        offset = -1 if piece.compressed else piece.end - len(piece.content) - HEAD.size
        for opcode, begin, end in records_of(piece.content, piece.at):
            if opcode == MESSAGE:
                yield _message(piece, begin, end, topics, -1 if offset < 0 else offset + begin)
            elif opcode == CHANNEL:
                _add_channel(piece, begin, end, topics)
            elif opcode != SCHEMA:
                raise DamagedError(piece.at, f"a chunk holds a piece of the number {opcode}")
    elif piece.opcode == CHANNEL:
        _add_channel(piece, 0, len(piece.content), topics)
    elif piece.opcode == MESSAGE:
        yield _message(piece, 0, len(piece.content), topics, piece.at)


def _message(piece: Piece, begin: int, end: int, topics: dict[int, str], at: int) -> Found:
    if end - begin < MESSAGE_HEAD.size:
        raise DamagedError(piece.at, "a message has no head")
    channel, _sequence, stamp, _published = MESSAGE_HEAD.unpack_from(piece.content, begin)
    if channel not in topics:
        raise DamagedError(piece.at, f"a message belongs to channel {channel}, and there is none")
    return Found(topics[channel], stamp, piece.content[begin + MESSAGE_HEAD.size : end], at)


def _add_channel(piece: Piece, begin: int, end: int, topics: dict[int, str]) -> None:
    if end - begin < _CHANNEL_HEAD.size:
        raise DamagedError(piece.at, "a channel has no head")
    channel, _schema, size = _CHANNEL_HEAD.unpack_from(piece.content, begin)
    name = piece.content[begin + _CHANNEL_HEAD.size : begin + _CHANNEL_HEAD.size + size]
    topics[channel] = name.decode(errors="replace")


def has_begun(path: Path, stream: BinaryIO) -> bool:
    """Whether the head of an MCAP file stands there; False when the process was killed before that. Rewinds the stream.

    Raises:
        UsageError: it is no MCAP file.
    """
    start = stream.read(len(MAGIC))
    stream.seek(0)
    if start != MAGIC and not MAGIC.startswith(start):
        raise UsageError(f"{path}: not a record of a run: it is no MCAP file")
    return start == MAGIC


def _examined(path: Path, stream: BinaryIO) -> Verdict:
    if not has_begun(path, stream):
        return Verdict("cut off", "the file ends before it begins")
    pieces = Pieces(stream)
    topics: dict[int, str] = {}
    stamp, compressed, lost = 0, False, ""

    def verdict(state: str, why: str) -> Verdict:
        return Verdict(state, why, stamp / 1e9, pieces.at, pieces.checked, compressed, lost)

    try:
        for piece in pieces:
            compressed |= piece.compressed
            stamp = max(stamp, piece.stamp)
            if piece.opcode != CHUNK:  # what a chunk holds is looked at when it is read: its checksum is right
                for found in messages_of(piece, topics):
                    stamp = max(stamp, found.stamp)
            if piece.opcode == METADATA and REPAIR.encode() in piece.content[:40]:
                lost = metadata_of(piece).get(REPAIR, {}).get("lost", lost)
        good = verdict("whole", "")
        pieces.pass_summary()
    except CutError as error:
        cut = _is_cut(stream, error.at)
        if pieces.finished and cut:
            return Verdict("cut off", "its summary is missing", good.t, good.good, good.checked, compressed, lost)
        if cut:
            return verdict("cut off", f"the file ends after {error.at} bytes")
        return verdict("damaged", str(DamagedError(error.at, "a piece has a wrong length")))
    except DamagedError as error:
        if _zeros_from(stream, error.at):
            return verdict("cut off", f"only zeros follow after {error.at} bytes, as after a loss of power")
        return verdict("damaged", f"{error}, at {stamp / 1e9:.2f} s of the run")
    return Verdict("whole", "", good.t, good.good, pieces.checked, compressed, lost)


def _is_cut(stream: BinaryIO, at: int) -> bool:
    """Whether a file that ends within a piece was cut there; otherwise the piece's length is wrong."""
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


def metadata_of(piece: Piece) -> dict[str, dict[str, str]]:
    """The metadata of a piece, under their name; empty when they cannot be read."""
    words: list[str] = []
    place, content = 0, piece.content
    while place + 4 <= len(content):
        length = int.from_bytes(content[place : place + 4], "little")
        words.append(content[place + 4 : place + 4 + length].decode(errors="replace"))
        place += 4 + length + (4 if len(words) == 1 else 0)  # behind the name stands how long the map is
    return {words[0]: dict(zip(words[1::2], words[2::2], strict=False))} if words else {}
