"""A record as messages of the live stream, fast: what a record holds is nearly a message already.

Events are spliced out of the MCAP file without being decoded; only those with an image or with very large arrays are.
Images stay behind, under an address of their own, until a browser shows them. Of a long record `overview` gives what a
screen can show of the whole, and `between` everything of a stretch of it.
"""

from __future__ import annotations

import base64
import json
import mmap
import re
import struct
from collections.abc import Callable, Hashable, Iterable, Iterator
from pathlib import Path
from typing import Any

from executive.dashboard.jpeg import size_of_jpeg
from executive.dashboard.messages import VERSION, encode, encode_number
from executive.errors import UsageError
from executive.recording.decode import event_from
from executive.recording.read import read_events
from executive.recording.recorder import EVENTS_FILE

MAGIC = b"\x89MCAP0\r\n"
CHANNEL, MESSAGE, CHUNK = 0x04, 0x05, 0x06
EVENTS, IMAGES = b"/events", b"/images/"
HEAD = struct.Struct("<BQ")
MESSAGE_HEAD = 22
"""Bytes before a message's content: channel, sequence, two times."""

LARGE = 200_000
"""Bytes above which an event is decoded, so that arrays that no browser draws in time are left out."""

PIECE = 262_144
"""Bytes that are sent at once."""

WHOLE = 20_000
"""Records with no more messages, and of no more than `WHOLE_BYTES`, are their own overview."""

WHOLE_BYTES = 10_000_000
MOMENTS = 2_000
"""Parts into which an overview divides a record; of each the last word of every key stays."""

FREQUENT = re.compile(
    rb'\{"event":"(NodeChanged|Published|PortWritten|Computed)",[^{]*?"(?:path|topic|key|node)":"((?:[^"\\]|\\.)*)"'
)
STATUS = re.compile(rb'"status":"(\w+)"')
STARTS = re.compile(rb'"starts":(\d+)')
TOPIC = re.compile(rb'"topic":"((?:[^"\\]|\\.)*)","value":\{"type":"(\w+)"')
STREAMED = (b"SeriesView", b"PosesView")
"""Views of which there are many, each one moment's."""


class _ChunkedError(Exception):
    """A record that another program has written with chunks."""


Line = tuple[int, float, bytes, int]
"""One event of a record: its number, its time [s], its text, and where its image stands in the file, or -1.

A plain tuple, since a record has 100 000 of them: Python's garbage collector does not follow plain tuples of numbers.
"""


def record_messages(folder: Path, images: str = "") -> Iterator[bytes]:
    """Pieces of NDJSON: the record's messages in order, each with its line's end. A record that was cut off ends there.

    Args:
        folder: of the record.
        images: the address below which `image` answers; without one images travel within their messages.

    Raises:
        UsageError: the file is not a record.
    """
    return _pieces(_written(folder, images, lambda lines: lines))


def overview(folder: Path, images: str) -> Iterator[bytes]:
    """Like `record_messages`, for the eye: of a long record the messages that change something, and of those that are
    said again and again (feedback, samples, poses) the last of each key in each of `MOMENTS` parts. The first line of a
    thinned overview says so: `{"event": "Overview", "interval": seconds}`."""
    path = folder / EVENTS_FILE
    if path.stat().st_size <= WHOLE_BYTES:
        return record_messages(folder, images)
    return _pieces(_written(folder, images, _thinned))


def between(folder: Path, images: str, begin: float, end: float) -> Iterator[bytes]:
    """Every message of a stretch of a record: begin ≤ t ≤ end [s]."""
    return _pieces(_written(folder, images, lambda lines: (line for line in lines if begin <= line[1] <= end)))


def image(folder: Path, at: int) -> bytes | None:
    """The JPEG image at a place in the record, or None: there is none."""
    try:
        with (folder / EVENTS_FILE).open("rb") as stream:
            stream.seek(at)
            opcode, length = HEAD.unpack(stream.read(HEAD.size))
            if opcode != MESSAGE or length > 50_000_000:
                return None
            found = json.loads(stream.read(length)[MESSAGE_HEAD:])
            return base64.b64decode(found["data"]) if found["format"] == "jpeg" else None
    except (OSError, OverflowError, ValueError, KeyError, TypeError, struct.error):
        return None


def first_event(folder: Path) -> dict[str, Any]:
    """The record's first event as it was written: a RunStarted, unless the record was cut off before."""
    try:
        for _seq, _t, content, _image_at in _lines(folder / EVENTS_FILE):
            event: dict[str, Any] = json.loads(content)
            return event
    except (UsageError, _ChunkedError, ValueError):
        pass
    return {}


