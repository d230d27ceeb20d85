"""Plain JSON back to events, reasons and views: the inverse of `executive.encode` for what a record holds."""

from __future__ import annotations

import dataclasses
import types
import typing
from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np

from executive import views
from executive.errors import PomonaError
from executive.reasons import Reason
from executive.running import events
from executive.running.events import Event

_EVENTS = {c.__name__: c for c in vars(events).values() if isinstance(c, type) and issubclass(c, Event)}
_VIEWS = {c.__name__: c for c in vars(views).values() if isinstance(c, type) and dataclasses.is_dataclass(c)}


class ForeignRecordError(PomonaError):
    """The file holds something that is not a run of Pomona."""


def event_from(message: Mapping[str, Any]) -> Event:
    """One event from its message in a record. Values of ports stay plain; views are views again.

    Raises:
        ForeignRecordError: no event has this name, or its fields do not fit.
    """
    name = message.get("event")
    cls = _EVENTS.get(name) if isinstance(name, str) else None
    if cls is None:
        raise ForeignRecordError(f"'{name}' is no event of a run")
    known = {field.name for field in dataclasses.fields(cls)}
    try:
        return cls(**{key: _value(cls, key, value) for key, value in message.items() if key in known})
    except (TypeError, ValueError, KeyError) as error:
        raise ForeignRecordError(f"an event {name} cannot be read: {error}") from error


def _value(cls: type, key: str, value: Any) -> Any:
    if isinstance(value, Mapping) and value.get("type") == "Reason":
        return reason_from(value)
    if cls is events.Published and key == "value" and isinstance(value, Mapping) and value.get("type") in _VIEWS:
        return _view(value)
    if cls is events.RunStarted and key == "nodes":
        return tuple(value)
    return value


def reason_from(value: Mapping[str, Any]) -> Reason:
    """A reason with all its causes."""
    return Reason(
        value["node_path"], value["code"], value["message"], value["data"], tuple(map(reason_from, value["causes"]))
    )  # fmt: skip


def _view(value: Mapping[str, Any]) -> Any:
    cls = _VIEWS[value["type"]]
    hints = _hints(cls)
    return cls(**{key: _field(hints[key], item) for key, item in value.items() if key != "type"})


@cache
def _hints(cls: type) -> dict[str, Any]:
    return typing.get_type_hints(cls)


def _field(hint: Any, value: Any) -> Any:
    if value is None:
        return None
    if isinstance(value, Mapping) and value.get("type") in _VIEWS:
        return _view(value)
    origin = typing.get_origin(hint)
    if origin in (types.UnionType, typing.Union):
        return _field(next(h for h in typing.get_args(hint) if h is not type(None)), value)
    if origin is np.ndarray:
        dtype = typing.get_args(typing.get_args(hint)[1])[0]
        array = np.array([[np.nan if x is None else x for x in row] if isinstance(row, list) else row for row in value])
        return array.astype(dtype) if array.size else np.empty((0, 2), dtype)
    if origin is tuple:
        inner = typing.get_args(hint)[0]
        return tuple(_field(inner, item) for item in value)
    if isinstance(value, Mapping):
        inner = typing.get_args(hint)[1] if len(typing.get_args(hint)) == 2 else Any
        return {key: _field(inner, item) for key, item in value.items()}
    return value
