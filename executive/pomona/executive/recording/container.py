"""The bytes of an MCAP file, checked: chunks, attachments, the data section and the summary carry checksums (CRC-32).

https://mcap.dev/spec. A checksum finds what happened by accident: a flipped bit, a lost block, half a copy. Whoever
forges a record forges its checksums, too (docs/security.md).

What a file may cost is bounded: nothing is read into memory by a length that the file itself claims, a compressed chunk
may not grow beyond `MOST_GROWTH` times its size, and a file that becomes shorter while it is read is one that was cut.
"""

from __future__ import annotations

import io
import re
import struct
import zlib
from collections.abc import Iterator
from typing import BinaryIO, NamedTuple

import zstandard

from pomona.executive.errors import PomonaError
from pomona.executive.recording.checksum import crc_of_end

MAGIC = b"\x89MCAP0\r\n"
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX = 0x01, 0x02, 0x03, 0x04, 0x05, 0x06, 0x07
ATTACHMENT, METADATA, DATA_END = 0x09, 0x0C, 0x0F
SUMMARY = (SCHEMA, CHANNEL, 0x08, 0x0A, 0x0B, 0x0D, 0x0E)
"""What may stand between the data and the footer: schemas, channels, indexes, statistics, offsets."""

HEAD = struct.Struct("<BQ")
"""Of every record: what it is, and how many bytes follow."""
MESSAGE_HEAD = struct.Struct("<HIQQ")
"""Before a message's content: channel, sequence, two times [ns]."""
_CHUNK_HEAD = struct.Struct("<QQQII")
_FOOTER = struct.Struct("<QQI")

LIBRARY = "pomona 2"
"""What the header of a file says of its writer in which nothing may lack its checksum."""
MOST_BYTES = 256_000_000
"""Of one chunk or message. A recorder's are below 2 MB, or as large as one message that a skill publishes."""
MOST_MESSAGE = MOST_BYTES - 1_000_000
"""Largest message that is written [bytes]: its chunk also holds what was gathered before."""
MOST_GROWTH, FREE_GROWTH = 200, 16_000_000
"""A compressed chunk may hold `MOST_GROWTH` bytes for each of its own and `FREE_GROWTH` beside: JSON shrinks to a
twentieth, zeros to a ten-thousandth."""

_PIECE = 1 << 20
_CHUNK_START = re.compile(rb"\x06(?=(.{8}).{28}(?:\x00\x00\x00\x00|\x04\x00\x00\x00zstd))", re.DOTALL)


class DamagedError(PomonaError):
    """A piece of the file is not what its checksum or its form says."""

    def __init__(self, at: int, what: str) -> None:
        self.at, self.what = at, what
        super().__init__(f"{what} (byte {at} of the file)")


class CutError(PomonaError):
    """The file ends within a piece."""

    def __init__(self, at: int) -> None:
        self.at = at
        super().__init__(f"the file ends within the piece that begins at byte {at}")


class TopLevelRecord(NamedTuple):
    """One top-level record of the file.

    Attributes:
        opcode: what it is.
        at: where it begins; its content begins `HEAD.size` later.
        content: of everything but attachments, which are checked and left in the file; uncompressed for a chunk.
        end: where the next one begins.
        checked: its checksum was there and is right, or it needs none.
        compressed: a chunk whose messages do not stand in the file as they are.
        stamp: the newest time in a chunk [ns].
        oldest: the oldest one.
    """  # a plain tuple, since a record has 10 000 of them

    opcode: int
    at: int
    content: bytes
    end: int
    checked: bool = True
    compressed: bool = False
    stamp: int = 0
    oldest: int = 0


