"""Read the events of a run from its record."""

from __future__ import annotations

import base64
import binascii
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pomona.executive.errors import UsageError
from pomona.executive.images import from_file
from pomona.executive.recording.decode import ForeignRecordError, event_from
from pomona.executive.recording.folder import EVENTS, events_file
from pomona.executive.recording.json_text import parse_object
from pomona.executive.recording.scan import scan
from pomona.executive.running.events import Event, Published
from pomona.executive.values.image_bytes import size_of_image
from pomona.executive.views import ImageView

MOST_PIXELS = 50_000_000  # largest image that is decoded [pixels]: a few kilobytes may decode to gigabytes


def read_events(record: Path) -> Iterator[Event]:
    """Yield the events in their order, with their images; of a record that was cut off, those up to there.

    Raises:
        DamagedRecordError: a part of the file is damaged; then no event is yielded.
        UsageError: the file is not a record.
    """
    path = events_file(record)
    pixels: dict[str, Any] = {}
    for topic, data, *_ in scan(path):
        try:
            if topic.startswith(("/images/", "/depth/")):
                if len(pixels) >= 64:  # largest number of images without their events
                    pixels.clear()
                pixels[topic] = decode_image(parse_object(data)["data"])
            elif topic == EVENTS:
                event = event_from(parse_object(data))
                if isinstance(event, Published) and isinstance(event.value, ImageView):
                    image, depth = pixels.pop(f"/images/{event.topic}", None), pixels.pop(f"/depth/{event.topic}", None)
                    metres = None if depth is None else depth.astype(np.float32) * np.float32(1e-3)
                    event = replace(event, value=replace(event.value, image=image, depth=metres))
                yield event
        except (ForeignRecordError, ValueError, KeyError, TypeError) as error:
            raise UsageError(f"{path}: not a record of a run: {error}") from error


def decode_image(text: str) -> np.ndarray[Any, Any]:
    """Return a JPEG as RGB (h, w, 3) uint8, a PNG of depth as (h, w) uint16 [mm].

    Raises:
        ValueError: the text is neither, or the image is larger than `MOST_PIXELS`.
    """
    try:
        coded = base64.b64decode(text)
    except (binascii.Error, TypeError) as error:
        raise ValueError("an image cannot be decoded") from error
    width, height = size_of_image(coded)
    if not 0 < width * height <= MOST_PIXELS:
        raise ValueError(f"an image of {width} × {height} pixels is not read")
    return from_file(coded)
