"""Read the events of a run from its record: the inverse of `pomona.executive.encode`.

A record may come from any source. Every field is checked for its type, so readers of events need no check of their own.
"""

from __future__ import annotations

import base64
import binascii
import dataclasses
import types
import typing
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pomona.executive import views
from pomona.executive.errors import PomonaError, UsageError
from pomona.executive.images import from_file
from pomona.executive.ports import without_alias
from pomona.executive.recording.digest import tree_of
from pomona.executive.recording.folder import EVENTS, events_file
from pomona.executive.recording.plain_file import moment_of, parse_object
from pomona.executive.recording.scan import scan
from pomona.executive.recording.typed import checked, hints_of, typed
from pomona.executive.running import events
from pomona.executive.running.events import Event, Published
from pomona.executive.values.image_bytes import size_of_image
from pomona.executive.views import ImageView

_EVENTS = {
    c.__name__: c for c in vars(events).values() if isinstance(c, type) and issubclass(c, Event)
}
_VIEWS = {
    c.__name__: c
    for c in vars(views).values()
    if isinstance(c, type) and dataclasses.is_dataclass(c)
}


class ForeignRecordError(PomonaError):
    """The file is not the record of a run of Pomona."""


def event_from(message: Any) -> Event:
    """Return the event of a message in a record. Values of ports stay plain; views become views again.

    Raises ForeignRecordError: no event has this name, or a field has a wrong type.
    """
    name = message.get("event") if isinstance(message, Mapping) else None
    cls: Any = _EVENTS.get(name) if isinstance(name, str) else None
    if cls is None:
        raise ForeignRecordError(f"'{str(name)[:60]}' is no event of a run")
    hints = hints_of(cls)
    try:
        event: Event = cls(
            **{
                key: _value(cls, key, hints[key], value)
                for key, value in message.items()
                if key in hints
            }
        )
        return event
    except (TypeError, ValueError, KeyError, IndexError, AttributeError, OverflowError) as error:
        raise ForeignRecordError(f"an event {name} cannot be read: {error}") from error


def _value(cls: type, key: str, hint: Any, value: Any) -> Any:
    if cls is events.Published and key == "value":
        return _view(value) if isinstance(value, Mapping) and value.get("type") in _VIEWS else value
    if cls in (events.RunStarted, events.TreeChanged) and key == "nodes":
        return tuple(tree_of(value))
    if cls is events.RunStarted and key == "wall_time":
        return moment_of(value)
    return typed(hint)(value)


def _view(value: Mapping[str, Any]) -> Any:
    cls = _VIEWS[value["type"]]
    hints = hints_of(cls)
    return cls(**{key: _field(hints[key], item) for key, item in value.items() if key != "type"})


def _field(hint: Any, value: Any) -> Any:
    if value is None:
        return None
    if isinstance(value, Mapping) and value.get("type") in _VIEWS:
        return _view(value)
    hint = without_alias(hint)
    origin = typing.get_origin(hint)
    if origin in (types.UnionType, typing.Union):
        return _field(next(h for h in typing.get_args(hint) if h is not type(None)), value)
    if isinstance(value, np.ndarray):  # the recorder checks a view before it is encoded
        return value
    if origin is np.ndarray:
        dtype = typing.get_args(typing.get_args(hint)[1])[0]
        array = np.array(
            [
                [np.nan if x is None else x for x in row] if isinstance(row, list) else row
                for row in value
            ]
        )
        return array.astype(dtype) if array.size else np.empty((0, 2), dtype)
    if origin is tuple:
        inner = typing.get_args(hint)[0]
        return tuple(_field(inner, item) for item in checked(value, list))
    if hint in (str, bool, int, float):
        return typed(hint)(value)
    if isinstance(value, Mapping):
        inner = typing.get_args(hint)[1] if len(typing.get_args(hint)) == 2 else Any
        return {key: _field(inner, item) for key, item in value.items()}
    return value


# largest image that is decoded [pixels]: a few kilobytes may decode to gigabytes
MOST_PIXELS = 50_000_000


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
                    image = pixels.pop(f"/images/{event.topic}", None)
                    depth = pixels.pop(f"/depth/{event.topic}", None)
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
