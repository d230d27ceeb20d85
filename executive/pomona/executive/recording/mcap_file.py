"""Parts of an MCAP file (https://mcap.dev/spec), decoded by the `mcap` library and checked.

The library decodes records leniently. Here each record must be complete, use its whole length and match its checksum
(CRC-32), if it has one. A checksum detects accidents: a changed bit, a lost block, half a copy. A forger also forges
the checksums (docs/security.md).

Reading costs a bounded amount of memory: a length that the file claims allocates nothing, and a compressed chunk grows
to at most `FREE_GROWTH` bytes plus `MOST_GROWTH` times its size.
"""

from __future__ import annotations

import io
import os
import re
import struct
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import zstandard
from mcap import records
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile, McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Chunk, McapRecord, Message
from mcap.stream_reader import CRCValidationError, breakup_chunk, get_chunk_data_stream

from pomona.executive.errors import PomonaError, UsageError

MAGIC = b"\x89MCAP0\r\n"
HEAD = struct.Struct(
    "<BQ"
)  # start of every record in the file: opcode and number of the following bytes

LIBRARY = "pomona 2"  # in the header of this recorder's files: all checksums are present, all chunks indexed
MOST_BYTES = 256_000_000  # largest record that is read [bytes]; chunks are below 2 MB or one published message
MOST_MESSAGE = (
    MOST_BYTES - 1_000_000
)  # largest message that is written [bytes]: its chunk also holds earlier messages

MOST_GROWTH = 200
FREE_GROWTH = 16_000_000
"""Largest size of a decompressed chunk: per compressed byte, and in addition [bytes]. JSON shrinks to a twentieth."""

_PIECE = 1 << 20

_CHUNK_START = re.compile(
    rb"\x06(?=(.{8}).{28}(?:\x00\x00\x00\x00|\x04\x00\x00\x00zstd))", re.DOTALL
)

_UNREADABLE = (
    McapError,
    zstandard.ZstdError,
    struct.error,
    ValueError,
    OverflowError,
    MemoryError,
    KeyError,
)
"""Errors of the library for a malformed file."""

_KINDS: Mapping[int, Any] = {
    int(kind): getattr(records, kind.name.title().replace("_", "")) for kind in Opcode
}
"""Class of the library for each opcode."""


class DamagedError(PomonaError):
    """A record of the file contradicts its checksum or its format."""

    def __init__(self, at: int, what: str) -> None:
        self.at = at
        self.what = what
        super().__init__(f"{what} (byte {at} of the file)")


class CutError(PomonaError):
    """The file ends within a record."""

    def __init__(self, at: int) -> None:
        self.at = at
        super().__init__(f"the file ends within the record at byte {at}")


class RawRecord(NamedTuple):
    """One top-level record of the file, as bytes: its opcode, offset and content, and the offset of the next one."""

    opcode: int
    at: int
    content: bytes
    end: int


def has_begun(path: Path, stream: BinaryIO) -> bool:
    """Return True if the file begins as MCAP, False if the process was killed before that. Rewinds the stream.

    Raises UsageError: it is no MCAP file.
    """
    start = stream.read(len(MAGIC))
    stream.seek(0)
    if start != MAGIC and not MAGIC.startswith(start):
        raise UsageError(f"{path}: not a record of a run: it is not an MCAP file")
    return start == MAGIC


def raw_records(stream: BinaryIO, at: int = len(MAGIC)) -> Iterator[RawRecord]:
    """Yield the top-level records of a file from an offset, without end.

    Raises:
        CutError: the file ends within a record, or without one.
        DamagedError: no record has this opcode, or it is too large.
    """
    size = size_of(stream)
    while True:
        raw = raw_record_at(stream, at, size)
        at = raw.end
        yield raw


def records_of(raw: RawRecord) -> list[McapRecord]:
    """Decode a top-level record: of a chunk its schemas, channels and messages, else the record itself.

    Raises DamagedError: it contradicts its checksum or its format.
    """
    record = decode(raw)
    if not isinstance(record, Chunk):
        return [record]
    try:
        return list(breakup_chunk(record))  # its checksum was compared when it was decoded
    except _UNREADABLE as error:
        raise DamagedError(raw.at, "a chunk does not consist of complete messages") from error


def next_chunk(stream: BinaryIO, start: int) -> int | None:
    """Return the offset of the next undamaged chunk at or after an offset, or None."""
    size = size_of(stream)
    at = start
    while at < size:
        stream.seek(at)
        window = stream.read(_PIECE + 64)
        for found in _CHUNK_START.finditer(window):
            begin = at + found.start()
            if (
                found.start() < _PIECE
                and begin + HEAD.size + int.from_bytes(found[1], "little") <= size
            ):
                try:
                    chunk = decode(raw_record_at(stream, begin, size))
                except (CutError, DamagedError):
                    continue
                if isinstance(chunk, Chunk) and chunk.uncompressed_crc != 0:
                    return begin
        at += _PIECE
    return None


