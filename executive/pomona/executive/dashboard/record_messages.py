"""A record as messages of the live stream, fast: what a record holds is nearly a message already.

Events are spliced out of the MCAP file without being decoded; only those with an image or with very large arrays are.
Images stay behind, under an address of their own, until a browser shows them. Of a long record `overview` gives what a
screen can show of the whole, and `between` everything of a stretch of it.
"""

from __future__ import annotations

import base64
import json
import math
import struct
from collections.abc import Iterable, Iterator
from functools import lru_cache
from pathlib import Path

import orjson

from pomona.executive.dashboard.cloud import cloud_in_record
from pomona.executive.dashboard.messages import VERSION, encode, encode_number
from pomona.executive.errors import PomonaError, UsageError
from pomona.executive.recording.container import HEAD, MESSAGE, MESSAGE_HEAD
from pomona.executive.recording.decode import ForeignRecordError, event_from
from pomona.executive.recording.folder import EVENTS, EVENTS_FILE
from pomona.executive.recording.image_size import size_of_jpeg
from pomona.executive.recording.json_text import is_deep, parse_object
from pomona.executive.recording.overview import (
    FREQUENT,
    MOST_BYTES,
    OVERVIEW,
    TOPIC,
    WHOLE,
    WHOLE_BYTES,
    Overview,
    Standing,
    standing,
)
from pomona.executive.recording.plain_file import open_plain
from pomona.executive.recording.read import read_events
from pomona.executive.recording.scan import Found, Verdict, attachment, believed, read_chunks, walk_topics
from pomona.executive.recording.well_known import IMAGES

MOST_IMAGE = 50_000_000
"""Bytes of an image that is handed out."""

LARGE = 200_000
"""Bytes above which an event is decoded, so that arrays that no browser draws in time are left out."""

PIECE = 262_144
"""Bytes that are sent at once."""

_LONGEST = 1e10
"""Seconds; no stamp is later."""

_NEAR = 1e-6
"""Seconds between an event's time as it is written and as its message's stamp says it."""


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
    return _pieces(_written(folder, images))


def overview(folder: Path, images: str) -> Iterator[bytes]:
    """Like `record_messages`, for the eye: of a long record the messages that change something, and of those that are
    said again and again (feedback, samples, poses, pictures) the last of each key in each part of the time. The first
    line of a thinned overview says so: `{"event": "Overview", "interval": seconds}`."""
    if (folder / EVENTS_FILE).stat().st_size <= WHOLE_BYTES:
        return record_messages(folder, images)
    return _pieces(_overview(folder, images))


def between(folder: Path, images: str, begin: float, end: float) -> Iterator[bytes]:
    """Every message of a stretch of a record: begin ≤ t ≤ end [s]."""
    return _pieces(_written(folder, images, begin, end))


def moment(folder: Path, images: str, begin: float, end: float) -> Iterator[bytes]:
    """What an overview leaves out of a stretch of a record: how things stood when it began, then every message of it.

    It begins up to one of the overview's parts of the time earlier, since of each part the overview knows the last."""
    path = folder / EVENTS_FILE
    interval, known = _standing(path)
    if interval and 0.0 < begin < _LONGEST:
        begin = math.floor(begin / interval) * interval
        last = {entry.key: entry for entry in known if entry.t < begin}
        yield from _pieces(_message(path, line, images) for line in _chosen(path, last.values()))
    yield from between(folder, images, begin, end)


def image(folder: Path, at: int) -> bytes | None:
    """The JPEG image at a place in the record, or None: there is none."""
    path = folder / EVENTS_FILE
    try:
        with open_plain(path) as stream:
            try:
                _verdict(path)
            except UsageError:
                return None
            stream.seek(at)
            opcode, length = HEAD.unpack(stream.read(HEAD.size))
            if opcode != MESSAGE or length > MOST_IMAGE:
                return None
            found = parse_object(stream.read(length)[MESSAGE_HEAD.size :])
            return base64.b64decode(found["data"]) if found["format"] == "jpeg" else None
    except (OSError, OverflowError, ValueError, KeyError, TypeError, struct.error):
        return None


