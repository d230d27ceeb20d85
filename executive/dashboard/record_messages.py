"""A record as messages of the live stream, fast: what a record holds is nearly a message already.

Events are spliced out of the MCAP file without being decoded; only those with an image or with very large arrays are.
"""

from __future__ import annotations

import base64
import json
import mmap
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from executive.dashboard.messages import VERSION, encode, encode_number
from executive.errors import UsageError
from executive.recording.decode import event_from
from executive.recording.read import read_events
from executive.recording.recorder import EVENTS_FILE

MAGIC = b"\x89MCAP0\r\n"
CHANNEL, MESSAGE, CHUNK = 0x04, 0x05, 0x06
MESSAGE_HEAD = 22
"""Bytes before a message's content: channel, sequence, two times."""

LARGE = 200_000
"""Bytes above which an event is decoded, so that arrays that no browser draws in time are left out."""

PIECE = 262_144
"""Bytes that are sent at once."""


class _ChunkedError(Exception):
    """A record that another program has written with chunks."""


def record_messages(folder: Path) -> Iterator[bytes]:
    """Pieces of NDJSON: the record's messages in order, each with its line's end. A record that was cut off ends there.

    Raises:
        UsageError: the file is not a record.
    """
    piece = bytearray()
    for line in _lines(folder):
        piece += line
        piece += b"\n"
        if len(piece) > PIECE:
            yield bytes(piece)
            piece.clear()
    yield bytes(piece)


def first_event(folder: Path) -> dict[str, Any]:
    """The record's first event as it was written: a RunStarted, unless the record was cut off before."""
    try:
        for topic, content in _messages(folder / EVENTS_FILE):
            if topic == "/events":
                event: dict[str, Any] = json.loads(content)
                return event
    except (UsageError, _ChunkedError, ValueError):
        pass
    return {}


def _lines(folder: Path) -> Iterator[bytes]:
    image: bytes | None = None
    seq = 0
    try:
        for topic, content in _messages(folder / EVENTS_FILE):
            if topic.startswith("/images/"):
                image = content
                continue
            seq += 1
            if image is not None:
                yield _with_image(content, image, seq)
                image = None
            elif len(content) > LARGE:
                yield encode(event_from(json.loads(content)), seq).encode()
            else:
                yield b"%b%b" % (encode_number(seq), content[1:])
    except _ChunkedError:
        for number, event in enumerate(read_events(folder), start=1):
            yield encode(event, number).encode()


def _with_image(content: bytes, image: bytes, seq: int) -> bytes:
    event = json.loads(content)
    coded = json.loads(image)["data"]
    pixels = cv2.imdecode(np.frombuffer(base64.b64decode(coded), np.uint8), cv2.IMREAD_REDUCED_GRAYSCALE_2)
    size = [0, 0] if pixels is None else [pixels.shape[1] * 2, pixels.shape[0] * 2]
    event["value"] |= {"image": f"data:image/jpeg;base64,{coded}", "size": size}
    return json.dumps({"v": VERSION, "seq": seq, **event}, ensure_ascii=False, separators=(",", ":")).encode()


def _messages(path: Path) -> Iterator[tuple[str, bytes]]:
    """(topic, content) of every whole message of an MCAP file without chunks."""
    with path.open("rb") as stream:
        if stream.read(len(MAGIC)) != MAGIC:
            raise UsageError(f"{path}: not a record of a run")
        with mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as buffer:
            yield from _walk(buffer)


def _walk(buffer: mmap.mmap) -> Iterator[tuple[str, bytes]]:
    topics: dict[int, str] = {}
    at, end = len(MAGIC), len(buffer)
    head = struct.Struct("<BQ")
    while at + head.size <= end:
        opcode, length = head.unpack_from(buffer, at)
        at += head.size
        if at + length > end:
            return
        if opcode == MESSAGE:
            (channel,) = struct.unpack_from("<H", buffer, at)
            yield topics.get(channel, ""), buffer[at + MESSAGE_HEAD : at + length]
        elif opcode == CHANNEL:
            channel, _schema, size = struct.unpack_from("<HHI", buffer, at)
            topics[channel] = buffer[at + 8 : at + 8 + size].decode()
        elif opcode == CHUNK:
            raise _ChunkedError
        at += length