def _pieces(lines: Iterable[bytes]) -> Iterator[bytes]:
    piece = bytearray()
    for line in lines:
        piece += line
        piece += b"\n"
        if len(piece) > PIECE:
            yield bytes(piece)
            piece.clear()
    yield bytes(piece)


Choose = Callable[[Iterable[Line]], Iterable[Line | bytes]]


def _written(folder: Path, images: str, choose: Choose) -> Iterator[bytes]:
    path = folder / EVENTS_FILE
    try:
        for line in choose(_lines(path)):
            if isinstance(line, bytes):
                yield line
                continue
            seq, _t, content, image_at = line
            if image_at >= 0:
                yield _with_image(path, line, images)
            elif len(content) > LARGE:
                yield encode(event_from(json.loads(content)), seq).encode()
            else:
                yield b"%b%b" % (encode_number(seq), content[1:])
    except _ChunkedError:
        for number, event in enumerate(read_events(folder), start=1):
            yield encode(event, number).encode()


def _thinned(lines: Iterable[Line]) -> Iterable[Line | bytes]:
    """What changes something, and the last word of every key in every part of the record's time."""
    everything = list(lines)
    if len(everything) <= WHOLE:
        return everything
    interval = everything[-1][1] / MOMENTS
    kept: dict[Hashable, Line] = {}
    state: dict[bytes, tuple[bytes, bytes]] = {}
    for line in everything:
        kept[_place(line, interval, state)] = line
    chosen = sorted(kept.values())
    note = {"v": VERSION, "event": "Overview", "interval": interval}
    return [json.dumps(note, separators=(",", ":")).encode(), *chosen]


def _place(line: Line, interval: float, state: dict[bytes, tuple[bytes, bytes]]) -> Hashable:
    """Lines that share a place replace each other; one that says something new has a place of its own."""
    seq, t, content, _image_at = line
    found = FREQUENT.match(content)
    if found is None:
        return seq
    kind, key = found.groups()
    if kind == b"NodeChanged":
        status, starts = STATUS.search(content, found.end()), STARTS.search(content, found.end())
        now = (status[1] if status else b"", starts[1] if starts else b"")
        if state.get(key) != now:
            state[key] = now
            return seq
    elif kind == b"Published":
        view = TOPIC.search(content, found.start(2))
        if view is None or view[2] not in STREAMED:
            return seq
        key = view[1] + b"|" + view[2]
    return kind, key, int(t / interval)


def _with_image(path: Path, line: Line, images: str) -> bytes:
    seq, _t, content, image_at = line
    event = json.loads(content)
    coded = image(path.parent, image_at) or b""
    address = f"{images}{image_at}" if images else f"data:image/jpeg;base64,{base64.b64encode(coded).decode()}"
    event["value"] |= {"image": address, "size": size_of_jpeg(coded)}
    return json.dumps({"v": VERSION, "seq": seq, **event}, ensure_ascii=False, separators=(",", ":")).encode()


def _lines(path: Path) -> Iterator[Line]:
    """Every whole event of an MCAP file without chunks; an image belongs to the event after it."""
    with path.open("rb") as stream:
        if stream.read(len(MAGIC)) != MAGIC:
            raise UsageError(f"{path}: not a record of a run")
        with mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as buffer:
            yield from _walk(buffer)


def _walk(buffer: mmap.mmap) -> Iterator[Line]:
    topics: dict[int, bytes] = {}
    pictures: dict[bytes, int] = {}
    at, end, seq = len(MAGIC), len(buffer), 0
    head, inner = HEAD.unpack_from, struct.Struct("<HIQ").unpack_from
    while at + HEAD.size <= end:
        opcode, length = head(buffer, at)
        begin = at + HEAD.size
        if begin + length > end:
            return
        if opcode == MESSAGE:
            channel, _sequence, stamp = inner(buffer, begin)
            topic = topics.get(channel, b"")
            if topic == EVENTS:
                seq += 1
                content = buffer[begin + MESSAGE_HEAD : begin + length]
                image_at = -1
                if pictures and (view := TOPIC.search(content)) is not None:
                    image_at = pictures.pop(IMAGES + view[1], -1)
                yield seq, stamp / 1e9, content, image_at
            elif topic.startswith(IMAGES):
                pictures[topic] = at
        elif opcode == CHANNEL:
            channel, _schema, size = struct.unpack_from("<HHI", buffer, begin)
            topics[channel] = buffer[begin + 8 : begin + 8 + size]
        elif opcode == CHUNK:
            raise _ChunkedError
        at = begin + length