def raw_record_at(stream: BinaryIO, at: int, size: int | None = None) -> RawRecord:
    """Read the top-level record at an offset; `size` is the file's size, if it is known.

    Raises:
        CutError: the file ends within the record, or without one.
        DamagedError: no record has this opcode, or it is too large.
    """
    size = size_of(stream) if size is None else size
    if not 0 <= at <= size:
        raise CutError(at)
    stream.seek(at)
    head = stream.read(HEAD.size)
    if len(head) < HEAD.size:
        raise CutError(at)
    opcode, length = HEAD.unpack(head)
    if opcode not in _KINDS:
        raise DamagedError(at, f"no record has the opcode {opcode}")
    if at + HEAD.size + length > size:
        raise CutError(at)
    if length > MOST_BYTES:
        raise DamagedError(at, f"a record of {length} bytes: at most {MOST_BYTES} are read")
    content = stream.read(length)
    if len(content) < length:
        raise CutError(at)
    return RawRecord(opcode, at, content, at + HEAD.size + length)


class _Exact(ReadDataStream):  # type: ignore[misc]
    """Refuses to read less than asked for; the library returns a part without an error."""

    def read(self, length: int) -> bytes:
        data: bytes = super().read(length)
        if len(data) < length:
            raise EndOfFile
        return data


def decode(raw: RawRecord) -> McapRecord:
    """Decode a record that uses its whole raw, and compare its own checksum.

    Raises DamagedError: it contradicts its checksum or its format.
    """
    stream = _Exact(io.BytesIO(raw.content))
    length = len(raw.content)
    kind = _KINDS[raw.opcode]
    try:
        record: McapRecord = kind.read(stream, length) if kind is Message else kind.read(stream)
        if isinstance(record, Chunk):
            _check_chunk(record, raw.at)
        exact = stream.count == length
    except CRCValidationError as error:
        raise DamagedError(raw.at, "a chunk does not match its checksum") from error
    except _UNREADABLE as error:
        raise DamagedError(raw.at, f"{_name_of(raw)} cannot be decoded") from error
    if not exact:
        raise DamagedError(raw.at, f"{_name_of(raw)} has a wrong length")
    if isinstance(record, Attachment):
        crc = int.from_bytes(raw.content[-4:], "little")
        if crc and crc != zlib.crc32(raw.content[:-4]):
            raise DamagedError(raw.at, "an attachment does not match its checksum")
    return record


def _check_chunk(chunk: Chunk, at: int) -> None:
    """Raises DamagedError: its size or compression is refused; CRCValidationError: its checksum is wrong."""
    size = chunk.uncompressed_size
    packed = len(chunk.data)
    if chunk.message_start_time > chunk.message_end_time:
        raise DamagedError(at, "a chunk ends before it begins")
    if chunk.compression == "zstd":
        claimed = zstandard.frame_content_size(chunk.data)
        if size > min(MOST_BYTES, FREE_GROWTH + MOST_GROWTH * packed) or claimed not in (-1, size):
            raise DamagedError(at, f"a chunk of {packed} bytes would grow to {max(size, claimed)}")
    elif chunk.compression:
        raise DamagedError(
            at,
            f"the compression {chunk.compression[:20]!r} of a chunk is not supported: only zstd is",
        )
    _stream, found = get_chunk_data_stream(chunk, validate_crc=True)
    if found != size:
        raise DamagedError(at, f"a chunk holds {found} bytes instead of {size}")


def _name_of(raw: RawRecord) -> str:
    name = Opcode(raw.opcode).name.lower().replace("_", " ")
    return f"{'an' if name[0] in 'aeiou' else 'a'} {name}"


def size_of(stream: BinaryIO) -> int:
    """Return the file's size [bytes]; the stream is at its end afterwards."""
    return stream.seek(0, os.SEEK_END)


def crc_of(stream: BinaryIO, begin: int, end: int) -> int:
    """Return the checksum of a part of the file."""
    stream.seek(begin)
    crc = 0
    left = end - begin
    while left > 0 and (piece := stream.read(min(left, _PIECE))):
        crc = zlib.crc32(piece, crc)
        left = left - len(piece)
    return crc


def only_zeros_follow(stream: BinaryIO, at: int) -> bool:
    """Return True if the file holds only zeros from an offset on, as after a power failure."""
    stream.seek(at)
    while piece := stream.read(_PIECE):
        if piece.count(0) != len(piece):
            return False
    return True
