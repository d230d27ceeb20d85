"""Live views: a thread translates the events of a run and passes them to every sink.

The tick puts events into a queue and never waits. If the sinks are slow, the oldest events are dropped and counted; the
run reports the count at its end. The messages are those of a record (`pomona.executive.recording.well_known`), so live
and recorded views agree; times are nanoseconds since 1970.
"""

from __future__ import annotations

import logging
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, Protocol

from pomona.executive.encode import plain
from pomona.executive.recording.folder import DEVICES, EVENTS
from pomona.executive.recording.message import in_place_of, message_of, refuse
from pomona.executive.recording.schemas import EVENT, READING, Schema
from pomona.executive.recording.well_known import samples, well_known
from pomona.executive.running.events import Event, Published, RunStarted
from pomona.executive.values.processes import warn
from pomona.executive.views import ImageView, SeriesView

logger = logging.getLogger(__name__)

EVERY = (
    0.01  # seconds between two looks into the queue; waking for each event would cost the tick more
)
MOST = 2000  # events that wait; some seconds of a run
CLOSING = 2.0  # time for the remaining events at the end [s]


class Sink(Protocol):
    """Somewhere that a run is shown. Called in the thread of `Live` only; may take its time, and may fail."""

    def send(self, topic: str, schema: Schema, content: Mapping[str, Any], stamp: int) -> None:
        """One message, as a record has it; `stamp` is nanoseconds since 1970."""

    def show(self, topic: str, view: ImageView, stamp: int) -> None:
        """A picture, before the event that carries its drawings."""

    def rest(self) -> None:
        """Called between messages, a hundred times a second."""

    def close(self) -> None:
        """Release it."""


class Live:
    """Subscribe `on_event` to a run's events, and hand it the readings; close it after the run."""

    def __init__(self, sinks: Sequence[Sink]) -> None:
        self._sinks = list(sinks)
        self._queue: deque[Any] = deque(maxlen=MOST)
        self._put, self._taken = 0, 0
        self._began = 0
        self._closing = False
        self._wake = threading.Event()
        self._thread = threading.Thread(target=self._work, name="pomona-live", daemon=True)
        self._thread.start()

    @property
    def dropped(self) -> int:
        """Number of events and readings that were dropped because the sinks were too slow."""
        return max(self._put - self._taken - len(self._queue), 0)

    def on_event(self, event: Event) -> None:
        """Take one event; returns at once."""
        self._put += 1
        self._queue.append(event)
        if isinstance(event, Published) and isinstance(event.value, ImageView):
            self._wake.set()

    def read(self, t: float, tick: int, readings: Mapping[str, Mapping[str, Any]]) -> None:
        """Queue readings of the cell's devices; returns at once."""
        if readings:
            self._put += 1
            self._queue.append((t, tick, readings))

    def close(self) -> None:
        """Show the remaining events for `CLOSING`, then close the sinks."""
        self._closing = True
        self._wake.set()
        self._thread.join(CLOSING + 1.0)
        if self.dropped:
            warn(
                logger,
                "live views could not follow: %d of %d events were left out",
                self.dropped,
                self._put,
            )

    def _work(self) -> None:
        deadline = float("inf")
        while True:
            self._wake.wait(EVERY)
            self._wake.clear()
            if self._closing and deadline == float("inf"):
                deadline = time.monotonic() + CLOSING
            while self._queue and time.monotonic() < deadline:
                self._taken += 1
                self._take(self._queue.popleft())
            self._each(lambda sink: sink.rest())
            if deadline < float("inf"):
                break
        self._each(lambda sink: sink.close())

    def _take(self, taken: Any) -> None:
        """Show an event or readings; a sink that fails receives the error in their place."""
        if isinstance(taken, RunStarted):
            self._began = round((taken.wall_time - taken.t) * 1e9)
        try:
            shows = self._shows(taken)
        except BaseException as error:  # any error: this thread must go on showing later events
            taken = in_place_of(taken, refuse(taken, error))
            shows = self._shows(taken)
        for sink in tuple(self._sinks):
            try:
                for show in shows:
                    show(sink)
            except Exception as error:
                instead = self._shows(in_place_of(taken, refuse(taken, error)))
                self._each(lambda sink, shows=instead: [show(sink) for show in shows], [sink])

    def _shows(self, taken: Any) -> list[Callable[[Sink], None]]:
        """Yield the calls for each sink, in order."""
        if not isinstance(taken, Event):
            t, tick, readings = taken
            messages = [
                (f"{DEVICES}{device}", READING, {"t": t, "tick": tick, **quantities})
                for device, quantities in readings.items()
            ]
            return [partial(_send, *message, self._began + round(t * 1e9)) for message in messages]
        stamp = self._began + round(max(taken.t, 0.0) * 1e9)
        shows: list[Callable[[Sink], None]] = []
        if (
            isinstance(taken, Published)
            and isinstance(taken.value, ImageView)
            and taken.value.image is not None
        ):
            shows.append(partial(_show, taken.topic, taken.value, stamp))
        messages = [(EVENTS, EVENT, message_of(taken)), *well_known(taken, stamp)]
        if isinstance(taken, Published) and isinstance(taken.value, SeriesView):
            messages += samples(taken.topic, taken.value)
        return [*shows, *(partial(_send, *message, stamp) for message in messages)]

    def _each(self, do: Any, sinks: Sequence[Sink] | None = None) -> None:
        """Report a failed sink once and stop using it: a view never ends a run."""
        for sink in tuple(self._sinks if sinks is None else sinks):
            try:
                do(sink)
            except Exception as error:
                self._sinks.remove(sink)
                logger.warning("%s shows no more: %s", type(sink).__name__, error)


def _send(topic: str, schema: Schema, content: Mapping[str, Any], stamp: int, sink: Sink) -> None:
    sink.send(topic, schema, content, stamp)


def _show(topic: str, view: ImageView, stamp: int, sink: Sink) -> None:
    sink.show(topic, view, stamp)


def plain_content(content: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return a message with lists where it has arrays, however large: a mesh has some thousand corners."""
    lists: Mapping[str, Any] = plain(content, arrays=sys.maxsize)
    return lists
