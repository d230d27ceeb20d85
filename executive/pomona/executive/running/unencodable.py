"""Replacement of an event that cannot be encoded: an error that names the node and the value.

The record, the page and the live views all use it, so that they show the same run.
"""

from __future__ import annotations

from typing import Any

from pomona.executive.errors import PomonaError
from pomona.executive.running.events import AttemptEnded, ErrorRaised, Event, NodeChanged, PortWritten, Published
from pomona.executive.values.sentences import sentence_of


class UnencodableError(PomonaError):
    """A value that cannot be recorded or shown.

    Attributes:
        node: path of the node that it came from; empty for the run itself.
        what: the published topic, the written name, or the kind of the event.
    """

    def __init__(self, node: str, what: str, why: str) -> None:
        self.node, self.what, self.why = node, what, why
        super().__init__(f"{what} of {node or 'the run'} cannot be encoded: {why}")


def refuse(taken: Any, error: BaseException) -> UnencodableError:
    """Name an event, or readings (t, tick, by device), that raised this error while it was encoded."""
    match taken:
        case Published():
            node, what = taken.node, f"'{taken.topic}'" if isinstance(taken.topic, str) else "a published value"
        case PortWritten():
            node, what = taken.writer, f"'{taken.key}'"
        case NodeChanged() | AttemptEnded():
            node, what = taken.path, type(taken).__name__
        case Event():
            node, what = "", type(taken).__name__
        case _:
            node, what = "", "measurements"
    return UnencodableError(node, what, sentence_of(error))


def in_place_of(taken: Any, refused: UnencodableError) -> ErrorRaised:
    """Return the event that replaces a refused one."""
    t, tick = (taken.t, taken.tick) if isinstance(taken, Event) else taken[:2]
    return ErrorRaised(t, tick, refused.node, "telling of the run", type(refused).__name__, str(refused), "", "")
