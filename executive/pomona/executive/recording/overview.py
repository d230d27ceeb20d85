"""A long run as far as a screen can show it: every change, and of repeated messages the last of each part of the time.

It is made while a run is recorded and stands in the record as an attachment, so that half an hour opens without being
read. Of samples it keeps the smallest and the largest. Of views and written values, which are most of a picking robot's
record, it keeps only the place: the page reads them with the moment that it shows.

The first line of an attachment is {"interval": seconds}, every further one [number of an event, the event].
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import orjson

from pomona.executive.encode import encoded
from pomona.executive.recording.message import Key, key_of


class Extremes:
    """Messages of one topic's samples, combined; `message` returns one that represents all of them."""

    def __init__(self) -> None:
        self._count = 0
        self._begin = math.nan
        self._last = b"{}"
        self._found: dict[str, tuple[float, int, float, int]] = {}

    def add(self, message: Mapping[str, Any], content: bytes) -> None:
        """Add the samples of a message with this text. A malformed one adds nothing."""
        self._last = content
        try:
            times = _listed(message["value"]["t"])
            values = message["value"]["values"]
            if not self._count:
                self._begin = float(times[0])
            for name, series in values.items():
                found = _listed(series)
                measured = [
                    sample for sample in found if sample is not None and sample == sample
                ]  # NaN differs
                if measured:
                    low = min(measured)
                    high = max(measured)
                    self._widen(
                        name,
                        low,
                        self._count + found.index(low),
                        high,
                        self._count + found.index(high),
                    )
            self._count += len(times)
        except (ValueError, TypeError, KeyError, IndexError, AttributeError):
            return

    def join(self, later: Extremes) -> None:
        """Add the samples that came after these."""
        if not self._count:
            self._begin = later._begin
        for name, (low, low_at, high, high_at) in later._found.items():
            self._widen(name, low, self._count + low_at, high, self._count + high_at)
        self._count += later._count
        self._last = later._last

    def _widen(self, name: str, low: float, low_at: int, high: float, high_at: int) -> None:
        found = self._found.get(name)
        if found is not None:
            low, low_at = (low, low_at) if low < found[0] else found[:2]
            high, high_at = (high, high_at) if high > found[2] else found[2:]
        self._found[name] = (low, low_at, high, high_at)

    def message(self) -> bytes:
        """Return the last message with two samples for all: of each quantity the smallest and the largest, in order."""
        if self._count <= 2:
            return self._last
        try:
            message = orjson.loads(self._last)
            value = message["value"]
            times = [self._begin, float(value["t"][-1])]
        except (ValueError, TypeError, KeyError, IndexError):
            return self._last
        values = {
            name: [low, high] if low_at <= high_at else [high, low]
            for name, (low, low_at, high, high_at) in self._found.items()
        }
        message["value"] = {**value, "t": times, "values": values, "thinned": self._count}
        return orjson.dumps(message)


def _listed(samples: Any) -> list[Any]:
    """Return samples as a list: an array while a run is recorded, a list when its record is read."""
    listed = samples.tolist() if hasattr(samples, "tolist") else samples
    if not isinstance(listed, list):
        raise TypeError("samples are a list")
    return listed


OVERVIEW = "overview.ndjson"
# a record with at most this number of events, or bytes, is its own overview
WHOLE = 20_000
WHOLE_BYTES = 10_000_000
PARTS = 2_000  # largest number of parts of the time; beyond it, two parts become one
SHORTEST = 0.05  # length of a part at first [s]
_LONGEST = 1e9  # longest run [s]
# largest overview [bytes]. A record with a larger one has none, and is read whole.
MOST_BYTES = 64_000_000

STANDING = frozenset(
    ("PortWritten", "ImageView", "SceneView", "BodiesView", "TableView", "ProgressView")
)
"""Kinds of messages that are valid until the next one of their key; the overview keeps their place."""

REPEATED = STANDING | {"NodeChanged", "Computed", "PosesView", "SeriesView"}
"""Kinds of messages of which the last one of each part of the time is enough."""


