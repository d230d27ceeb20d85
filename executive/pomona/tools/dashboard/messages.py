"""Events as versioned JSON messages: the live stream's schema (live_stream.md).

A message is an object with `v` (version of the schema), `seq` (counts up from 1 within a run), `event` (its name)
and the event's fields. Images travel as JPEG data URLs.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from pomona.executive.encode import encoded, plain
from pomona.executive.errors import PomonaError
from pomona.executive.images import shrunk, to_jpeg
from pomona.executive.recording.message import message_of
from pomona.executive.running.events import Event, Published
from pomona.executive.views import ImageView
from pomona.tools.dashboard.cloud import cloud_of

VERSION = 1
# larger arrays in a view are described instead of sent: no browser draws them in time
MOST_SCENE_ELEMENTS = 60_000
MOST_TEXT = 32_000_000  # largest message [bytes]


def message(event: str, **fields: Any) -> str:
    """Return a message without number as text; numbers that are not finite are null."""
    return json.dumps(
        {"v": VERSION, "event": event, **plain(fields)}, ensure_ascii=False, allow_nan=False
    )


def encode(event: Event, seq: int) -> str:
    """Encode one event as the text of one message.

    Raises PomonaError: it is larger than `MOST_TEXT`. An event that cannot be encoded may raise any exception.
    """
    return numbered(fields_of(event), seq).decode()


def fields_of(event: Event) -> dict[str, Any]:
    """One event as an object: as in a record, with its image as a data URL and without very large arrays."""
    fields = message_of(event, views=MOST_SCENE_ELEMENTS)
    view = event.value if isinstance(event, Published) else None
    if isinstance(view, ImageView) and view.image is not None:
        fields["value"] |= {
            "image": _data_url(view.image),
            "size": [view.image.shape[1], view.image.shape[0]],
        }
        if (cloud := cloud_of(view)) is not None:
            fields["value"]["cloud"] = cloud
    return fields


def numbered(fields: Mapping[str, Any], seq: int) -> bytes:
    """Return the text of an event's message: its object with the version of the schema and the event's number.

    Raises PomonaError: it is larger than `MOST_TEXT`.
    """
    text = encoded({"v": VERSION, "seq": seq, **fields})
    if len(text) > MOST_TEXT:
        raise PomonaError(
            f"{len(text) / 1e6:.0f} MB of text; at most {MOST_TEXT / 1e6:.0f} MB are shown"
        )
    return text


def picture_message(device: str, image: np.ndarray[Any, Any], age: float) -> dict[str, Any]:
    """Return a camera's newest image as the fields of a `Picture`: small, since it comes twice a second."""
    height, width = image.shape[:2]
    return {
        "device": device,
        "image": _data_url(image, 640),
        "size": [width, height],
        "age": round(age, 3),
    }


def _data_url(image: np.ndarray[Any, Any], widest: int = 960) -> str:
    scale = widest / max(image.shape[1], widest)
    if scale < 1.0:
        image = shrunk(image, scale)
    return "data:image/jpeg;base64," + base64.b64encode(to_jpeg(image, 80)).decode()
