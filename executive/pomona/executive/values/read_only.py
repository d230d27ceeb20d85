"""Values that nothing can change after their making: facts that all parts of a run share.

    @dataclass(frozen=True, slots=True, eq=False)
    class ArmLimits(ReadOnly):
        velocity: Float64

A frozen dataclass keeps its fields, not the content of an array in them. Those of `ReadOnly` keep both: a write raises
where it is made, and no view and no flag of an array gives the right to write back.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import fields
from functools import cache
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np

LARGE = 65_536
"""Size from which an array is marked as read-only in place, without a copy [bytes]: images and maps, which have one
owner. A copy of less takes some microseconds."""


_AS_THEY_ARE = frozenset(
    (float, int, bool, str, type(None))
)  # the most frequent types, found without base classes


def read_only(value: Any) -> Any:
    """Return a value whose arrays, containers and frozen dataclasses cannot be changed; others stay as they are.

    Lists become tuples, sets frozen sets, mappings read-only views of a copy. Their content is treated alike.
    """
    if type(value) in _AS_THEY_ARE:
        return value
    numpy = sys.modules.get("numpy")  # most trees hold no array
    if numpy is not None and isinstance(value, numpy.ndarray):
        return _array(value)
    if isinstance(value, tuple):
        if _AS_THEY_ARE.issuperset(map(type, value)):
            return value
        items = map(read_only, value)
        return type(value)(*items) if hasattr(value, "_fields") else tuple(items)
    if isinstance(value, Mapping):
        return MappingProxyType({key: read_only(item) for key, item in value.items()})
    if isinstance(value, list):
        return tuple(map(read_only, value))
    keep(value)
    return frozenset(value) if isinstance(value, set) else value


def shared(value: Any) -> Any:
    """Return a value of the board, which several skills read: no array and no frozen dataclass in it can be changed.

    Lists, sets and dictionaries keep their types and are copied; `own` gives each reader another copy.
    """
    return _copied(value, read_only)


def own(value: Any) -> Any:
    """Return a value with copies of its lists, sets and dictionaries: their reader may change them."""
    return _copied(value, lambda item: item)


def _copied(value: Any, convert: Callable[[Any], Any]) -> Any:
    kind = type(value)
    if kind in (list, set):
        return kind(_copied(item, convert) for item in value)
    if kind is dict:
        return {key: _copied(item, convert) for key, item in value.items()}
    return convert(value)


def keep(value: Any) -> None:
    """Make the fields of a frozen dataclass read-only, in place; another value stays as it is."""
    kind: Any = type(value)
    if isinstance(value, ReadOnly) or not is_frozen(kind):
        return
    for name in _names(type(value)):
        item = getattr(value, name)
        kept = read_only(item)
        if kept is not item:
            object.__setattr__(value, name, kept)


@cache
def is_frozen(kind: Any) -> bool:
    """Return True for a frozen dataclass."""
    return bool(getattr(getattr(kind, "__dataclass_params__", None), "frozen", False))


def _array(array: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    if array.nbytes > LARGE or array.dtype.hasobject:
        array.setflags(write=False)
        return array
    owner: Any = array.base
    # pickle gives writable arrays over bytes
    if isinstance(owner, bytes) and not array.flags.writeable:
        return array
    import numpy as np

    return np.ndarray(array.shape, array.dtype, array.tobytes())


@cache
def _fields(kind: Any) -> tuple[str, ...]:
    return tuple(field.name for field in fields(kind))


def _names(kind: Any) -> tuple[str, ...]:
    return _fields(kind)


class ReadOnly:
    """Base of frozen dataclasses whose arrays and containers are read-only: see `read_only`.

    A subclass with a `__post_init__` of its own calls this one. A copy in another process is read-only, too.
    """

    __slots__ = ()

    def __post_init__(self) -> None:
        for name in _names(type(self)):
            value = getattr(self, name)
            kept = read_only(value)
            if kept is not value:
                object.__setattr__(self, name, kept)

    def __reduce__(self) -> tuple[Any, ...]:
        return _anew, (
            type(self),
            {name: _picklable(getattr(self, name)) for name in _names(type(self))},
        )


def _anew(kind: Any, values: Mapping[str, Any]) -> Any:
    return kind(**values)


def _picklable(value: Any) -> Any:
    return dict(value) if isinstance(value, MappingProxyType) else value
