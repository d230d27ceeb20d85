"""One event as one JSON object: on `/events` of a record, on the live stream and in a replay.

An image travels apart from its event: as a message of its own in a record, as a data URL on the live stream.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from pomona.executive.encode import field_names, plain
from pomona.executive.running.breakpoints import BREAK_ACTIONS
from pomona.executive.running.events import Event, Published
from pomona.executive.views import ImageView

VIEW, PART = 4_000_000, 48
"""Largest array that is written out, in a view and in other values [elements]. 48 covers poses, covariances and joints;
the joint solutions of thirty candidates would be half of a pick's record."""

Key = tuple[str, ...]  # kind of a message, or of its view, and its subject


def message_of(event: Event, views: int = VIEW) -> dict[str, Any]:
    """Return an event as an object for `pomona.executive.encode.encoded`, without the pixels of an image.

    Larger arrays of a view than `views` [elements] are described instead.
    """
    if isinstance(event, Published) and isinstance(event.value, ImageView):
        event = replace(event, value=replace(event.value, image=None, depth=None))
    limit = views if isinstance(event, Published) else PART
    message: dict[str, Any] = {"event": type(event).__name__}
    for name in field_names(type(event)):
        message[name] = plain(getattr(event, name), arrays=limit, keep=True)
    return message


def key_of(message: Mapping[str, Any]) -> Key | None:
    """Return the key of a message that replaces earlier ones of the same key; None if it replaces none."""
    match message:
        case {"event": "NodeChanged" | "AttemptEnded" as kind, "path": str(about)}:
            return kind, about
        case {"event": "PortWritten" as kind, "key": str(about)}:
            return kind, about
        case {"event": "Computed" as kind, "node": str(about)}:
            return kind, about
        case {"event": "LinkChanged" as kind, "device": str(about)}:
            return kind, about
        case {"event": "Published", "topic": str(about), "value": {"type": str(kind)}}:
            return kind, about
        case {"event": "OperatorActed" as kind, "action": str(action), "detail": str(about)}:
            if action in BREAK_ACTIONS:
                return kind, BREAK_ACTIONS[action][0], about
            return (kind, action) if action == "speed" else None
        case {"event": "StateChanged" | "SafeStopped" | "RunEnded" as kind}:
            return (kind,)
    return None
