"""From the tick thread to any number of viewers, without the tick ever waiting for one of them.

An `Encoder` turns events into messages in a thread of its own. A `Hub` keeps messages and hands them to viewers; it may
be in another process.
"""

from __future__ import annotations

import asyncio
import contextlib
import queue
import secrets
import threading
import time
from collections import deque
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from pomona.executive.recording.message import in_place_of, key_of, refuse
from pomona.executive.running.events import (
    Event,
    OperatorActed,
    Published,
    SafeStopped,
    StateChanged,
)
from pomona.tools.dashboard.connections import LiveWire, frame_of
from pomona.tools.dashboard.messages import fields_of, message, numbered

# characters of a run kept for later viewers; of older ones each key's last message
HISTORY_BYTES = 32_000_000
# seconds in which messages are gathered: fifty viewers cost thirty sends a second each
BATCH = 0.033
PICTURES = frozenset(
    ("ImageView", "SceneView")
)  # kinds of views of which only the newest one of a topic is kept

LASTING = frozenset(
    ("NodeChanged", "AttemptEnded", "PortWritten", "LinkChanged", "OperatorActed", "StateChanged")
)
LASTING |= {
    "TreeChanged",
    "SafeStopped",
    "RunEnded",
    "TableView",
    "BodiesView",
    "PosesView",
    "ProgressView",
}
"""Kinds of messages of which the last one of each key describes the present."""

URGENT = (OperatorActed, StateChanged, SafeStopped, type(None))
"""Events after which messages are sent at once: an operator waits for the effect of a press."""

CHUNK = 500_000  # characters of one batch of old messages
BACKLOG = 600  # batches that may wait for one viewer; one that is further behind is sent the whole state afresh
Kept = tuple[int, str]  # a message's number and text


class Word(NamedTuple):
    """One encoded event."""

    seq: int  # its number
    text: str  # the message
    slot: str  # "start" for a run's first one, "picture" where only the newest of a key is worth keeping, else ""
    key: Hashable  # the subject of the event's state; None: without state beyond the history


class Encoder:
    """Encodes events in a thread of its own and delivers them in batches. Subscribe `on_event` to a run's stream."""

    def __init__(self, deliver: Callable[[Sequence[Word]], None]) -> None:
        self._deliver = deliver
        self._incoming: queue.SimpleQueue[Event | None] = queue.SimpleQueue()
        self._seq = 0
        self._thread = threading.Thread(target=self._work, name="pomona-hub", daemon=True)
        self._thread.start()

    def on_event(self, event: Event) -> None:
        """Take one event; returns at once."""
        self._incoming.put(event)

    def close(self) -> None:
        """Stop encoding; earlier events are still delivered."""
        self._incoming.put(None)
        self._thread.join(5.0)

    def _work(self) -> None:
        open_ = True
        while open_:
            events = [self._incoming.get()]
            until = time.monotonic() + BATCH
            with contextlib.suppress(queue.Empty):
                while not isinstance(events[-1], URGENT):
                    events.append(self._incoming.get(timeout=max(0.0, until - time.monotonic())))
            open_ = None not in events
            words = [self._word(event) for event in events if event is not None]
            if words:
                self._deliver(words)

    def _word(self, event: Event) -> Word:
        """Encode an event, or its replacement: no published object may end this thread."""
        self._seq += 1
        try:
            return _word_of(event, self._seq)
        except BaseException as error:
            return _word_of(in_place_of(event, refuse(event, error)), self._seq)


class Viewer:
    """One open page. `waiting` holds batches, messages, one a line, that its wire could not take at once."""

    def __init__(self, wire: LiveWire | None = None) -> None:
        self._wire = wire
        self.waiting: deque[str] = deque()
        self.news = asyncio.Event()
        self.lagged = False
        self.armed = False
        """Whether the page has shown the token: its presses are carried out."""
        self.page = ""
        self.last_seen = 0.0
        """The page's own id, and when it asked last whether it is heard."""

    def tell(self, event: str, **fields: Any) -> None:
        """Something for this page alone, after all that waits for it. In the server's loop."""
        if not self.lagged and len(self.waiting) < BACKLOG:
            text = message(event, **fields)
            self.hand(text, frame_of(text))

    def hand(self, batch: str, frame: bytes) -> None:
        """A batch, and the same as a frame: sent at once, unless something waits. In the server's loop."""
        if self.lagged or (not self.waiting and self._wire is not None and self._wire.take(frame)):
            return
        if len(self.waiting) >= BACKLOG:
            first = self.waiting[0]  # it may be on its way
            self.waiting.clear()
            self.waiting.extend((first, message("Lagged")))
            self.lagged = True
        else:
            self.waiting.append(batch)
        self.news.set()

    async def next(self) -> str:
        """Return the next batch; waits for one. It waits itself until `sent` is called: nothing passes it meanwhile."""
        while not self.waiting:
            self.news.clear()
            await self.news.wait()
        return self.waiting[0]

    def sent(self) -> None:
        """The next batch is on its way."""
        self.waiting.popleft()