def cloud(folder: Path, at: int) -> dict[str, str]:
    """The depth points of the look whose image stands at a place in the record; empty where there are none."""
    path = folder / EVENTS_FILE
    try:
        return cloud_in_record(path, at, _verdict(path)) if image(folder, at) is not None else {}
    except (PomonaError, ValueError, KeyError, TypeError, AttributeError):
        return {}


def _verdict(path: Path) -> Verdict:
    """The verdict on a file that is believed; asked once of a file that nobody has changed.

    Raises:
        UsageError: it is damaged, or no record.
    """
    try:
        about = path.stat()
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror}") from error
    return _believed(path, about.st_ino, about.st_size, about.st_mtime_ns)


@lru_cache(maxsize=64)
def _believed(path: Path, _inode: int, _size: int, _changed: int) -> Verdict:
    return believed(path)


def _pieces(lines: Iterable[bytes]) -> Iterator[bytes]:
    piece = bytearray()
    for line in lines:
        piece += line
        piece += b"\n"
        if len(piece) > PIECE:
            yield bytes(piece)
            piece.clear()
    yield bytes(piece)


def _written(folder: Path, images: str, begin: float = 0.0, end: float = math.inf) -> Iterator[bytes]:
    path = folder / EVENTS_FILE
    try:
        for line in _lines(path, begin, end):
            yield _message(path, line, images)
    except _PackedError:
        for number, event in enumerate(read_events(folder), start=1):
            if begin <= event.t <= end:
                yield encode(event, number).encode(errors="replace")


def _message(path: Path, line: Line, images: str) -> bytes:
    seq, _t, content, image_at = line
    if image_at >= 0:
        return _with_image(path, line, images)
    if len(content) <= LARGE and _is_message(content):
        return b"%b%b" % (encode_number(seq), content[1:])
    return encode(event_from(parse_object(content)), seq).encode(errors="replace")


def _is_message(content: bytes) -> bool:
    """Whether an event can go out as it stands: one of the frequent kinds, in one line of JSON that a browser reads."""
    if FREQUENT.match(content) is None or b'"reason":{' in content or b"\n" in content or is_deep(content):
        return False
    try:
        orjson.loads(content)  # it takes neither NaN nor what else a browser does not
    except ValueError:
        return False
    return True


def _overview(folder: Path, images: str) -> Iterator[bytes]:
    path = folder / EVENTS_FILE
    try:
        interval, lines = _prepared(path) or _made(path)
    except _PackedError:
        yield from _written(folder, images)
        return
    if interval:
        note = {"v": VERSION, "event": "Overview", "interval": interval}
        yield json.dumps(note, separators=(",", ":")).encode()
    for line in lines:
        if not interval or standing(line[0], line[2]) is None:
            yield _message(path, line, images)


def _standing(path: Path) -> tuple[float, tuple[Standing, ...]]:
    """The interval of a thinned overview, or 0, and where what stands in it stands."""
    about = path.stat()
    return _standing_of(path, about.st_ino, about.st_size, about.st_mtime_ns)


@lru_cache(maxsize=8)
def _standing_of(path: Path, _inode: int, _size: int, _changed: int) -> tuple[float, tuple[Standing, ...]]:
    if _size <= WHOLE_BYTES:
        return 0.0, ()
    try:
        interval, lines = _prepared(path) or _made(path)
    except _PackedError:
        return 0.0, ()
    found = (standing(seq, content) for seq, _t, content, _image in lines) if interval else ()
    return interval, tuple(entry for entry in found if entry is not None)


