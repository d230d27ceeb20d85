"""A record back to the events of its run."""

from __future__ import annotations

import base64
import difflib
import json
import struct
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO

import cv2
import numpy as np
from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader

from executive.errors import UsageError
from executive.recording.decode import ForeignRecordError, event_from
from executive.recording.recorder import EVENTS, EVENTS_FILE
from executive.running.events import Event, Published
from executive.views import ImageView

MAGIC = b"\x89MCAP0\r\n"


def find_record(name: str, root: Path) -> Path:
    """The folder of a record: a path (of a folder or of an MCAP file), a name below `root`, or `last`.

    Raises:
        UsageError: there is none; says what there is.
    """
    records = sorted(path.parent for path in root.glob(f"*/{EVENTS_FILE}"))
    if name == "last":
        if not records:
            raise UsageError(f"no records in {root}: `pomona run` leaves one, --record names another folder")
        return records[-1]
    for path in (Path(name), root / name):
        if (path / EVENTS_FILE).is_file():
            return path
        if path.is_file():
            return path.parent if path.name == EVENTS_FILE else path
    alike = [record.name for record in records if record.name.startswith(name)]
    if len(alike) == 1:
        return root / alike[0]
    close = alike[-5:] or difflib.get_close_matches(name, [record.name for record in records], n=3, cutoff=0.5)
    hint = f"did you mean {', '.join(close)}?" if close else f"`pomona runs list --record {root}` lists them"
    raise UsageError(f"no record '{name}' in {root}: {hint}")


def events_file(record: Path) -> Path:
    """The MCAP file of a record: of a folder, or the file itself."""
    return record / EVENTS_FILE if record.is_dir() else record


def read_events(record: Path) -> Iterator[Event]:
    """The events in the order in which they happened, with their images.

    A record that was cut off gives the events up to there.

    Raises:
        UsageError: the file is not a record.
    """
    path = events_file(record)
    pixels: dict[str, Any] = {}
    for topic, data in messages(path):
        try:
            if topic.startswith(("/images/", "/depth/")):
                pixels[topic] = decode_image(json.loads(data)["data"])
            elif topic == EVENTS:
                event = event_from(json.loads(data))
                if isinstance(event, Published) and isinstance(event.value, ImageView):
                    image, depth = pixels.pop(f"/images/{event.topic}", None), pixels.pop(f"/depth/{event.topic}", None)
                    metres = None if depth is None else depth.astype(np.float32) * np.float32(1e-3)
                    event = replace(event, value=replace(event.value, image=image, depth=metres))
                yield event
        except (ForeignRecordError, ValueError, KeyError, TypeError) as error:
            raise UsageError(f"{path}: not a record of a run: {error}") from error


def messages(path: Path) -> Iterator[tuple[str, bytes]]:
    """(topic, content) of every message of an MCAP file as far as it is whole.

    Raises:
        UsageError: it is no MCAP file, or cannot be read.
    """
    try:
        with path.open("rb") as stream:
            if not has_begun(path, stream):
                return
            stream.seek(0)
            for _schema, channel, message in NonSeekingReader(stream).iter_messages(log_time_order=False):
                yield channel.topic, message.data
    except (McapError, EOFError, struct.error):
        return  # cut off
    except (ValueError, KeyError) as error:
        raise UsageError(f"{path}: not a record of a run: it is damaged ({error})") from error
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror}") from error


def has_begun(path: Path, stream: BinaryIO) -> bool:
    """Whether the head of an MCAP file stands in the stream; False when the process was killed before that.

    Raises:
        UsageError: it is no MCAP file.
    """
    start = stream.read(len(MAGIC))
    if start != MAGIC and not MAGIC.startswith(start):
        raise UsageError(f"{path}: not a record of a run: it is no MCAP file")
    return start == MAGIC


def decode_image(text: str) -> np.ndarray[Any, Any]:
    """A JPEG as RGB (h, w, 3) uint8, a PNG of depth as (h, w) uint16 [mm].

    Raises:
        ValueError: it is neither.
    """
    coded = np.frombuffer(base64.b64decode(text), np.uint8)
    image = cv2.imdecode(coded, cv2.IMREAD_UNCHANGED) if coded.size else None
    if image is None:
        raise ValueError("an image cannot be decoded")
    rgb: np.ndarray[Any, Any] = image[..., ::-1] if image.ndim == 3 else image
    return rgb
