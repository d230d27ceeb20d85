"""A record as messages of the live stream, fast: what a record holds is nearly a message already.

Events are spliced out of the MCAP file without being decoded; only those with an image or with very large arrays are.
Images stay behind, under an address of their own, until a browser shows them. Of a long record `overview` gives what a
screen can show of the whole, and `between` everything of a stretch of it.
"""

from __future__ import annotations

import base64
import json
import os
import re
import struct
from collections.abc import Callable, Hashable, Iterable, Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any

import orjson

from executive.dashboard.extremes import Extremes
from executive.dashboard.messages import VERSION, encode, encode_number
from executive.errors import UsageError
from executive.recording.container import HEAD, MESSAGE, MESSAGE_HEAD
from executive.recording.decode import ForeignRecordError, event_from
from executive.recording.folder import EVENTS, EVENTS_FILE
from executive.recording.image_size import size_of_jpeg
from executive.recording.json_text import is_strict, parse_object
from executive.recording.plain_file import open_plain
from executive.recording.read import read_events
from executive.recording.scan import believed, walk

IMAGES = "/images/"
MOST_IMAGE = 50_000_000
"""Bytes of an image that is handed out."""

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


class _PackedError(Exception):
    """A record whose chunks are compressed: nothing can be cut out of it."""


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
    path = folder / EVENTS_FILE
    try:
        with open_plain(path) as stream:
            about = os.fstat(stream.fileno())
            if not _is_believed(path, about.st_ino, about.st_size, about.st_mtime_ns):
                return None
            stream.seek(at)
            opcode, length = HEAD.unpack(stream.read(HEAD.size))
            if opcode != MESSAGE or length > MOST_IMAGE:
                return None
            found = parse_object(stream.read(length)[MESSAGE_HEAD.size :])
            return base64.b64decode(found["data"]) if found["format"] == "jpeg" else None
    except (OSError, OverflowError, ValueError, KeyError, TypeError, struct.error):
        return None


@lru_cache(maxsize=64)
def _is_believed(path: Path, _inode: int, _size: int, _changed: int) -> bool:
    """Whether a file passes its checks; asked once for all images of a file that nobody has changed."""
    try:
        believed(path)
    except UsageError:
        return False
    return True


def first_event(folder: Path) -> dict[str, Any]:
    """The record's first event as it was written: a RunStarted, unless the record was cut off before."""
    try:
        for found in walk(folder / EVENTS_FILE):
            if found.topic == EVENTS:
                return parse_object(found.content)
    except (UsageError, ValueError):
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
            elif len(content) <= LARGE and _is_message(content):
                yield b"%b%b" % (encode_number(seq), content[1:])
            else:
                yield encode(event_from(parse_object(content)), seq).encode(errors="replace")
    except _PackedError:
        for number, event in enumerate(read_events(folder), start=1):
            yield encode(event, number).encode(errors="replace")


def _is_message(content: bytes) -> bool:
    """Whether an event can go out as it stands: one of the frequent kinds, in one line of JSON that a browser reads."""
    if FREQUENT.match(content) is None or b"\n" in content or not is_strict(content):
        return False
    try:
        orjson.loads(content)
    except ValueError:
        return False
    return b'"reason":{' not in content


def _thinned(lines: Iterable[Line]) -> Iterable[Line | bytes]:
    """What changes something, and the last word of every key in every part of the record's time.

    Of the samples of a part the least and the greatest stay, so that no peak is lost.
    """
    everything = list(lines)
    if len(everything) <= WHOLE:
        return everything
    interval = everything[-1][1] / MOMENTS
    kept: dict[Hashable, Line] = {}
    samples: dict[Hashable, Extremes] = {}
    state: dict[bytes, tuple[bytes, bytes]] = {}
    for line in everything:
        place = _place(line, interval, state)
        kept[place] = line
        if isinstance(place, tuple) and place[1].endswith(b"|SeriesView"):
            samples.setdefault(place, Extremes()).add(line[2])
    chosen: list[tuple[int, Line | bytes]] = [
        (line[0], samples[place].message(line) if place in samples else line) for place, line in kept.items()
    ]
    note = {"v": VERSION, "event": "Overview", "interval": interval}
    ordered = sorted(chosen, key=lambda numbered: numbered[0])
    return [json.dumps(note, separators=(",", ":")).encode(), *(line for _number, line in ordered)]


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
    event = parse_object(content)
    coded = image(path.parent, image_at) or b""
    address = f"{images}{image_at}" if images else f"data:image/jpeg;base64,{base64.b64encode(coded).decode()}"
    value = event.get("value")
    if not isinstance(value, dict):
        raise ForeignRecordError("an event with an image has no view")
    event["value"] = value | {"image": address, "size": size_of_jpeg(coded)}
    text = json.dumps({"v": VERSION, "seq": seq, **event}, ensure_ascii=False, separators=(",", ":"))
    return text.encode(errors="replace")


def _lines(path: Path) -> Iterator[Line]:
    """Every event; an image belongs to the event after it."""
    pictures: dict[str, int] = {}
    seq = 0
    for topic, stamp, content, at in walk(path):
        if at < 0:
            raise _PackedError
        if topic == EVENTS:
            seq += 1
            image_at = -1
            if pictures and (view := TOPIC.search(content)) is not None:
                image_at = pictures.pop(IMAGES + view[1].decode(errors="replace"), -1)
            yield seq, stamp / 1e9, content, image_at
        elif topic.startswith(IMAGES):
            pictures[topic] = at