class Pieces:
    """The pieces of a file's data, in order, each checked.

    Attributes:
        at: where the next piece begins: everything before is whole.
        checked: every piece that was read, and at the end the data as a whole, had its checksum.
        finished: the data's end was reached.
    """

    def __init__(self, stream: BinaryIO) -> None:
        """
        Raises:
            CutError: the file ends within its first bytes.
            DamagedError: it does not begin as an MCAP file.
        """
        self._stream = stream
        self.size = _size_of(stream)
        self.at = 0
        self.checked = True
        self.finished = False
        self._crc = 0
        self._jumped = False
        self._strict = False
        if self._read(len(MAGIC)) != MAGIC:
            raise DamagedError(0, "it does not begin as an MCAP file")
        self.at = len(MAGIC)

    def __iter__(self) -> Iterator[TopLevelRecord]:
        """
        Raises:
            CutError, DamagedError: at the first piece that is not whole.
        """
        while not self.finished:
            piece = self._next()
            self.at = piece.end
            self.checked &= piece.checked
            yield piece

    def go_to(self, at: int) -> None:
        """Go on with the piece that begins there; the data as a whole can no longer be checked."""
        self._stream.seek(at)
        self.at, self.checked, self._jumped = at, False, True

    def _next(self) -> TopLevelRecord:
        before = self._crc
        opcode, length = HEAD.unpack(self._read(HEAD.size))
        begin = self.at + HEAD.size
        end = begin + length
        if opcode == ATTACHMENT:
            self._pass_attachment(begin, length)
            return TopLevelRecord(opcode, self.at, b"", end)
        if opcode not in (HEADER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX, METADATA, DATA_END):
            raise DamagedError(self.at, f"no piece of a record has the number {opcode}")
        if end > self.size:
            raise CutError(self.at)
        if length > MOST_BYTES:
            raise DamagedError(self.at, f"a piece of {length} bytes: at most {MOST_BYTES} are read")
        if opcode == CHUNK:
            return self._chunk(length, end)
        content = self._read(length)
        if opcode == HEADER:
            self._strict = content.endswith(LIBRARY.encode())
        if opcode == DATA_END:
            return self._data_end(content, end, before)
        if opcode == MESSAGE_INDEX and (length < 6 or length != 6 + int.from_bytes(content[2:6], "little")):
            raise DamagedError(self.at, "an index of messages has a wrong length")
        return TopLevelRecord(opcode, self.at, content, end, checked=opcode != MESSAGE)

    def _chunk(self, length: int, end: int) -> TopLevelRecord:
        content = self._taken(length)
        records, crc, compression = _unpacked(content, self.at)
        begin = len(content) - len(records)  # of what two checksums cover, read once for both
        before = self._crc if compression else zlib.crc32(content[:begin], self._crc)
        self._crc = zlib.crc32(content if compression else records, before)
        found = zlib.crc32(records) if compression else crc_of_end(before, self._crc, len(records))
        if (crc or self._strict) and found != crc:
            raise DamagedError(self.at, "a chunk does not match its checksum")
        oldest, newest = int.from_bytes(content[:8], "little"), int.from_bytes(content[8:16], "little")
        return TopLevelRecord(CHUNK, self.at, records, end, crc != 0, bool(compression), newest, oldest)

    def _data_end(self, content: bytes, end: int, before: int) -> TopLevelRecord:
        crc = int.from_bytes(content, "little")
        if len(content) != 4 or ((crc or self._strict) and crc != before and not self._jumped):
            raise DamagedError(self.at, "the data as a whole do not match their checksum")
        self.finished = True
        return TopLevelRecord(DATA_END, self.at, content, end, checked=crc == before)

    def _pass_attachment(self, begin: int, length: int) -> None:
        if begin + length > self.size:
            raise CutError(self.at)
        if length < 4:
            raise DamagedError(self.at, "an attachment has a wrong length")
        crc, left = 0, length - 4
        while left:
            piece = self._read(min(left, _PIECE))
            crc, left = zlib.crc32(piece, crc), left - len(piece)
        written = int.from_bytes(self._read(4), "little")
        if written != crc and (written or self._strict):
            raise DamagedError(self.at, "an attachment does not match its checksum")

    def _read(self, length: int) -> bytes:
        content = self._taken(length)
        self._crc = zlib.crc32(content, self._crc)
        return content

    def _taken(self, length: int) -> bytes:
        content = self._stream.read(length)
        if len(content) < length:
            raise CutError(self.at)
        return content

    # ---------------------------------------------------------------------------------------- behind the data

    def pass_summary(self) -> None:
        """Check what stands behind the data, up to the file's last byte.

        Raises:
            CutError, DamagedError: it is not whole.
        """
        start, crc = self.at, 0
        while True:
            head = self._read(HEAD.size)
            opcode, length = HEAD.unpack(head)
            if self.at + HEAD.size + length > self.size:
                raise CutError(self.at)
            if opcode == FOOTER and length == _FOOTER.size:
                footer = self._read(length)
                crc = zlib.crc32(head + footer[:16], crc)
                break
            if opcode not in SUMMARY or length > MOST_BYTES:
                raise DamagedError(self.at, f"no piece of a summary has the number {opcode}")
            crc = zlib.crc32(head + self._read(length), crc)
            self.at += HEAD.size + length
        summary, _offsets, written = _FOOTER.unpack(footer)
        if ((written or self._strict) and written != crc) or summary not in (0, start):
            raise DamagedError(self.at, "the summary does not match its checksum")
        self.checked &= written == crc
        self.at += HEAD.size + _FOOTER.size
        if self._read(len(MAGIC)) != MAGIC:
            raise DamagedError(self.at, "it does not end as an MCAP file")
        self.at += len(MAGIC)
        if self.at != self.size:
            raise DamagedError(self.at, f"{self.size - self.at} bytes stand behind its end")


