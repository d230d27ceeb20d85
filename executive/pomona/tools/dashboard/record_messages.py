"""A record as messages of the live stream.

An event of a record is a message of the stream without its number. Images stay in the record under an address of their
own until a browser shows them. Of a long record `overview` yields as much as a screen can show of the whole, and
`between` everything of a part of the time.
"""

from __future__ import annotations

import base64
import json
import math
from collections import Counter, deque
from collections.abc import Container, Iterable, Iterator, Sequence
from functools import lru_cache
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

from pomona.executive.errors import UsageError
from pomona.executive.images import from_file, shrunk, to_jpeg
from pomona.executive.recording.folder import EVENTS, EVENTS_FILE
from pomona.executive.recording.overview import (
    MOST_BYTES,
    OVERVIEW,
    WHOLE,
    WHOLE_BYTES,
    Overview,
    Standing,
    standing,
)
from pomona.executive.recording.plain_file import parse_object
from pomona.executive.recording.read import ForeignRecordError, event_from
from pomona.executive.recording.scan import Found, Verdict, attachment, require_valid, scan
from pomona.executive.recording.well_known import DEPTH, IMAGES
from pomona.executive.values.image_bytes import size_of_image
from pomona.tools.dashboard.cloud import cloud_of_messages
from pomona.tools.dashboard.messages import VERSION, encode, numbered

LARGE = 200_000
"""Size above which an event is decoded, to leave out arrays that no browser draws in time [bytes]."""

PIECE = 262_144
"""Size of one piece of the answer [bytes]."""

THUMBNAIL = 128
"""Width of a record's picture in the list [px]."""

MOST_FOR_THUMBNAIL = 64_000_000
"""Largest record of which a thumbnail is made [bytes]: the whole file is checked first."""

ADDRESSES = ("image", "size", "cloud")
"""Fields of a view that only this server writes: a record names no address that a page would open with its token."""

_LONGEST = 1e10
"""Latest stamp [s]."""


class Line(NamedTuple):
    """One event of a record: its number, its message, its text, and the address of its image or an empty text."""

    seq: int
    message: dict[str, Any]
    content: bytes
    image: str


class _Valid(NamedTuple):
    """Verdict on a valid record, and whether its messages carry the numbers of their events."""

    verdict: Verdict
    numbered: bool


def record_messages(folder: Path, images: str = "") -> Iterator[bytes]:
    """Yield the record's messages in order as pieces of NDJSON. A record that was cut off ends there.

    Args:
        folder: folder of the record.
        images: address below which `image` answers; without one, images travel within their messages.

    Raises UsageError: the file is not a record.
    """
    return between(folder, images, 0.0, math.inf)


def overview(folder: Path, images: str) -> Iterator[bytes]:
    """Yield a long record as far as a screen can show it, else the whole record.

    A long record keeps every message that changes something. Of repeated messages (feedback, samples, poses, pictures)
    it keeps the last of each key in each part of the time. Then the first line is
    `{"event": "Overview", "interval": seconds}`.
    """
    if (folder / EVENTS_FILE).stat().st_size <= WHOLE_BYTES:
        return record_messages(folder, images)
    return _pieces(_overview(folder / EVENTS_FILE, images))


def between(folder: Path, images: str, begin: float, end: float) -> Iterator[bytes]:
    """Yield every message of a part of the time: begin ≤ t ≤ end [s]."""
    path = folder / EVENTS_FILE
    return _pieces(_message(path, line, images) for line in _lines(path, begin, end))


def moment(folder: Path, images: str, begin: float, end: float) -> Iterator[bytes]:
    """Yield the messages that an overview omits: the state at the beginning of a part of the time, and the messages in
    it.

    It begins up to one interval of the overview earlier, since the overview knows the last message of each interval.
    """
    path = folder / EVENTS_FILE
    shown = _shown(path)
    if shown.interval and 0.0 < begin < _LONGEST:
        begin = math.floor(begin / shown.interval) * shown.interval
        last = {entry.key: entry for entry in shown.places if entry.t < begin}
        yield from _pieces(_message(path, line, images) for line in _chosen(path, last.values()))
    yield from between(folder, images, begin, end)


def image(folder: Path, at: str) -> bytes | None:
    """Return the JPEG image at an address in the record, or None if there is none."""
    try:
        found = parse_object(_look(folder / EVENTS_FILE, at)[0].content)
        return base64.b64decode(found["data"]) if found["format"] == "jpeg" else None
    except (UsageError, ValueError, KeyError, TypeError, IndexError):
        return None


