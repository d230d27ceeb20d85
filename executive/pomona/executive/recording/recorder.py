"""A run's record: a folder with the events as an MCAP file, the tree and the cell as they were, and a picture.

A thread of its own writes the record during the run. The tick only puts events into a queue; every `BATCH` seconds the
queue is passed to the operating system as one chunk with its checksum. A killed process loses no more than that. The
file is locked while it is written, so other processes see a run in progress.

A write may also wait for ever: a dead disk, network or pipe. `look` detects a flush that is `STALLED` late; after
`LOST`, or `CLOSING` of the end, the record is given up.

The recorder refuses each event that a reader would refuse: one that cannot be encoded, is too large, or has a field of
a wrong type. An error that names the event takes its place, and the record reports a problem.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import queue
import threading
import time
from collections.abc import Iterator, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from mcap.writer import CompressionType, Writer

from pomona.executive.encode import encoded, plain
from pomona.executive.errors import PomonaError
from pomona.executive.recording.folder import (
    DEVICES,
    EVENTS,
    EVENTS_FILE,
    EndingFile,
    RecordError,
    hash_of,
    next_number,
)
from pomona.executive.recording.mcap_file import LIBRARY, MOST_MESSAGE
from pomona.executive.recording.message import in_place_of, message_of, refuse
from pomona.executive.recording.overview import OVERVIEW, WHOLE_BYTES, Overview
from pomona.executive.recording.read import event_from
from pomona.executive.recording.schemas import EVENT, READING, Schema
from pomona.executive.recording.well_known import Images, samples, well_known
from pomona.executive.running.events import (
    ErrorRaised,
    Event,
    Published,
    RunEnded,
    RunStarted,
)
from pomona.executive.values.processes import lock
from pomona.executive.values.sentences import sentence_of
from pomona.executive.views import ImageView, SeriesView

BATCH = 0.1  # time between two writes [s]; a killed process loses the events of this time
CHUNK_BYTES = 65_536  # largest chunk, except for one large message [bytes]: a damaged byte makes one chunk unreadable
STALLED = 5.0  # time without a completed flush from which the record reports that its disk takes nothing [s]
LOST = 60.0  # the same: the record is given up, since events fill the memory [s]
CLOSING = 10.0  # the same, while the record is closed [s]
_DECIMALS = 6  # decimals of a reading: micrometres, microradians, micronewtons


class Lag:
    """Time for which a count stands still. A late look counts as `BATCH`, so a stalled computer is no stalled disk."""

    def __init__(self) -> None:
        self._count = -1
        self._lag = 0.0
        self._looked_at = 0.0

    def seconds(self, count: int, now: float) -> float:
        """Return it [s], for a look at a monotonic time [s]."""
        self._lag = 0.0 if count != self._count else self._lag + min(now - self._looked_at, BATCH)
        self._count = count
        self._looked_at = now
        return self._lag


class GivenUpError(PomonaError):
    """The record was given up while its thread waited for the disk."""


class Recorder:
    """Writes events into a record. Subscribe its `on_event` to the run's stream, and close it after the run."""

    def __init__(self, folder: Path, *, durable: bool = False) -> None:
        """
        Args:
            folder: of the record; it exists.
            durable: pass the finished file to the disk, which may report an error of an earlier write only then.

        Raises:
            RecordError: the file cannot be opened.
        """
        self.folder = folder.absolute()  # the process may change its folder
        self._problem = ""
        self._stalled = ""
        self._lacks = ""
        self._whole = False
        self._durable, self._lag, self._steps = durable, Lag(), 0
        self._queue: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._closing = threading.Event()
        self._t = 0.0
        self._t_written = 0.0
        self._flushed = 0.0
        self._written = 0  # size of the file after the newest flush [bytes]
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._images = Images()
        try:
            self._path = self.folder / EVENTS_FILE
            self._file = self._path.open(
                "wb", buffering=(1 << 20)
            )  # write buffer, flushed with every batch [bytes]
            lock(self._file)
            self._ending = EndingFile(self.folder, next_number(self.folder.parent))
        except OSError as error:
            raise RecordError(f"cannot write {folder / EVENTS_FILE}: {error.strerror}") from error
        self._writer = new_writer(self._file, CompressionType.NONE)
        self._overview = Overview()
        self._events = 0
        self._thread = threading.Thread(target=self._work, name="pomona-recorder", daemon=True)
        self._thread.start()

    @property
    def problem(self) -> str:
        """Reason why the record ends early or lacks an event; empty without one. From any thread."""
        if self._problem or self._whole or self._thread.is_alive():
            return self._problem or self._stalled or self._lacks
        return self._ends_with("the recorder's thread has ended")

    @property
    def has_ended(self) -> bool:
        """True when nothing more is recorded. From any thread."""
        return bool(self._problem) or not self._thread.is_alive()

    def on_event(self, event: Event) -> None:
        """Take one event; returns at once."""
        if not self._problem:
            self._queue.put(event)

    def read(self, t: float, tick: int, readings: Mapping[str, Mapping[str, Any]]) -> None:
        """Take measurements of the cell's devices, by device and quantity; returns at once."""
        if not self._problem:
            self._queue.put((t, tick, readings))

    def look(self) -> float:
        """Compare the newest flush with the time; called in every tick. Returns the time without one [s]."""
        lag = self._lag.seconds(self._steps, time.monotonic())
        self._stalled = (
            f"the disk has taken nothing of the record for {STALLED:g} s" if lag > STALLED else ""
        )
        if lag > LOST:
            self._problem = self._problem or self._ends_with(
                f"its disk has taken nothing for {LOST:g} s"
            )
        return lag

    def close(self) -> bool:
        """Write the rest and close the file. A second call has no effect.

        Returns:
            False if a write still waits for the disk: its thread goes on waiting, and the record is given up.
        """
        self._closing.set()
        while self._thread.is_alive():
            self._thread.join(BATCH)
            if self.look() > CLOSING:
                self._problem = self._problem or self._ends_with(
                    f"its disk has taken nothing for {CLOSING:g} s"
                )
                return False
        self._stalled = ""
        return True

    # ------------------------------------------------------------------------------- the recorder's thread

    def _work(self) -> None:
        try:
            self._writer.start(profile="pomona", library=LIBRARY)
            self._take_all()
            if self._file.tell() > WHOLE_BYTES and (lines := b"".join(self._overview.lines())):
                self._writer.add_attachment(
                    _stamp(self._t), 0, OVERVIEW, "application/x-ndjson", lines
                )
            self._refuse_changed(self._written)
            self._writer.finish()
            self._file.flush()
            if self._durable:
                os.fsync(self._file.fileno())
            self._refuse_changed(self._file.tell())
            self._refuse_given_up()
            self._ending.write("closed", bytes=self._file.tell())
            self._whole = True
        except GivenUpError:
            self._ending.write("failed", why=self._problem)
        except OSError as error:
            self._give_up(error.strerror or str(error))
        except BaseException as error:  # a published value of a skill may raise any exception
            self._give_up(sentence_of(error))
        finally:
            with contextlib.suppress(OSError):  # a full disk is still full
                self._file.close()
            self._ending.close()

    def _give_up(self, why: str) -> None:
        self._problem = self._ends_with(why)
        self._ending.write("failed", why=why)

    def _ends_with(self, why: str) -> str:
        return f"the record ends at {self._t_written:.2f} s of the run: {why}"

    def _refuse_given_up(self) -> None:
        """Raises GivenUpError: events are missing from here on."""
        if self._problem:
            raise GivenUpError
        self._steps += 1

    def _refuse_changed(self, least: int) -> None:
        """Refuse a file that was moved or cut: no write call reports that.

        Args:
            least: smallest valid size of the file [bytes].

        Raises OSError: the file was removed, replaced or cut.
        """
        held = os.fstat(self._file.fileno())
        try:
            there = self._path.stat()
        except FileNotFoundError:
            raise FileNotFoundError(
                errno.ENOENT, "its file was removed while it was written"
            ) from None
        if not os.path.samestat(there, held):
            raise OSError(errno.ESTALE, "its file was replaced while it was written")
        if held.st_size < least:
            words = f"its file was cut to {held.st_size} bytes while it was written, from {least}"
            raise OSError(errno.ESTALE, words)

    def _take_all(self) -> None:
        """Write in batches: waking up for every event would cost the tick more than writing it."""
        closing = False
        while not closing:
            closing = self._closing.wait(BATCH)
            with contextlib.suppress(queue.Empty):
                while True:
                    self._take(self._queue.get_nowait())
                    if (
                        time.monotonic() - self._flushed > BATCH
                    ):  # after a delay there is much to write
                        self._flush()
            self._flush()

    def _flush(self) -> None:
        self._refuse_changed(self._written)  # no write may follow a gap
        self._writer.flush()
        self._written = self._file.tell()
        self._refuse_changed(self._written)
        self._refuse_given_up()
        self._t_written, self._flushed = self._t, time.monotonic()

    def _take(self, taken: Any) -> None:
        if isinstance(taken, Published) and isinstance(taken.value, ImageView):
            self._flush()  # earlier events do not wait for the picture's compression
        if isinstance(taken, Event):
            self._t = taken.t
            self._write_event(taken)
        else:
            self._write_readings(*taken)

    def _write_event(self, event: Event) -> None:
        if isinstance(event, RunStarted):
            self._write_about(event)
        stamp = _stamp(event.t)
        event, contents = self._contents(event, stamp)
        for topic, schema, message, content in contents:
            if topic == EVENTS:
                self._events += 1
                self._overview.add(self._events, stamp / 1e9, message, content)
            self._write(topic, schema, stamp, content, self._events if topic == EVENTS else 0)
        if isinstance(event, RunEnded):
            text = json.dumps(plain(event), ensure_ascii=False, indent=1)
            (self.folder / "summary.json").write_bytes(_coded(text))

    def _contents(
        self, event: Event, stamp: int
    ) -> tuple[Event, list[tuple[str, Schema, Any, bytes]]]:
        """Return an event and its messages, each with its text; or an error that replaces an unreadable event."""
        try:
            return event, [
                (*message, _bounded(message[2])) for message in self._messages(event, stamp)
            ]
        except BaseException as error:  # a published value may raise any exception
            told = self._refuse(event, error)
            message = message_of(told)
            return told, [(EVENTS, EVENT, message, encoded(message))]

    def _refuse(self, taken: Any, error: BaseException) -> ErrorRaised:
        refused = refuse(taken, error)
        told = in_place_of(taken, refused)
        self._lacks = (
            self._lacks or f"the record lacks an event at {told.t:.2f} s of the run: {refused}"
        )
        return told

    def _messages(self, event: Event, stamp: int) -> Iterator[tuple[str, Schema, Any]]:
        """Messages of an event, in their order. Raises ForeignRecordError: a reader would refuse the event."""
        if isinstance(event, Published):
            if isinstance(event.value, ImageView):
                yield from self._images.messages(event.topic, event.value, stamp)
            elif isinstance(event.value, SeriesView):
                yield from samples(event.topic, event.value)
        message = message_of(event)
        event_from(message)
        yield EVENTS, EVENT, message
        yield from well_known(event, stamp)

    def _write_about(self, event: RunStarted) -> None:
        """Write tree and cell as files and as attachments, and the most requested facts as metadata."""
        began = round(event.wall_time * 1e9)
        texts = {"tree.yaml": event.tree_text, "cell.yaml": event.cell_text}
        for name, text in texts.items():
            (self.folder / name).write_bytes(_coded(text))
        for name, text in {**texts, **event.tree_files, **event.cell_files}.items():
            self._writer.add_attachment(began, 0, _whole(name), "application/yaml", _coded(text))
        about = {
            name: getattr(event, name) for name in ("run", "tree", "tree_hash", "cell", "cell_kind")
        }
        about |= {
            "cell_hash": hash_of(event.cell_text, *event.cell_files.values()),
            "seed": str(event.seed),
            "began": datetime.fromtimestamp(event.wall_time)
            .astimezone()
            .isoformat(timespec="seconds"),
            "settings": json.dumps(plain(event.settings), ensure_ascii=False),
            "parameters": json.dumps(plain(event.parameters), ensure_ascii=False),
            **{f"version.{name}": version for name, version in event.versions.items()},
        }
        self._writer.add_metadata(
            "pomona.run", {_whole(key): _whole(value) for key, value in about.items()}
        )

    def _write_readings(
        self, t: float, tick: int, readings: Mapping[str, Mapping[str, Any]]
    ) -> None:
        try:
            coded = {
                device: _reading(t, tick, quantities) for device, quantities in readings.items()
            }
        except BaseException as error:  # a third party's driver may report any value
            self._write_event(self._refuse((t, tick, readings), error))
            return
        for device, content in coded.items():
            self._write(f"{DEVICES}{device}", READING, _stamp(t), content)

    def _write(
        self, topic: str, schema: Schema, stamp: int, content: bytes, number: int = 0
    ) -> None:
        if topic not in self._channels:
            if schema.name not in self._schemas:
                self._schemas[schema.name] = self._writer.register_schema(
                    name=schema.name, encoding="jsonschema", data=schema.text.encode()
                )
            self._channels[topic] = self._writer.register_channel(
                topic=topic, message_encoding="json", schema_id=self._schemas[schema.name]
            )
        self._writer.add_message(
            self._channels[topic], log_time=stamp, publish_time=stamp, data=content, sequence=number
        )


