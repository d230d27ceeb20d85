"""One event as one JSON object, or the error in its place: on `/events` of a record, on the live stream, in a replay.

An image travels apart from its event: as a message of its own in a record, as a data URL on the live stream.

The record, the page and the live views all use it, so that they show the same run.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from pomona.executive.encode import field_names, plain
from pomona.executive.errors import PomonaError
from pomona.executive.running.events import (
    AttemptEnded,
    ErrorRaised,
    Event,
    NodeChanged,
    PortWritten,
    Published,
)
from pomona.executive.running.tick import BREAK_ACTIONS
from pomona.executive.values.sentences import sentence_of
from pomona.executive.views import ImageView

VIEW = 4_000_000
PART = 48
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
        case {"event": "TreeChanged" | "StateChanged" | "SafeStopped" | "RunEnded" as kind}:
            return (kind,)
    return None


class UnencodableError(PomonaError):
    """A value that cannot be recorded or shown.

    Attributes:
        node: path of the node that it came from; empty for the run itself.
        what: the published topic, the written name, or the kind of the event.
    """

    def __init__(self, node: str, what: str, why: str) -> None:
        self.node = node
        self.what = what
        self.why = why
        super().__init__(f"{what} of {node or 'the run'} cannot be encoded: {why}")


def refuse(taken: Any, error: BaseException) -> UnencodableError:
    """Name an event, or readings (t, tick, by device), that raised this error while it was encoded."""
    match taken:
        case Published():
            node = taken.node
            what = f"'{taken.topic}'" if isinstance(taken.topic, str) else "a published value"
        case PortWritten():
            node = taken.writer
            what = f"'{taken.key}'"
        case NodeChanged() | AttemptEnded():
            node = taken.path
            what = type(taken).__name__
        case Event():
            node = ""
            what = type(taken).__name__
        case _:
            node = ""
            what = "measurements"
    return UnencodableError(node, what, sentence_of(error))


def in_place_of(taken: Any, refused: UnencodableError) -> ErrorRaised:
    """Return the event that replaces a refused one."""
    t, tick = (taken.t, taken.tick) if isinstance(taken, Event) else taken[:2]
    return ErrorRaised(
        t, tick, refused.node, "telling of the run", type(refused).__name__, str(refused), "", ""
    )
