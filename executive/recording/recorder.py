"""A run's record: a folder with the events as an MCAP file, the tree and the cell as they were, and a picture.

Written as it happens, in a thread of its own: the tick only puts events into a queue. A process that is killed loses
what is younger than `FLUSH_EVERY`.
"""

from __future__ import annotations

import base64
import json
import queue
import threading
import time
from dataclasses import fields, replace
from datetime import datetime
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from mcap.writer import CompressionType, Writer

from executive.encode import plain
from executive.errors import PomonaError
from executive.events import Event, Published, RunEnded, RunStarted
from executive.recording.schemas import COMPRESSED_IMAGE, EVENT
from executive.views import ImageView

FLUSH_EVERY = 0.5
"""Seconds after which what was written is on the disk."""

EVENTS_FILE = "run.mcap"
_CLOSE = object()


class RecordError(PomonaError):
    """The record cannot be written."""


def new_record_folder(root: Path, tree: str, now: datetime | None = None) -> Path:
    """Make `root/2026-11-21_08-41-07_tree`, with a number appended when there is one already.

    Raises:
        RecordError: the folder cannot be made.
    """
    stem = f"{now or datetime.now():%Y-%m-%d_%H-%M-%S}_{tree}"
    for number in range(1000):
        folder = root / (stem if number == 0 else f"{stem}_{number + 1}")
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            continue
        except OSError as error:
            raise RecordError(f"cannot make the record's folder {folder}: {error.strerror}") from error
        return folder
    raise RecordError(f"{root} holds a thousand records of this second")


class Recorder:
    """Writes every event that it hears. Subscribe its `hear` to the run's stream, and close it after the run."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.problem = ""
        self._queue: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._file = (folder / EVENTS_FILE).open("wb")
        self._writer = Writer(self._file, compression=CompressionType.NONE, use_chunking=False)
        self._writer.start(profile="pomona", library="pomona")
        self._channels: dict[str, int] = {}
        self._thread = threading.Thread(target=self._write, name="pomona-recorder", daemon=True)
        self._thread.start()

    def hear(self, event: Event) -> None:
        """Take one event; returns at once."""
        self._queue.put(event)

    def close(self) -> None:
        """Write what is left and close the file. Harmless when closed already."""
        if self._thread.is_alive():
            self._queue.put(_CLOSE)
            self._thread.join()

    # ------------------------------------------------------------------------------- the recorder's thread

    def _write(self) -> None:
        flushed = time.monotonic()
        try:
            while True:
                try:
                    event = self._queue.get(timeout=FLUSH_EVERY)
                except queue.Empty:
                    event = None
                if event is _CLOSE:
                    break
                if event is not None:
                    self._write_event(event)
                if time.monotonic() - flushed > FLUSH_EVERY:
                    self._file.flush()
                    flushed = time.monotonic()
            self._writer.finish()
        except OSError as error:
            self.problem = f"the record ends early: {error.strerror or error}"
        finally:
            self._file.close()

    def _write_event(self, event: Event) -> None:
        stamp = round(max(event.t, 0.0) * 1e9)
        if isinstance(event, RunStarted):
            (self.folder / "tree.yaml").write_text(event.tree_text, encoding="utf-8")
            (self.folder / "cell.yaml").write_text(event.cell_text, encoding="utf-8")
        if isinstance(event, Published) and isinstance(event.value, ImageView) and event.value.image is not None:
            self._write_image(f"/images/{event.topic}", stamp, event.value.image)
            event = replace(event, value=replace(event.value, image=None))
        if isinstance(event, RunEnded):
            text = json.dumps(plain(event), ensure_ascii=False, indent=1)
            (self.folder / "summary.json").write_text(text, encoding="utf-8")
        limit = 4_000_000 if isinstance(event, Published) else 256
        message = {"event": type(event).__name__}
        message |= {f.name: plain(getattr(event, f.name), arrays=limit) for f in fields(event)}
        self._write_message("/events", EVENT, stamp, message)

    def _write_image(self, topic: str, stamp: int, image: np.ndarray[Any, Any]) -> None:
        ok, coded = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 90])
        if ok:
            seconds, nanoseconds = divmod(stamp, 1_000_000_000)
            self._write_message(
                topic,
                COMPRESSED_IMAGE,
                stamp,
                {
                    "timestamp": {"sec": seconds, "nsec": nanoseconds},
                    "frame_id": "camera",
                    "data": base64.b64encode(coded.tobytes()).decode(),
                    "format": "jpeg",
                },
            )

    def _write_message(self, topic: str, schema: tuple[str, str], stamp: int, message: Any) -> None:
        if topic not in self._channels:
            name, text = schema
            schema_id = self._writer.register_schema(name=name, encoding="jsonschema", data=text.encode())
            self._channels[topic] = self._writer.register_channel(
                topic=topic, message_encoding="json", schema_id=schema_id
            )
        data = json.dumps(message, ensure_ascii=False, separators=(",", ":")).encode()
        self._writer.add_message(self._channels[topic], log_time=stamp, publish_time=stamp, data=data)