def thumbnail(folder: Path) -> bytes | None:
    """Return the newest image of a record as a small JPEG, or None: there is none, or the record is large."""
    path = folder / EVENTS_FILE
    try:
        about = path.stat()
        small = about.st_size <= MOST_FOR_THUMBNAIL
        return (
            _thumbnail_of(path, about.st_ino, about.st_size, about.st_mtime_ns) if small else None
        )
    except (OSError, UsageError, ValueError, KeyError, TypeError):
        return None


@lru_cache(maxsize=512)
def _thumbnail_of(path: Path, _inode: int, _size: int, _changed: int) -> bytes | None:
    newest = deque(
        scan(path, _valid(path).verdict, topics=lambda topic: topic.startswith(IMAGES)), maxlen=1
    )
    if not newest:
        return None
    pixels = from_file(base64.b64decode(parse_object(newest[0].content)["data"]))
    return to_jpeg(shrunk(pixels, min(1.0, THUMBNAIL / pixels.shape[1])), 75)


def cloud(folder: Path, at: str) -> dict[str, str]:
    """Return the depth points that belong to the image at an address in the record; empty where there are none."""
    try:
        picture, *rest = _look(folder / EVENTS_FILE, at)
        topic = picture.topic.removeprefix(IMAGES)
        depth = b""
        for found in rest:
            if found.topic == f"{DEPTH}{topic}":
                depth = found.content
            elif (
                depth
                and found.topic == EVENTS
                and (event := parse_object(found.content)).get("topic") == topic
            ):
                return cloud_of_messages(picture.content, depth, event["value"].get("pinhole"))
    except (
        UsageError,
        ForeignRecordError,
        ValueError,
        KeyError,
        TypeError,
        IndexError,
        AttributeError,
    ):
        pass
    return {}


def _look(path: Path, at: str) -> list[Found]:
    """Return the message of an image, and the later messages of the same time.

    Raises UsageError: the record is not valid. ValueError, IndexError: there is no image at this address.
    """
    stamp, _, number = at.partition("-")
    if len(at) > 40 or not 0 <= int(stamp) < _LONGEST * 1e9 or int(number) < 0:
        raise ValueError(f"{at[:40]} is no address of an image")
    found = list(scan(path, _valid(path).verdict, begin=int(stamp), end=int(stamp)))
    pictures = (k for k, message in enumerate(found) if message.topic.startswith(IMAGES))
    return found[next(islice(pictures, int(number), None), len(found)) :]


def _valid(path: Path) -> _Valid:
    """Return the verdict on a valid file; a file that has not changed is checked once.

    Raises UsageError: it is damaged, or no record.
    """
    try:
        about = path.stat()
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror}") from error
    return _checked(path, about.st_ino, about.st_size, about.st_mtime_ns)


@lru_cache(maxsize=16)
def _checked(path: Path, _inode: int, _size: int, _changed: int) -> _Valid:
    verdict = require_valid(path)
    first = next(scan(path, verdict, topics=EVENTS.__eq__), None)
    return _Valid(verdict, first is not None and first.sequence > 0)


def _pieces(lines: Iterable[bytes]) -> Iterator[bytes]:
    piece = bytearray()
    for line in lines:
        piece += line
        piece += b"\n"
        if len(piece) > PIECE:
            yield bytes(piece)
            piece.clear()
    yield bytes(piece)


def _message(path: Path, line: Line, images: str) -> bytes:
    line = line._replace(message=_without_addresses(line.message))
    if line.message.get("event") == "RunStarted":
        event_from(line.message)  # its nodes are a tree, through which the page walks
    if line.image:
        return _with_image(path, line, images)
    if len(line.content) > LARGE:
        return encode(event_from(line.message), line.seq).encode()
    return numbered(line.message, line.seq)


def _without_addresses(message: dict[str, Any]) -> dict[str, Any]:
    value = message.get("value")
    if (
        message.get("event") != "Published"
        or not isinstance(value, dict)
        or not isinstance(value.get("type"), str)
    ):
        return message
    if all(value.get(name) is None for name in ADDRESSES):
        return message
    return message | {
        "value": {name: item for name, item in value.items() if name not in ADDRESSES}
    }


def _with_image(path: Path, line: Line, images: str) -> bytes:
    coded = image(path.parent, line.image) or b""
    address = (
        f"{images}{line.image}"
        if images
        else f"data:image/jpeg;base64,{base64.b64encode(coded).decode()}"
    )
    value = line.message.get("value")
    if not isinstance(value, dict):
        raise ForeignRecordError("an event with an image has no view")
    value = value | {"image": address, "size": size_of_image(coded)}
    if images and isinstance(value.get("pinhole"), dict):
        value["cloud"] = f"{address}/cloud"
    return numbered(line.message | {"value": value}, line.seq)


