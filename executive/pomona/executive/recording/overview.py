"""What a screen can show of a long run: what changes something, and of what is said again and again the last word of
each part of the time; of samples the least and the greatest. It is made while a run is recorded, and stands in the
record as an attachment, so that half an hour opens without being read.

What only says how things stand (a view of a moment, a written value) is most of a picking robot's record, and of all of
it a screen shows the last: of these an overview has the place only, and they are read with the moment that is shown.

An attachment's first line is {"interval": seconds}, every further one [an event's number, the event].
"""

from __future__ import annotations

import json
import re
from collections.abc import Hashable, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

from pomona.executive.recording.extremes import Extremes

OVERVIEW = "overview.ndjson"
WHOLE, WHOLE_BYTES = 20_000, 10_000_000
"""Records with no more events, or of no more bytes, are their own overview."""

PARTS = 2_000
"""Into which the time is divided at most; when it is longer, two parts become one."""

SHORTEST = 0.05
"""Seconds of a part at first."""

_LONGEST = 1e9
"""Seconds; longer is no run."""

MOST_BYTES = 64_000_000
"""Of an overview. A run that has more to show has none, and its record is read whole."""

FREQUENT = re.compile(
    rb'\{"event":"(NodeChanged|Published|PortWritten|Computed)",[^{]*?"(?:path|topic|key|node)":"((?:[^"\\]|\\.)*)"'
)
_CHANGES = (b'{"event":"NodeChanged",', b'{"event":"Computed",')
"""How those begin that never stand."""

_STATUS = re.compile(rb'"status":"(\w+)"')
_STARTS = re.compile(rb'"starts":(\d+)')
_T = re.compile(rb'"t":([-+0-9.eE]+)')
STANDING = frozenset((b"PortWritten", b"ImageView", b"SceneView", b"BodiesView", b"TableView", b"ProgressView"))
"""Kinds of events that stand until the next of their key."""

TOPIC = re.compile(rb'"topic":"((?:[^"\\]|\\.)*)","value":\{"type":"(\w+)"')


@dataclass(slots=True)
class OverviewEntry:
    """One event of an overview: its number, its text, and its samples where it stands for more."""

    seq: int
    content: bytes
    samples: Extremes | None = None

    @property
    def text(self) -> bytes:
        """The event as it is shown."""
        return self.content if self.samples is None else self.samples.message()


@dataclass(slots=True)
class Overview:
    """Takes events in their order; `entries` are what stays of them."""

    interval: float = SHORTEST
    count: int = 0
    size: int = 0
    """Bytes of what stays."""
    _kept: dict[Hashable, OverviewEntry] = field(default_factory=dict)
    _state: dict[bytes, tuple[bytes, bytes]] = field(default_factory=dict)

    def add(self, seq: int, t: float, content: bytes) -> None:
        """Take one event: its text as it is recorded."""
        self.count += 1
        if self.size > MOST_BYTES:
            self._kept.clear()
            return
        while t >= self.interval * PARTS and self.interval < _LONGEST:
            self._coarsen()
        place = self._place(seq, t, content)
        stands = isinstance(place, tuple) and place[0] in STANDING
        self._keep(place, OverviewEntry(seq, _head(content) if stands else content))
        if isinstance(place, tuple) and place[0] == b"SeriesView":
            entry = self._kept[place]
            entry.samples = entry.samples or Extremes()
            entry.samples.add(content)

    @property
    def entries(self) -> list[OverviewEntry]:
        """What stays, in order."""
        return sorted(self._kept.values(), key=lambda entry: entry.seq)

    def lines(self) -> Iterator[bytes]:
        """The attachment's lines; none where the record is short enough to be read, or shows too much."""
        if self.count <= WHOLE or not self._kept:
            return
        yield json.dumps({"interval": self.interval}).encode() + b"\n"
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
        """Two parts become one: the later one's last words stay, and both parts' extremes."""
        self.interval *= 2.0
        finer, self._kept, self.size = self._kept, {}, 0
        for place, entry in finer.items():
            if not isinstance(place, tuple):
                self._keep(place, entry)
                continue
            coarser = (*place[:2], place[2] // 2)
            before = self._kept.get(coarser)
            if before is not None and before.samples is not None and entry.samples is not None:
                before.samples.join(entry.samples)
            samples = entry.samples
            self._keep(coarser, entry)
            entry.samples = entry.samples or samples

    def _place(self, seq: int, t: float, content: bytes) -> Hashable:
        """Events that share a place replace each other; one that says something new has a place of its own."""
        found = FREQUENT.match(content)
        if found is None:
            return seq
        kind, key = found.groups()
        if kind == b"NodeChanged":
            status, starts = _STATUS.search(content, found.end()), _STARTS.search(content, found.end())
            now = (status[1] if status else b"", starts[1] if starts else b"")
            if self._state.get(key) != now:
                self._state[key] = now
                return seq
        elif kind == b"Published":
            view = TOPIC.search(content, found.start(2))
            if view is None:
                return seq
            key, kind = view.groups()
        return kind, key, int(t / self.interval)


class Standing(NamedTuple):
    """Where an event stands that says how things are: its number, its time [s], its kind and key."""

    seq: int
    t: float
    key: tuple[bytes, bytes]


def standing(seq: int, content: bytes) -> Standing | None:
    """What an event of an overview says of how things stand, or None: it is of another kind."""
    found = None if content.startswith(_CHANGES) else FREQUENT.match(content)
    if found is None:
        return None
    kind, key = found.groups()
    if kind == b"Published":
        view = TOPIC.search(content, found.start(2))
        if view is None:
            return None
        key, kind = view.groups()
    t = _T.search(content, 0, found.start(2))
    if kind not in STANDING or t is None or not -_LONGEST < float(t[1]) < _LONGEST:
        return None
    return Standing(seq, float(t[1]), (kind, key))


def _head(content: bytes) -> bytes:
    """An event that stands, without what it says."""
    view = TOPIC.search(content)
    if view is not None and content.startswith(b'{"event":"Published"'):
        return content[: view.end()] + b"}}"
    found = FREQUENT.match(content)
    return content if found is None else content[: found.end()] + b"}"
