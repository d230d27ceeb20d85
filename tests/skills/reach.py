"""All that a skill can reach without a lease, by public names; each thing is tried to be changed.

A change counts only if it is there when the thing is looked up once more from the skill: a property that computes a new
array each time gives nothing away.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from types import BuiltinFunctionType, FunctionType, MethodType, ModuleType
from typing import Any

import numpy as np

from pomona.executive.values.read_only import LARGE

READINGS = ("state", "latest", "latest_depth", "in_hand")  # calls that measure and change nothing
OPAQUE = (
    str,
    bytes,
    int,
    float,
    complex,
    type,
    Enum,
    Path,
    ModuleType,
    type(None),
    np.generic,
    np.dtype,
    slice,
)
CALLS = (BuiltinFunctionType, FunctionType, MethodType)
DEEP = 8


@dataclass(frozen=True)
class Place:
    """A thing, and how it is looked up again."""

    path: str
    look_up: Callable[[], Any]


def changes(roots: Mapping[str, Callable[[], Any]]) -> list[str]:
    """Return the paths of all that could be changed, reached from these functions."""
    found: list[str] = []
    for place in places(roots):
        found += tried(place)
    return found


def places(roots: Mapping[str, Callable[[], Any]]) -> Iterator[Place]:
    """Yield everything that can be reached, each object once."""
    seen: dict[int, Any] = {}
    waiting = [(Place(name, look_up), 0) for name, look_up in roots.items()]
    while waiting:
        place, depth = waiting.pop()
        value = place.look_up()
        if isinstance(value, OPAQUE) or id(value) in seen:
            continue
        seen[id(value)] = value  # kept, so that no other gets its number
        yield place
        if depth < DEEP:
            waiting += [(inner, depth + 1) for inner in within(place, value)]


def within(place: Place, value: Any) -> Iterator[Place]:
    """Yield the things inside of a thing."""
    if isinstance(value, (np.ndarray, *CALLS)):
        return
    if isinstance(value, Mapping):
        for key in list(value):
            yield Place(f"{place.path}[{key!r}]", lambda key=key: place.look_up()[key])
        return
    if isinstance(value, (tuple, list)):
        for index in range(min(len(value), 3)):
            yield Place(f"{place.path}[{index}]", lambda index=index: place.look_up()[index])
    for name in public(value):
        yield Place(f"{place.path}.{name}", lambda name=name: getattr(place.look_up(), name))
        if name in READINGS:
            yield Place(
                f"{place.path}.{name}()", lambda name=name: getattr(place.look_up(), name)()
            )


def public(value: Any) -> list[str]:
    """Return its public names that have a value."""
    if isinstance(value, (tuple, list, set, frozenset)) and not hasattr(value, "_fields"):
        return []
    return [name for name in dir(value) if not name.startswith("_") and hasattr(value, name)]


def tried(place: Place) -> list[str]:
    """Return the changes of one thing that were there afterwards; they are taken back."""
    value = place.look_up()
    if isinstance(value, np.ndarray):
        return [f"{place.path}[...]"] if _writes(place, value) else []
    if isinstance(value, CALLS):
        return []
    if isinstance(value, (Mapping, list, set, bytearray)):
        return [f"{place.path} ({type(value).__name__})"] if _takes(place, value) else []
    return [f"{place.path}.{name} = …" for name in public(value) if _sets(place, value, name)]


def _writes(place: Place, array: np.ndarray[Any, Any]) -> bool:
    if not array.size:
        return False
    if not array.flags.writeable:
        if array.nbytes > LARGE:
            return False
        try:
            array.setflags(write=True)
        except ValueError:
            return False
    before = array.copy()
    array.reshape(-1)[0] = (
        1 - array.reshape(-1)[0] if array.dtype == np.bool_ else array.reshape(-1)[0] + 1
    )
    again = place.look_up()
    changed = again is array or not np.array_equal(again, before, equal_nan=True)
    array[...] = before
    return changed


def _takes(place: Place, value: Any) -> bool:
    add = {dict: lambda: value.__setitem__("planted", 0), list: lambda: value.append("planted")}
    add |= {set: lambda: value.add("planted"), bytearray: lambda: value.append(7)}
    try:
        add.get(type(value), lambda: value.__setitem__("planted", 0))()
    except (TypeError, AttributeError):
        return False
    there = len(place.look_up()) == len(value)
    value.pop("planted") if isinstance(value, dict) else value.remove(7) if isinstance(
        value, bytearray
    ) else None
    if isinstance(value, (list, set)):
        value.remove("planted")
    return there


def _sets(place: Place, value: Any, name: str) -> bool:
    marker, own = object(), name in getattr(value, "__dict__", {})
    before = getattr(value, name)
    try:
        setattr(value, name, marker)
    except (AttributeError, TypeError, ValueError):
        return False
    try:
        changed = getattr(place.look_up(), name) is marker
    except Exception:  # the change broke the way back to it
        changed = True
    if own or name not in getattr(value, "__dict__", {}):
        setattr(value, name, before)
    else:
        delattr(value, name)
    return changed
