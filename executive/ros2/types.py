"""Messages of ROS 2 as Python objects and as bytes (CDR), by the library `rosbags`: the extra `ros2`.

A message is written by its fields as plain values: mappings for messages, lists for arrays. What is missing has its
zero, as in ROS 2 itself.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np

from executive.extras import need
from executive.ros2.definitions import OTHERS, POMONA

EXTRA = "ros2"

_ARRAYS = {
    "bool": np.bool_, "byte": np.uint8, "char": np.uint8, "float32": np.float32, "float64": np.float64,
    "int8": np.int8, "uint8": np.uint8, "int16": np.int16, "uint16": np.uint16, "int32": np.int32,
    "uint32": np.uint32, "int64": np.int64, "uint64": np.uint64,
}  # fmt: skip


@cache
def typestore() -> Any:
    """All types: ROS 2 Jazzy's, ours, and those of packages that are not part of it.

    Raises:
        UsageError: the extra is not installed.
    """
    typesys = need("rosbags.typesys", EXTRA, "ROS 2")
    store = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
    found: dict[str, Any] = {}
    for name, text in {**OTHERS, **POMONA}.items():
        found |= typesys.get_types_from_msg(text, name)
    store.register(found)
    return store


class Coder:
    """Makes messages of one type from plain values."""

    def __init__(self, name: str) -> None:
        """
        Args:
            name: `sensor_msgs/msg/JointState`.

        Raises:
            UsageError: the extra is not installed.
        """
        self.name = name
        self._make = _maker(name)

    def message(self, fields: Mapping[str, Any]) -> Any:
        """The message.

        Raises:
            KeyError: a field that the type does not have.
        """
        return self._make(fields)

    def coded(self, fields: Mapping[str, Any]) -> bytes | memoryview:
        """The message as CDR, little endian, with its encapsulation header."""
        coded: bytes | memoryview = typestore().serialize_cdr(self._make(fields), self.name)
        return coded


@cache
def coder(name: str) -> Coder:
    """The coder of a type."""
    return Coder(name)


@cache
def _maker(name: str) -> Any:
    store = typestore()
    _constants, fields = store.fielddefs[name]
    cls = store.types[name]
    steps = [(field, *_step(kind, what)) for field, (kind, what) in fields]
    names = {field for field, _step, _zero in steps}

    def make(given: Mapping[str, Any]) -> Any:
        if not given.keys() <= names:
            raise KeyError(f"{name} has no field {', '.join(sorted(given.keys() - names))}")
        return cls(*[step(given[field]) if field in given else zero() for field, step, zero in steps])

    return make


def _step(kind: Any, what: Any) -> tuple[Any, Any]:
    """How a field's value is made of a plain one, and its zero."""
    if kind == 1:  # of a basic type
        return _basic(what[0])
    if kind == 2:  # a message
        make = _maker(what)
        return make, lambda: make({})
    inner, size = what
    length = size if kind == 3 else 0  # an array has its length, a sequence any
    if inner[0] == 1 and inner[1][0] in _ARRAYS:
        dtype = _ARRAYS[inner[1][0]]
        return (lambda value: _array(value, dtype)), (lambda: np.zeros(length, dtype))
    make, zero = _step(*inner)
    return (lambda value: [make(item) for item in value]), (lambda: [zero() for _ in range(length)])


def _basic(kind: str) -> tuple[Any, Any]:
    if kind in ("string", "wstring"):
        return str, str
    if kind == "bool":
        return bool, bool
    return (float, float) if kind.startswith("float") else (int, int)


def _array(value: Any, dtype: Any) -> Any:
    if isinstance(value, (bytes, bytearray, memoryview)):
        return np.frombuffer(value, dtype)
    return np.ascontiguousarray(value, dtype).reshape(-1)