@dataclass(slots=True)
class OverviewEntry:
    """One event of an overview: its number, its text, and its samples where it represents several messages."""

    seq: int
    content: bytes
    samples: Extremes | None = None

    @property
    def text(self) -> bytes:
        """The event as the page gets it."""
        return self.content if self.samples is None else self.samples.message()


@dataclass(slots=True)
class Overview:
    """Takes messages in their order and keeps a part of them as `entries`."""

    interval: float = SHORTEST
    count: int = 0
    size: int = 0  # bytes of the kept messages
    _kept: dict[Hashable, OverviewEntry] = field(default_factory=dict)
    _state: dict[str, tuple[Any, Any]] = field(default_factory=dict)

    def add(self, seq: int, t: float, message: Mapping[str, Any], content: bytes) -> None:
        """Take one event: its message, and the same as the text in the record."""
        self.count += 1
        if self.size > MOST_BYTES:
            self._kept.clear()
            return
        while t >= self.interval * PARTS and self.interval < _LONGEST:
            self._coarsen()
        key = self._repeated(message)
        if key is not None and key[0] in STANDING:
            content = encoded(_head(message))
        place: Hashable = seq if key is None else (*key, int(t / self.interval))
        self._keep(place, OverviewEntry(seq, content))
        if key is not None and key[0] == "SeriesView":
            entry = self._kept[place]
            entry.samples = entry.samples or Extremes()
            entry.samples.add(message, content)

    @property
    def entries(self) -> list[OverviewEntry]:
        """The kept messages, in order."""
        return sorted(self._kept.values(), key=lambda entry: entry.seq)

    def lines(self) -> Iterator[bytes]:
        """Yield the attachment's lines; none if the record is short, or the overview too large."""
        if self.count <= WHOLE or not self._kept:
            return
        yield encoded({"interval": self.interval}) + b"\n"
        for entry in self.entries:
            yield b"[%d,%b]\n" % (entry.seq, entry.text)

    def _keep(self, place: Hashable, entry: OverviewEntry) -> None:
        before = self._kept.pop(place, None)
        if before is not None:
            self.size -= len(before.content)
            entry.samples = before.samples
        self._kept[place] = entry
        self.size += len(entry.content)

    def _coarsen(self) -> None:
        """Join two parts each: the later one's last messages stay, and the extremes of both."""
        self.interval *= 2.0
        finer = self._kept
        self._kept = {}
        self.size = 0
        for place, entry in finer.items():
            if not isinstance(place, tuple):
                self._keep(place, entry)
                continue
            coarser = (*place[:-1], place[-1] // 2)
            before = self._kept.get(coarser)
            if before is not None and before.samples is not None and entry.samples is not None:
                before.samples.join(entry.samples)
            samples = entry.samples
            self._keep(coarser, entry)
            entry.samples = entry.samples or samples

    def _repeated(self, message: Mapping[str, Any]) -> Key | None:
        """Return the key of a message that repeats an earlier one; None if it must be kept."""
        key = key_of(message)
        if key is None or key[0] not in REPEATED:
            return None
        if key[0] == "NodeChanged":
            now = (message.get("status"), message.get("starts"))
            if self._state.get(key[1]) != now:
                self._state[key[1]] = now
                return None
        return key


class Standing(NamedTuple):
    """Number, time [s] and key of a message that is valid until the next one of its key."""

    seq: int
    t: float
    key: Key


def standing(seq: int, message: Mapping[str, Any]) -> Standing | None:
    """Return the place of a message of an overview, or None if its kind is not one of `STANDING`."""
    key = key_of(message)
    t = message.get("t")
    if (
        key is None
        or key[0] not in STANDING
        or not isinstance(t, (int, float))
        or not abs(t) < _LONGEST
    ):
        return None
    return Standing(seq, float(t), key)


def _head(message: Mapping[str, Any]) -> dict[str, Any]:
    """Return a message of one of the `STANDING` kinds without its content."""
    head = {
        name: message[name]
        for name in ("event", "t", "tick", "node", "topic", "key", "path")
        if name in message
    }
    value = message.get("value")
    return (
        {**head, "value": {"type": value["type"]}}
        if message.get("event") == "Published" and value
        else head
    )