class _Shown(NamedTuple):
    """Interval of a thinned overview or 0, its lines, and the places that it keeps."""

    interval: float
    lines: tuple[Line, ...]
    places: tuple[Standing, ...]


def _overview(path: Path, images: str) -> Iterator[bytes]:
    shown = _shown(path)
    if not shown.interval:
        yield from (_message(path, line, images) for line in _lines(path))
        return
    yield json.dumps(
        {"v": VERSION, "event": "Overview", "interval": shown.interval}, separators=(",", ":")
    ).encode()
    yield from (_message(path, line, images) for line in shown.lines)


def _shown(path: Path) -> _Shown:
    """Return the overview of a record; the interval of a short one is 0."""
    about = path.stat()
    return _overview_of(path, about.st_ino, about.st_size, about.st_mtime_ns)


@lru_cache(maxsize=2)
def _overview_of(path: Path, _inode: int, size: int, _changed: int) -> _Shown:
    interval, lines = (_prepared(path) or _made(path)) if size > WHOLE_BYTES else (0.0, ())
    places = {line.seq: standing(line.seq, line.message) for line in lines}
    shown = tuple(line for line in lines if places[line.seq] is None)
    return _Shown(interval, shown, tuple(place for place in places.values() if place is not None))


def _chosen(path: Path, entries: Iterable[Standing]) -> Iterator[Line]:
    """Yield the events at these places, in order."""
    wanted = {entry.seq: entry.t for entry in entries}
    if not _valid(path).numbered or _valid(path).verdict.chunks is None:
        yield from _lines(path, wanted=wanted)
        return
    for seq, t in sorted(wanted.items()):
        yield from _lines(path, t, t, {seq})


def _prepared(path: Path) -> tuple[float, Sequence[Line]] | None:
    """Return the overview that the recorder made; None without one, or if it is malformed."""
    written = attachment(path, OVERVIEW, _valid(path).verdict)
    if written is None or len(written) > 2 * MOST_BYTES:  # a recorder makes none that is larger
        return None
    try:
        head, *rest = written.splitlines()
        interval = float(parse_object(head)["interval"])
        lines = [
            _kept(int(seq), text) for seq, _, text in (line[1:-1].partition(b",") for line in rest)
        ]
    except (ValueError, KeyError, TypeError, IndexError):
        return None
    return (interval, lines) if 0.0 < interval < _LONGEST else None


def _made(path: Path) -> tuple[float, Sequence[Line]]:
    """Make the overview of a record without one: of an earlier version, cut off, or repaired."""
    made = Overview()
    for line in _lines(path):
        made.add(line.seq, _time_of(line.message), line.message, line.content)
    if made.count <= WHOLE:
        return 0.0, ()
    return made.interval if made.entries else 0.0, [
        _kept(entry.seq, entry.text) for entry in made.entries
    ]


def _kept(seq: int, text: bytes) -> Line:
    return Line(seq, parse_object(text), text, "")


def _time_of(message: dict[str, Any]) -> float:
    t = message.get("t")
    return float(t) if isinstance(t, (int, float)) else 0.0


def _lines(
    path: Path, begin: float = 0.0, end: float = math.inf, wanted: Container[int] | None = None
) -> Iterator[Line]:
    """Yield the events of a part of the time [s], all or those with a wanted number.

    An image belongs to the next event of its topic.
    """
    first, last = (round(min(max(t, 0.0), _LONGEST) * 1e9) for t in (begin, end))
    verdict, has_numbers = _valid(path)
    found_in = scan(path, verdict, topics=_is_shown, begin=first if has_numbers else 0, end=last)
    pictures: dict[str, str] = {}
    at_stamp: Counter[int] = Counter()
    seq = 0
    for found in found_in:
        if found.topic != EVENTS:
            pictures[found.topic] = f"{found.stamp}-{at_stamp[found.stamp]}"
            at_stamp[found.stamp] += 1
            continue
        seq = found.sequence or seq + 1
        if found.stamp >= first and (pictures or wanted is None or seq in wanted):
            message = parse_object(found.content)
            address = pictures.pop(f"{IMAGES}{message.get('topic')}", "") if pictures else ""
            if wanted is None or seq in wanted:
                yield Line(seq, message, found.content, address)


def _is_shown(topic: str) -> bool:
    return topic == EVENTS or topic.startswith(IMAGES)
