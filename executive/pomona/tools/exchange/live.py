"""Live views: a thread translates the events of a run and passes them to a sink.

The tick puts events into a queue and never waits. If the sink is slow, the oldest events are dropped and counted; the
run reports the count at its end. The messages are those of a record (`pomona.executive.recording.well_known`), so live
and recorded views agree; times are nanoseconds since 1970.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any, Protocol

from pomona.executive.recording.folder import DEVICES, EVENTS
from pomona.executive.recording.message import in_place_of, message_of, refuse
from pomona.executive.recording.schemas import EVENT, READING, Schema
from pomona.executive.recording.well_known import samples, well_known
from pomona.executive.running.events import Event, Published, RunStarted
from pomona.executive.values.processes import warn
from pomona.executive.views import ImageView, SeriesView

logger = logging.getLogger(__name__)

# seconds between two looks into the queue; waking for each event would cost the tick more
EVERY = 0.01
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

    def __init__(self, sink: Sink) -> None:
        self._sink: Sink | None = sink
        self._queue: deque[Any] = deque(maxlen=MOST)
        self._put = 0
        self._taken = 0
        self._began = 0
        self._closing = False
        self._wake = threading.Event()
        self._thread = threading.Thread(target=self._work, name="pomona-live", daemon=True)
        self._thread.start()

    @property
    def dropped(self) -> int:
        """Number of events and readings that were dropped because the sink was too slow."""
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
        """Show the remaining events for `CLOSING`, then close the sink."""
        self._closing = True
        self._wake.set()
        self._thread.join(CLOSING + 1.0)
        if self.dropped:
            warn(
                logger,
                "a live view could not follow: %d of %d events were left out",
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
            self._try(lambda sink: sink.rest())
            if deadline < float("inf"):
                break
        self._try(lambda sink: sink.close())

    def _take(self, taken: Any) -> None:
        """Show an event or readings; a sink that fails receives the error in their place."""
        if isinstance(taken, RunStarted):
            self._began = round((taken.wall_time - taken.t) * 1e9)
        try:
            show = self._showing(taken)
        except BaseException as error:  # any error: this thread must go on showing later events
            taken = in_place_of(taken, refuse(taken, error))
            show = self._showing(taken)
        if self._sink is not None:
            try:
                show(self._sink)
            except Exception as error:
                self._try(self._showing(in_place_of(taken, refuse(taken, error))))

    def _showing(self, taken: Any) -> Callable[[Sink], None]:
        """Return a function that shows an event or readings to a sink."""
        view: ImageView | None = None
        messages: list[tuple[str, Schema, Mapping[str, Any]]]
        if isinstance(taken, Event):
            stamp = self._began + round(max(taken.t, 0.0) * 1e9)
            messages = [(EVENTS, EVENT, message_of(taken)), *well_known(taken, stamp)]
            if isinstance(taken, Published):
                if isinstance(taken.value, SeriesView):
                    messages += samples(taken.topic, taken.value)
                elif isinstance(taken.value, ImageView) and taken.value.image is not None:
                    view = taken.value
        else:
            t, tick, readings = taken
            stamp = self._began + round(t * 1e9)
            messages = [
                (f"{DEVICES}{device}", READING, {"t": t, "tick": tick, **quantities})
                for device, quantities in readings.items()
            ]

        def show(sink: Sink) -> None:
            if view is not None:
                sink.show(taken.topic, view, stamp)
            for message in messages:
                sink.send(*message, stamp)

        return show

    def _try(self, do: Callable[[Sink], None]) -> None:
        """Report a failed sink once and stop using it: a view never ends a run."""
        if self._sink is not None:
            try:
                do(self._sink)
            except Exception as error:
                logger.warning("%s shows no more: %s", type(self._sink).__name__, error)
                self._sink = None
