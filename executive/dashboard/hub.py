"""From the tick thread to any number of viewers, without the tick ever waiting for one of them."""

from __future__ import annotations

import asyncio
import contextlib
import queue
import threading
from collections import deque
from typing import Any

from executive.dashboard.messages import encode
from executive.events import Event, Published, RunStarted
from executive.views import ImageView, SceneView

HISTORY = 50_000
"""Messages of a run that are kept for viewers who come later; the oldest go first, the run's start never."""

BACKLOG = 2_000
"""Messages that may wait for one viewer; a viewer that is further behind is sent the whole state afresh."""


class Viewer:
    """One open page."""

    def __init__(self) -> None:
        self.waiting: deque[str] = deque()
        self.news = asyncio.Event()
        self.lagged = False

    async def next(self) -> str:
        """The next message; waits for one."""
        while not self.waiting:
            self.news.clear()
            await self.news.wait()
        return self.waiting.popleft()


class Hub:
    """Keeps a run's messages and hands them to viewers. Subscribe `hear` to the run's stream."""

    def __init__(self) -> None:
        self._incoming: queue.SimpleQueue[Event | None] = queue.SimpleQueue()
        self._loop: asyncio.AbstractEventLoop | None = None
        self._viewers: set[Viewer] = set()
        self._start: str | None = None
        self._history: deque[tuple[int, str]] = deque(maxlen=HISTORY)
        self._pictures: dict[str, tuple[int, str]] = {}
        self._seq = 0
        self._lock = threading.Lock()
        self._thread = threading.Thread(target=self._encode, name="pomona-hub", daemon=True)
        self._thread.start()

    def attach(self, loop: asyncio.AbstractEventLoop) -> None:
        """Hand messages over in this loop from now on."""
        self._loop = loop

    def hear(self, event: Event) -> None:
        """Take one event; returns at once."""
        self._incoming.put(event)

    def close(self) -> None:
        """Stop encoding; what was heard before is still sent."""
        self._incoming.put(None)
        self._thread.join(5.0)

    # -------------------------------------------------------------------------------------- in the loop

    def join(self, since: int = 0) -> Viewer:
        """A new viewer, with everything after message `since` already waiting for it."""
        viewer = Viewer()
        with self._lock:
            viewer.waiting.extend(self._backlog(since))
            self._viewers.add(viewer)
        viewer.news.set()
        return viewer

    def leave(self, viewer: Viewer) -> None:
        with self._lock:
            self._viewers.discard(viewer)

    @property
    def viewers(self) -> int:
        return len(self._viewers)

    def _backlog(self, since: int) -> list[str]:
        kept = [entry for entry in self._history if entry[0] > since]
        kept += [entry for entry in self._pictures.values() if entry[0] > since]
        kept.sort(key=lambda entry: entry[0])
        start = [self._start] if self._start is not None and since == 0 else []
        return start + [text for _seq, text in kept]

    # ------------------------------------------------------------------------------- the encoding thread

    def _encode(self) -> None:
        while (event := self._incoming.get()) is not None:
            with self._lock:
                if isinstance(event, RunStarted):
                    self._history.clear()
                    self._pictures.clear()
                    self._seq = 0
                self._seq += 1
                seq = self._seq
            text = encode(event, seq)
            with self._lock:
                if isinstance(event, RunStarted):
                    self._start = text
                elif isinstance(event, Published) and isinstance(event.value, (ImageView, SceneView)):
                    self._pictures[event.topic] = (seq, text)  # only the newest picture of a topic is worth keeping
                else:
                    self._history.append((seq, text))
            self._deliver(text)

    def _deliver(self, text: str) -> None:
        if self._loop is not None:
            with contextlib.suppress(RuntimeError):  # the loop was closed meanwhile
                self._loop.call_soon_threadsafe(self._hand_out, text)

    def _hand_out(self, text: str) -> None:
        with self._lock:
            for viewer in self._viewers:
                if viewer.lagged:
                    continue
                if len(viewer.waiting) >= BACKLOG:
                    viewer.waiting.clear()
                    viewer.waiting.append('{"v":1,"event":"Lagged"}')
                    viewer.lagged = True
                else:
                    viewer.waiting.append(text)
                viewer.news.set()


def control_message(**fields: Any) -> dict[str, Any]:
    """A message that is not an event of the run: who holds control, how many watch."""
    return {"v": 1, "event": "Control", **fields}