def new_writer(stream: BinaryIO, compression: CompressionType) -> Writer:
    """Return a writer of files with checksums of chunks, data and summary: a change of any byte is detected."""
    return Writer(stream, CHUNK_BYTES, compression, enable_crcs=True, enable_data_crcs=True)


def _bounded(message: Any) -> bytes:
    content = encoded(message)
    if len(content) > MOST_MESSAGE:
        raise RecordError(
            f"{len(content) / 1e6:.0f} MB of text; at most {MOST_MESSAGE / 1e6:.0f} MB are recorded"
        )
    return content


def _reading(t: float, tick: int, quantities: Mapping[str, Any]) -> bytes:
    # Rounding column by column was a sixth of the recorder's work.
    numbers = dict(
        zip(quantities, np.round(np.array(list(quantities.values())), _DECIMALS), strict=True)
    )
    return _bounded({"t": round(t, _DECIMALS), "tick": tick, **numbers})


def _stamp(t: float) -> int:
    """Return a message's time on the run's clock [ns]."""
    return round(max(t, 0.0) * 1e9)


def _coded(text: str) -> bytes:
    """Return a text as bytes; unpaired surrogates, which a name may contain, become "?"."""
    return text.encode(errors="replace")


def _whole(text: str) -> str:
    return _coded(text).decode()