def _unpacked(content: bytes, at: int) -> tuple[bytes, int, str]:
    """The records of a chunk as they are, their checksum (0: none), how they were compressed (empty: not at all)."""
    try:
        begin, end, size, crc, name = _CHUNK_HEAD.unpack_from(content)
        compression = content[_CHUNK_HEAD.size : _CHUNK_HEAD.size + name].decode("ascii")
        start = _CHUNK_HEAD.size + name + 8
        packed = content[start:]
        fits = int.from_bytes(content[start - 8 : start], "little") == len(packed) and begin <= end
    except (struct.error, UnicodeDecodeError) as error:
        raise DamagedError(at, "a chunk is shorter than its header") from error
    if not fits or (not compression and size != len(packed)):
        raise DamagedError(at, "a chunk's head says another length than it has")
    if not compression:
        return packed, crc, ""
    if compression != "zstd":
        raise DamagedError(at, "a chunk is packed in a way that is not read here: only zstd is")
    if size > min(MOST_BYTES, FREE_GROWTH + MOST_GROWTH * len(packed)):
        raise DamagedError(at, f"a chunk of {len(packed)} bytes would grow to {size}")
    return _grown(packed, size, at), crc, compression


def _grown(packed: bytes, size: int, at: int) -> bytes:
    """What a packed chunk holds; never more than `size` bytes and one piece are made of it."""
    grown, left = bytearray(), size
    try:
        with zstandard.ZstdDecompressor(max_window_size=1 << 27).stream_reader(packed) as stream:
            while piece := stream.read(min(left, _PIECE) + 1):
                grown += piece
                left = size - len(grown)
                if left < 0:
                    break
    except (zstandard.ZstdError, MemoryError) as error:
        raise DamagedError(at, f"a chunk cannot be unpacked ({error})") from error
    if len(grown) != size:
        raise DamagedError(at, "a chunk holds another number of bytes than its head says")
    return bytes(grown)


def _size_of(stream: BinaryIO) -> int:
    """How many bytes there are; the stream stays where it is."""
    here = stream.tell()
    size = stream.seek(0, io.SEEK_END)
    stream.seek(here)
    return size


def next_chunk(stream: BinaryIO, start: int) -> int | None:
    """Where the next whole chunk begins at or after a place, or None. Its checksum is checked."""
    size = _size_of(stream)
    at = start
    while at < size:
        stream.seek(at)
        window = stream.read(_PIECE + 64)
        for found in _CHUNK_START.finditer(window):
            begin, length = at + found.start(), int.from_bytes(found[1], "little")
            if found.start() < _PIECE and begin + HEAD.size + length <= size and _is_chunk(stream, begin, length):
                return begin
        at += _PIECE
    return None


def _is_chunk(stream: BinaryIO, begin: int, length: int) -> bool:
    if not _CHUNK_HEAD.size + 8 <= length <= MOST_BYTES:
        return False
    stream.seek(begin + HEAD.size)
    try:
        records, crc, _compression = _unpacked(stream.read(length), begin)
    except DamagedError:
        return False
    return crc != 0 and zlib.crc32(records) == crc


def records_of(chunk: bytes, at: int) -> Iterator[tuple[int, int, int]]:
    """(opcode, begin, end) of every record in a chunk's content.

    Raises:
        DamagedError: it does not consist of records.
    """
    place, size = 0, len(chunk)
    while place < size:
        if place + HEAD.size > size:
            raise DamagedError(at, "a chunk does not consist of whole messages")
        opcode, length = HEAD.unpack_from(chunk, place)
        begin = place + HEAD.size
        place = begin + length
        if place > size:
            raise DamagedError(at, "a chunk does not consist of whole messages")
        yield opcode, begin, place