def _chosen(path: Path, entries: Iterable[Standing]) -> Iterator[Line]:
    """The events that stand there, in order."""
    wanted = {entry.seq: entry.t for entry in entries}
    if _verdict(path).table is None:
        yield from (line for line in _lines(path) if line[0] in wanted)
        return
    for seq, t in sorted(wanted.items()):
        yield from (line for line in _lines(path, t - _NEAR, t + _NEAR) if line[0] == seq)


def _prepared(path: Path) -> tuple[float, list[Line]] | None:
    """The overview that was made while the run was recorded; None where there is none, or it is not as expected."""
    written = attachment(path, OVERVIEW, _verdict(path))
    if written is None or len(written) > 2 * MOST_BYTES:  # a recorder makes none that is larger
        return None
    try:
        head, *rest = written.splitlines()
        interval = float(orjson.loads(head)["interval"])
        lines = [(int(seq), 0.0, content, -1) for seq, _, content in (line[1:-1].partition(b",") for line in rest)]
        if not 0.0 < interval < _LONGEST or any(content[:1] != b"{" for _seq, _t, content, _image in lines):
            return None
    except (ValueError, KeyError, TypeError, IndexError):
        return None
    return interval, lines


def _made(path: Path) -> tuple[float, list[Line]]:
    """The overview of a record that has none: one that was cut off, or was written before there were any."""
    made, lines = Overview(), list[Line]()
    for line in _lines(path):
        lines.append(line)
        made.add(*line[:3])
    if made.count <= WHOLE or not made.entries:
        return 0.0, lines
    return made.interval, [(e.seq, 0.0, e.text, -1) for e in made.entries]


def _with_image(path: Path, line: Line, images: str) -> bytes:
    seq, _t, content, image_at = line
    event = parse_object(content)
    coded = image(path.parent, image_at) or b""
    address = f"{images}{image_at}" if images else f"data:image/jpeg;base64,{base64.b64encode(coded).decode()}"
    value = event.get("value")
    if not isinstance(value, dict):
        raise ForeignRecordError("an event with an image has no view")
    event["value"] = value | {"image": address, "size": size_of_jpeg(coded)}
    if images and isinstance(value.get("pinhole"), dict):
        event["value"]["cloud"] = f"{address}/cloud"
    text = json.dumps({"v": VERSION, "seq": seq, **event}, ensure_ascii=False, separators=(",", ":"))
    return text.encode(errors="replace")


def _lines(path: Path, begin: float = 0.0, end: float = math.inf) -> Iterator[Line]:
    """Every event of a stretch of time [s]; an image belongs to the event after it."""
    pictures: dict[str, int] = {}
    first, last = (round(min(max(t, 0.0), _LONGEST) * 1e9) for t in (begin, end))
    for seq, (topic, stamp, content, at) in _numbered(path, first, last):
        if at < 0:
            raise _PackedError
        if topic == EVENTS:
            if not first <= stamp <= last:
                continue
            image_at = -1
            if pictures and (view := TOPIC.search(content)) is not None:
                image_at = pictures.pop(IMAGES + view[1].decode(errors="replace"), -1)
            yield seq, stamp / 1e9, content, image_at
        elif first <= stamp <= last and topic.startswith(IMAGES):
            pictures[topic] = at


def _numbered(path: Path, first: int, last: int) -> Iterator[tuple[int, Found]]:
    """Messages, each with the number of the newest event; of a stretch of time [ns] at least those within."""
    verdict, seq = _verdict(path), 0
    if verdict.table is None or (first <= 0 and last >= _LONGEST * 1e9):
        for found in walk_topics(path, _is_shown, first, last, verdict):
            seq += found.topic == EVENTS
            yield seq, found
        return
    for chunk, messages in read_chunks(path, verdict.table.within(first, last), verdict.table):
        seq = chunk.events_before
        for found in messages:
            seq += found.topic == EVENTS
            yield seq, found


def _is_shown(topic: str) -> bool:
    return topic == EVENTS or topic.startswith(IMAGES)