class Hub:
    """Keeps a run's messages and hands them to viewers. It takes events, or words that are encoded already."""

    def __init__(self) -> None:
        self.stream = secrets.token_hex(8)
        """Names this hub: numbers of messages mean nothing to another one."""
        self._encoder = Encoder(self.take)
        self._loop: asyncio.AbstractEventLoop | None = None
        self._viewers: set[Viewer] = set()
        self._start: Kept | None = None
        self._history: deque[tuple[int, str, Hashable]] = deque()
        self._history_size = 0
        self._forgotten = 0  # number of the newest message that has left the history
        self._last_words: dict[Hashable, Kept] = {}
        self._pictures: dict[Hashable, Kept] = {}
        self._control = ""
        self._lock = threading.Lock()

    def attach(self, loop: asyncio.AbstractEventLoop) -> None:
        """Hand messages over in this loop from now on."""
        self._loop = loop

    def on_event(self, event: Event) -> None:
        """Take one event; returns at once."""
        self._encoder.on_event(event)

    def take(self, words: Sequence[Word]) -> None:
        """Keep messages and hand them to every viewer. From one thread."""
        with self._lock:
            for word in words:
                self._keep(word)
        self._deliver("\n".join(word.text for word in words))

    def announce(self, **control: Any) -> None:
        """Send every viewer, present or future, the holder of control. From any thread."""
        self._control = message("Control", **control)
        self._deliver(self._control)

    def tell(self, event: str, **fields: Any) -> None:
        """Send a message to the present viewers, and to none that connect later. From any thread."""
        self._deliver(message(event, **fields))

    def close(self) -> None:
        """Stop encoding; earlier events are still sent."""
        self._encoder.close()

    # -------------------------------------------------------------------------------------- in the loop

    def join(self, since: int = 0, stream: str = "", wire: LiveWire | None = None) -> Viewer:
        """Return a new viewer, with everything after message `since` of `stream` already waiting for it."""
        viewer = Viewer(wire)
        viewer.waiting.append(message("Hello", stream=self.stream))
        with self._lock:
            viewer.waiting.extend(_chunks(self._backlog(since if stream == self.stream else 0)))
            if self._control:
                viewer.waiting.append(self._control)
            self._viewers.add(viewer)
        viewer.news.set()
        return viewer

    def leave(self, viewer: Viewer) -> None:
        """A viewer has gone."""
        with self._lock:
            self._viewers.discard(viewer)

    @property
    def viewers(self) -> int:
        """How many watch now."""
        return len(self._viewers)

    def last_seen(self, page: str) -> float:
        """When this page was heard last, by `time.monotonic`; 0 when it is not open."""
        with self._lock:
            return max(
                (viewer.last_seen for viewer in self._viewers if viewer.page == page), default=0.0
            )

    @property
    def drained(self) -> bool:
        """Whether nothing waits for any viewer."""
        with self._lock:
            return not any(viewer.waiting for viewer in self._viewers)

    def _backlog(self, since: int) -> list[str]:
        kept = [(seq, text) for seq, text, _key in self._history] + list(self._pictures.values())
        started = self._start[0] if self._start is not None else 0
        if since < max(
            started, self._forgotten
        ):  # no piece can be missing: the whole state, from the run's start
            since = 0
            kept += self._last_words.values()
            kept += [self._start] if self._start is not None else []
        return [text for seq, text in sorted(kept) if seq > since]

    # --------------------------------------------------------------------------- the thread of the messages

    def _keep(self, word: Word) -> None:
        seq, text, slot, key = word
        if slot == "start":
            self._history.clear()
            self._pictures.clear()
            self._last_words.clear()
            self._history_size = 0
            self._start = (seq, text)
            self._forgotten = 0
        elif slot == "picture":
            self._pictures[key] = (seq, text)
        else:
            self._history.append((seq, text, key))
            self._history_size += len(text)
        while self._history_size > HISTORY_BYTES:
            self._forget()

    def _forget(self) -> None:
        seq, text, key = self._history.popleft()
        self._history_size -= len(text)
        self._forgotten = seq
        if key is not None:
            self._last_words[key] = (seq, text)

    def _deliver(self, batch: str) -> None:
        if self._loop is not None:
            with contextlib.suppress(RuntimeError):  # the loop was closed meanwhile
                self._loop.call_soon_threadsafe(self._hand_out, batch)

    def _hand_out(self, batch: str) -> None:
        frame = frame_of(batch)
        with self._lock:
            viewers = sorted(
                self._viewers, key=lambda viewer: not viewer.armed
            )  # viewers that may act come first
        for viewer in viewers:
            viewer.hand(batch, frame)


def _word_of(event: Event, seq: int) -> Word:
    if isinstance(event, Published) and not isinstance(event.topic, str):
        raise TypeError(f"its topic is no text but {type(event.topic).__name__}")
    fields = fields_of(event)
    slot, key = _slot(fields)
    return Word(seq, numbered(fields, seq).decode(), slot, key)


def _slot(fields: Mapping[str, Any]) -> tuple[str, Hashable]:
    """Where the hub keeps an event, and its key: the last message of each key is enough to know the present."""
    if fields["event"] == "RunStarted":
        return "start", None
    key = key_of(fields)
    if key is not None and key[0] in PICTURES:
        return "picture", key
    return "", key if key is not None and key[0] in LASTING else None


def _chunks(texts: Iterable[str]) -> list[str]:
    """Messages joined into batches of about `CHUNK` characters."""
    batches: list[list[str]] = []
    size = CHUNK
    for text in texts:
        if size >= CHUNK:
            batches.append([])
            size = 0
        batches[-1].append(text)
        size += len(text)
    return ["\n".join(batch) for batch in batches]
