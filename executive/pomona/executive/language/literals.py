"""Literals: a text in the file → a value of the port's type, in SI."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Iterable
from enum import Enum
from typing import TYPE_CHECKING, Any

from pomona.executive.language.expression import UNITS
from pomona.executive.language.value_types import (
    ANY,
    SI_NUMBER,
    ListType,
    ValueType,
    describe,
    fields_of,
    is_array,
)
from pomona.executive.ports import ANGLE, LENGTH, Quantity
from pomona.executive.values.findings import did_you_mean
from pomona.executive.values.rotations import from_quaternion, from_rpy
from pomona.executive.values.units import is_number, split_unit
from pomona.executive.values.yaml_nodes import YamlList, YamlMapping, YamlNode, YamlScalar

if TYPE_CHECKING:  # numpy is imported where an array is read: most trees hold none
    import numpy as np
    from numpy.typing import NDArray

_INT = re.compile(r"[-+]?[0-9]{1,18}")


class LiteralError(ValueError):
    """A literal that is no value of the type; `where` is the node that is wrong."""

    def __init__(self, where: YamlNode, message: str, hint: str = "") -> None:
        self.where = where
        self.message = message
        self.hint = hint
        super().__init__(message)


def literal(node: YamlNode, value_type: ValueType, choices: Iterable[str] = ()) -> Any:
    """Return the value of a literal, in SI. Raises LiteralError: it is none of the type."""
    if isinstance(node, YamlScalar):
        return _scalar(node, value_type, tuple(choices))
    if isinstance(node, YamlList):
        return _list(node, value_type)
    if isinstance(node, YamlMapping):
        return _mapping(node, value_type)
    raise LiteralError(node, "this cannot be read as a value")


def scalar_of_any_type(node: YamlScalar) -> bool | int | float | str | None:
    """Read a scalar without a declared type: a boolean, a number, a quantity in SI, or a text.

    Raises LiteralError: it is a number or a quantity that is too large.
    """
    text = node.text
    if not node.plain:
        return text
    if node.is_null or text == "none":
        return None
    if text in ("true", "false"):
        return text == "true"
    if _INT.fullmatch(text):
        return int(text)
    number, unit = split_unit(text) or ("", "")
    if number and not unit:
        return _number(node, text)
    return _quantity(node, text, UNITS[unit][0]) if unit in UNITS else text


def _number(node: YamlScalar, text: str) -> float:
    """Convert a text to a number; refuse one that a float cannot hold instead of returning infinity."""
    value = float(text)
    if not math.isfinite(value):
        short = text if len(text) <= 24 else f"{text[:12]}…{text[-8:]}"
        raise LiteralError(node, f"'{short}' is too large for a number")
    return value


def _scalar(node: YamlScalar, value_type: Any, choices: tuple[str, ...]) -> Any:
    text = node.text.strip()
    if value_type is str:
        if node.is_null:
            raise LiteralError(
                node, "nothing stands here", "write a text, in quotes if it is to be empty"
            )
        if choices and text not in choices:
            hint = did_you_mean(text, choices) or "one of " + ", ".join(choices)
            raise LiteralError(node, f"'{text}' is not allowed here", hint)
        return node.text
    if isinstance(value_type, Quantity):
        return _quantity(node, text, value_type)
    if value_type in (ANY, object):
        return scalar_of_any_type(node)
    if value_type is bool:
        if text in ("true", "false"):
            return text == "true"
    elif value_type is int:
        if _INT.fullmatch(text):
            return int(text)
        if is_number(text):
            raise LiteralError(node, f"'{text}' is not a whole number")
    elif value_type is float:
        if is_number(text):
            return _number(node, text)
    elif value_type is SI_NUMBER:
        found = scalar_of_any_type(node)
        if isinstance(found, (int, float)) and not isinstance(found, bool):
            return float(found)
    elif isinstance(value_type, type) and issubclass(value_type, Enum):
        return _member(node, text, value_type)
    wanted = describe(value_type)
    if node.is_null:
        raise LiteralError(node, f"nothing stands here; {wanted} is needed")
    if isinstance(value_type, (ListType, type)) and value_type not in (bool, int, float):
        raise LiteralError(
            node, f"{wanted} is needed here, '{text}' is a word", f'wire a port: "{{{text}}}"'
        )
    hints: dict[object, str] = {
        bool: "write true or false",
        int: "write a whole number",
        float: "write a number",
    }
    raise LiteralError(node, f"'{text}' is not {wanted}", hints.get(value_type, ""))


def _quantity(node: YamlScalar, text: str, quantity: Quantity) -> float:
    if quantity.bare and is_number(text):
        return _number(node, text)
    try:
        return quantity.parse(text)
    except ValueError as error:
        raise LiteralError(node, str(error)) from None


def _member(node: YamlScalar, text: str, enum: type[Any]) -> Any:
    for member in enum:
        if text in (member.name, str(member.value)):
            return member
    words = [str(member.value) if isinstance(member.value, str) else member.name for member in enum]
    hint = did_you_mean(text, words) or "one of " + ", ".join(words)
    raise LiteralError(node, f"'{text}' is not {describe(enum)}", hint)


def _list(node: YamlList, value_type: ValueType) -> Any:
    if is_array(value_type):
        return _array(node)
    if isinstance(value_type, ListType):
        return tuple(literal(item, value_type.element) for item in node.items)
    if value_type in (ANY, object, tuple):
        return tuple(literal(item, ANY) for item in node.items)
    if value_type is list:
        return [literal(item, ANY) for item in node.items]
    raise LiteralError(node, f"{describe(value_type)} is needed here, this is a list")


def _array(node: YamlList) -> NDArray[np.float64]:
    import numpy as np

    from pomona.executive.values.read_only import read_only

    rows = [
        _array(item) if isinstance(item, YamlList) else literal(item, SI_NUMBER)
        for item in node.items
    ]
    try:
        array: NDArray[np.float64] = read_only(
            np.array(rows, dtype=np.float64)
        )  # shared by all starts of a node
        return array
    except ValueError:
        raise LiteralError(node, "the rows of this array have different lengths") from None


def _mapping(node: YamlMapping, value_type: ValueType) -> Any:
    if is_array(value_type):
        return _pose(node)
    if value_type in (ANY, object, dict):
        return {key.text: literal(value, ANY) for key, value in node.entries.values()}
    if isinstance(value_type, type) and dataclasses.is_dataclass(value_type):
        return _dataclass(node, value_type)
    raise LiteralError(node, f"{describe(value_type)} is needed here, this is a mapping")


def _dataclass(node: YamlMapping, cls: type[Any]) -> Any:
    types = fields_of(cls) or {}
    fields = {f.name: f for f in dataclasses.fields(cls) if f.init}
    given: dict[str, Any] = {}
    for key, value in node.entries.values():
        if key.text not in fields:
            hint = did_you_mean(key.text, fields) or "it has " + ", ".join(fields)
            raise LiteralError(key, f"{describe(cls)} has no field '{key.text}'", hint)
        given[key.text] = literal(value, types.get(key.text, ANY))
    needed = [
        name for name, f in fields.items() if f.default is f.default_factory is dataclasses.MISSING
    ]
    missing = [name for name in needed if name not in given]
    if missing:
        raise LiteralError(node, f"{describe(cls)} also needs {', '.join(missing)}")
    try:
        return cls(**given)
    except Exception as error:  # the class's own checks
        raise LiteralError(node, f"this is no {describe(cls).split(' ', 1)[-1]}: {error}") from None


def _pose(node: YamlMapping) -> NDArray[np.float64]:
    """`{position: [x, y, z], rpy: [roll, pitch, yaw]}` or with `quaternion: [x, y, z, w]` -> 4x4."""
    known = ("position", "rpy", "quaternion")
    for key, _ in node.entries.values():
        if key.text not in known:
            raise LiteralError(
                key,
                f"a pose has no '{key.text}'",
                did_you_mean(key.text, known) or "position and rpy",
            )
    if "rpy" in node.entries and "quaternion" in node.entries:
        raise LiteralError(node, "a pose has one orientation: rpy or quaternion")
    import numpy as np

    from pomona.executive.values.read_only import read_only

    T = np.eye(4)
    T[:3, 3] = _vector(node, "position", 3)
    if "rpy" in node.entries:
        T[:3, :3] = from_rpy(_vector(node, "rpy", 3))
    elif "quaternion" in node.entries:
        T[:3, :3] = _from_quaternion(_vector(node, "quaternion", 4), node)
    pose: NDArray[np.float64] = read_only(T)
    return pose


def _vector(node: YamlMapping, name: str, length: int) -> NDArray[np.float64]:
    written = node.get(name)
    if not isinstance(written, YamlList) or len(written.items) != length:
        raise LiteralError(written or node, f"a pose's {name} has {length} numbers")
    for item in written.items:
        found = scalar_type(item) if isinstance(item, YamlScalar) else None
        if isinstance(found, Quantity) and found != {"position": LENGTH, "rpy": ANGLE}.get(name):
            raise LiteralError(item, f"a pose's {name} takes no {found.name}")
    return _array(written)


def _from_quaternion(q: NDArray[np.float64], node: YamlNode) -> NDArray[np.float64]:
    norm = math.hypot(*q)
    if not 0.99 < norm < 1.01:
        raise LiteralError(node, f"a quaternion has length 1, this one {norm:.3g}")
    return from_quaternion(q)


def scalar_type(node: YamlScalar) -> ValueType:
    """Return the type of the value that `scalar_of_any_type` reads."""
    number, unit = (split_unit(node.text) if node.plain else None) or ("", "")
    if unit in UNITS:
        return UNITS[unit][0]
    if number and not unit and not _INT.fullmatch(node.text):
        return float  # also for one that is too large: reading its value reports that
    value = scalar_of_any_type(node)
    return ANY if value is None else type(value)


def type_word(node: YamlNode | None) -> str:
    """Return the name of a literal's type, for a declaration; empty if it is not a scalar with a value."""
    found = scalar_type(node) if isinstance(node, YamlScalar) and not node.is_null else ANY
    words: dict[ValueType, str] = {bool: "bool", int: "int", float: "number", str: "text"}
    return found.name if isinstance(found, Quantity) else words.get(found, "")
