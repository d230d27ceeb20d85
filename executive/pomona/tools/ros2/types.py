"""Messages of ROS 2 as Python objects and as bytes (CDR), by the library `rosbags`: the extra `ros2`.

A message is written by its fields as plain values: mappings for messages, lists for arrays. A missing field is
zero, as in ROS 2.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np

from pomona.executive.values.installation import need
from pomona.tools.ros2.definitions import ACTIONS, OTHERS, POMONA, SERVICES

EXTRA = "ros2"

_TEXTS = ("string", "wstring")
_BYTES = {"byte": "uint8", "char": "uint8"}


@cache
def typestore() -> Any:
    """Return all types: ROS 2 Jazzy's, ours, and those of packages that are not part of it.

    Raises UsageError: the extra is not installed.
    """
    typesys = need("rosbags.typesys", EXTRA, "ROS 2")
    store = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
    found: dict[str, Any] = {}
    for name, text in {**OTHERS, **POMONA, **ACTIONS}.items():
        found |= typesys.get_types_from_msg(text, name)
    for name, (request, response) in SERVICES.items():
        found |= service_types(name, request, response)
    store.register(found)
    # In ROS 2's own language `char` is uint8, and services' hashes are made of that; rosbags has it as a character.
    constants, parts = store.fielddefs[_INFO]
    as_bytes = [
        (name, _renamed(kind, "char", "uint8") if name == "client_gid" else kind)
        for name, kind in parts
    ]
    store.fielddefs = {**store.fielddefs, _INFO: (constants, as_bytes)}
    return store


_INFO = "service_msgs/msg/ServiceEventInfo"


def service_types(name: str, request: str, response: str) -> Any:
    """Return the types of a service from its two halves. The whole is never sent: its hash is the service's."""
    typesys = need("rosbags.typesys", EXTRA, "ROS 2")
    event = f"service_msgs/ServiceEventInfo info\n{name}_Request[<=1] request\n{name}_Response[<=1] response\n"
    whole = f"{name}_Request request_message\n{name}_Response response_message\n{name}_Event event_message\n"
    found: dict[str, Any] = {}
    for ending, text in {
        "_Request": request,
        "_Response": response,
        "_Event": event,
        "": whole,
    }.items():
        found |= _renamed(typesys.get_types_from_msg(text, f"{name}{ending}"))
    return found


def _renamed(parsed: Any, old: str = "/srv/msg/", new: str = "/srv/") -> Any:
    """Other names in a parsed definition: rosbags takes a service's parts for messages of a package `…/srv`."""
    if isinstance(parsed, str):
        return parsed.replace(old, new)
    if isinstance(parsed, Mapping):
        return {_renamed(key, old, new): _renamed(value, old, new) for key, value in parsed.items()}
    return (
        type(parsed)(_renamed(part, old, new) for part in parsed)
        if type(parsed) in (tuple, list)
        else parsed
    )


class Coder:
    """Makes messages of one type from plain values."""

    def __init__(self, name: str) -> None:
        """Find a type by its name, `sensor_msgs/msg/JointState`. Raises UsageError: the extra is not installed."""
        self.name = name
        self._make = _maker(name)

    def message(self, fields: Mapping[str, Any]) -> Any:
        """Return the message. Raises KeyError: a field that the type does not have."""
        return self._make(fields)

    def coded(self, fields: Mapping[str, Any]) -> bytes | memoryview:
        """Return the message as CDR, little endian, with its encapsulation header."""
        coded: bytes | memoryview = typestore().serialize_cdr(self._make(fields), self.name)
        return coded


@cache
def coder(name: str) -> Coder:
    """Return the coder of a type."""
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
        return cls(
            *[step(given[field]) if field in given else zero() for field, step, zero in steps]
        )

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
    if inner[0] == 1 and inner[1][0] not in _TEXTS:
        name = inner[1][0]
        dtype = np.dtype(_BYTES.get(name, name))
        return (lambda value: _array(value, dtype)), (lambda: np.zeros(length, dtype))
    make, zero = _step(*inner)
    return (lambda value: [make(item) for item in value]), (lambda: [zero() for _ in range(length)])


def _basic(kind: str) -> tuple[Any, Any]:
    if kind in _TEXTS:
        return str, str
    if kind == "bool":
        return bool, bool
    return (float, float) if kind.startswith("float") else (int, int)


def _array(value: Any, dtype: Any) -> Any:
    if isinstance(value, (bytes, bytearray, memoryview)):
        return np.frombuffer(value, dtype)
    return np.ascontiguousarray(value, dtype).reshape(-1)
