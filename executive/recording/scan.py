"""Through an MCAP file's messages without decoding them: what an index needs of thousands of records."""

from __future__ import annotations

import mmap
import struct
from collections.abc import Iterator
from pathlib import Path

from executive.errors import UsageError
from executive.recording.read import MAGIC, has_begun, messages

CHANNEL, MESSAGE, CHUNK = 0x04, 0x05, 0x06
MESSAGE_HEAD = 22
"""Bytes before a message's content: channel, sequence, two times."""

_HEAD = struct.Struct("<BQ")
_NUMBERS = struct.Struct("<HHI")


def scan(path: Path) -> Iterator[tuple[str, bytes]]:
    """(topic, content) of every whole message. A record that was cut off gives the messages up to there.

    Raises:
        UsageError: it is no MCAP file, or cannot be read.
    """
    try:
        with path.open("rb") as stream:
            if not has_begun(path, stream):
                return
            with mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as buffer:
                yield from _walk(path, buffer)
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror}") from error


def _walk(path: Path, buffer: mmap.mmap) -> Iterator[tuple[str, bytes]]:
    topics: dict[int, str] = {}
    at, end = len(MAGIC), len(buffer)
    while at + _HEAD.size <= end:
        opcode, length = _HEAD.unpack_from(buffer, at)
        at += _HEAD.size
        if at + length > end:
            return
        if opcode == MESSAGE:
            channel = int.from_bytes(buffer[at : at + 2], "little")
            yield topics.get(channel, ""), buffer[at + MESSAGE_HEAD : at + length]
        elif opcode == CHANNEL:
            channel, _schema, size = _NUMBERS.unpack_from(buffer, at)
            topics[channel] = buffer[at + 8 : at + 8 + size].decode(errors="replace")
        elif opcode == CHUNK:  # another program's file, or one that was exported: read it the long way
            yield from messages(path)
            return
        at += length
