"""Events as versioned JSON messages: the live stream's schema (docs/live_stream.md).

A message is an object with `v` (version of the schema), `seq` (counts up from 1 within a run), `event` (its name)
and the event's fields. Images travel as JPEG data URLs.
"""

from __future__ import annotations

import base64
import dataclasses
import json
from typing import Any

import numpy as np

from pomona.executive.dashboard.cloud import cloud_of
from pomona.executive.encode import plain
from pomona.executive.errors import PomonaError
from pomona.executive.images import shrunk, to_jpeg
from pomona.executive.running.events import Event, PortWritten, Published
from pomona.executive.views import ImageView

VERSION = 1
MOST_SCENE_ELEMENTS = 60_000
"""Larger arrays in a view are described instead of sent: no browser draws them in time."""


MOST_TEXT = 32_000_000
"""Largest message [characters]."""


def encode_number(seq: int) -> bytes:
    """How every message begins."""
    return b'{"v":%d,"seq":%d,' % (VERSION, seq)


def message(event: str, **fields: Any) -> str:
    """A message without number as text; numbers that are not finite are null."""
    return json.dumps({"v": VERSION, "event": event, **plain(fields)}, ensure_ascii=False, allow_nan=False)


def encode(event: Event, seq: int) -> str:
    """One event as the text of one message.

    Raises:
        PomonaError: it is larger than `MOST_TEXT`. What cannot be encoded may raise anything.
    """
    fields: dict[str, Any] = {"v": VERSION, "seq": seq, "event": type(event).__name__}
    for field in dataclasses.fields(event):
        value = getattr(event, field.name)
        if isinstance(event, Published) and field.name == "value":
            fields["value"] = _view(value)
        elif isinstance(event, PortWritten) and field.name == "value":
            fields["value"] = plain(value, arrays=16, depth=4)
        else:
            fields[field.name] = plain(value)
    text = json.dumps(fields, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
    if len(text) > MOST_TEXT:
        raise PomonaError(f"{len(text) / 1e6:.0f} MB of text; at most {MOST_TEXT / 1e6:.0f} MB are shown")
    return text


def _view(value: Any) -> Any:
    if isinstance(value, ImageView) and value.image is not None:
        message = plain(dataclasses.replace(value, image=None), arrays=MOST_SCENE_ELEMENTS)
        message.pop("depth", None)
        message["image"] = _data_url(value.image)
        if (cloud := cloud_of(value)) is not None:
            message["cloud"] = cloud
        message["size"] = [value.image.shape[1], value.image.shape[0]]
        return message
    return _rounded(plain(value, arrays=MOST_SCENE_ELEMENTS))


def _rounded(value: Any) -> Any:
    """Five digits are more than a screen shows, and a third of the bytes."""
    if isinstance(value, float):
        return float(f"{value:.6g}")
    if isinstance(value, list):
        return [_rounded(item) for item in value]
    if isinstance(value, dict):
        return {key: _rounded(item) for key, item in value.items()}
    return value


def picture_message(device: str, image: np.ndarray[Any, Any], age: float) -> dict[str, Any]:
    """A camera's newest image as the fields of a `Picture`: small, since it comes twice a second."""
    height, width = image.shape[:2]
    return {"device": device, "image": _data_url(image, 640), "size": [width, height], "age": round(age, 3)}


def _data_url(image: np.ndarray[Any, Any], widest: int = 960) -> str:
    scale = widest / max(image.shape[1], widest)
    if scale < 1.0:
        image = shrunk(image, scale)
    return "data:image/jpeg;base64," + base64.b64encode(to_jpeg(image, 80)).decode()
