"""Static types of values in a tree file, known before the run: of a port, or of a field of its value."""

from __future__ import annotations

import dataclasses
import types
import typing
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import cache
from typing import Any

from pomona.executive.ports import RATIO, Quantity, type_name, without_alias
from pomona.executive.values.units import Array, with_article


class Loose(Enum):
    """Types with less information than a port's type."""

    ANY = "anything"
    SI_NUMBER = "a number in SI"
    """A float field of a dataclass: the file does not state its unit, so it fits every quantity."""
    NONE = "nothing"


@dataclass(frozen=True, slots=True)
class ListType:
    """A list, tuple or array of values of one type."""

    element: ValueType  # its elements' type
    length: int | None = None  # how many there are, if that is always the same
    array: bool = False  # whether it is a numpy array


ValueType = type[Any] | Quantity | Loose | ListType
ANY = Loose.ANY
SI_NUMBER = Loose.SI_NUMBER
NONE = Loose.NONE


def describe(value_type: ValueType) -> str:
    """Name a type in messages: `a length`, `an int`, `a list of grasp`."""
    if isinstance(value_type, Loose):
        return value_type.value
    if isinstance(value_type, ListType):
        if value_type.array:
            return f"an array of {_counted(value_type)}"
        return "a list" if value_type.element is ANY else f"a list of {_bare(value_type.element)}"
    return with_article(type_name(value_type))


def _counted(value_type: ListType) -> str:
    """Return the elements of an array: `3 lengths`, `4 × 4 numbers`."""
    sizes = [value_type.length]
    element = value_type.element
    while isinstance(element, ListType):
        sizes.append(element.length)
        element = element.element
    noun = "number" if element is SI_NUMBER else _bare(element)
    plural = noun if noun.endswith("pixels") else f"{noun}{'es' if noun.endswith('s') else 's'}"
    return f"{' × '.join('…' if size is None else str(size) for size in sizes)} {plural}"


def _bare(value_type: ValueType) -> str:
    return describe(value_type).removeprefix("a ").removeprefix("an ")


def is_array(value_type: ValueType) -> bool:
    """Return True for numpy's array or its stand-in, recognized by name, since a check does not import numpy."""
    return isinstance(value_type, type) and (value_type.__module__, value_type.__name__) == (
        "numpy",
        "ndarray",
    )


def is_numeric(value_type: ValueType) -> bool:
    """Return True if a type can be calculated with."""
    return value_type in (int, float, SI_NUMBER, ANY) or isinstance(value_type, Quantity)


def can_flow(source: ValueType, target: ValueType) -> bool:
    """Return True if a value of type `source` may enter a port of type `target`."""
    if source is ANY or target is ANY or target is object or source == target:
        return True
    if isinstance(target, Quantity):
        return source is SI_NUMBER or (target == RATIO and source in (int, float))
    if target is float:
        return source in (int, SI_NUMBER) or source == RATIO
    if isinstance(source, ListType):
        if source.array:
            return is_array(target) or (
                isinstance(target, ListType) and can_flow(source.element, target.element)
            )
        if isinstance(target, ListType):
            return can_flow(source.element, target.element)
        return target in (list, tuple, Sequence)
    if isinstance(target, ListType):
        return (
            is_array(source)
            if target.array
            else isinstance(source, type) and issubclass(source, (list, tuple))
        )
    if isinstance(source, type) and isinstance(target, type):
        if source is bool or target is bool:
            return source is target
        return issubclass(source, target)
    return False


def comparable(left: ValueType, right: ValueType) -> bool:
    """Return True if `left == right` or `left < right` makes sense."""
    if can_flow(left, right) or can_flow(right, left) or NONE in (left, right):
        return True
    if SI_NUMBER in (left, right):
        return is_numeric(left) and is_numeric(right)
    if isinstance(left, type) and issubclass(left, Enum):
        return right is str
    if isinstance(right, type) and issubclass(right, Enum):
        return left is str
    return False


def element_type(container: ValueType) -> ValueType | None:
    """Return the type of an element; None when the type holds no elements."""
    if container is ANY:
        return ANY
    if isinstance(container, ListType):
        return container.element
    if isinstance(container, type):
        if container.__module__.split(".")[0] == "numpy":
            return ANY
        if issubclass(container, (list, tuple, dict)):
            return ANY
    return None


def fields_of(value_type: ValueType) -> dict[str, ValueType] | None:
    """Fields and properties of a class by name, with their types; None for types without fields or of any shape."""
    if not isinstance(value_type, type) or value_type in (bool, int, float, str, object):
        return {} if value_type is not ANY and value_type is not object else None
    cls: Any = value_type
    return dict(_fields_of_class(cls))


@cache
def _fields_of_class(cls: Hashable) -> tuple[tuple[str, ValueType], ...]:
    assert isinstance(cls, type)
    try:
        hints = typing.get_type_hints(cls, include_extras=True)
    except Exception:  # a third party's annotations may not resolve: names are still known
        classes = reversed(cls.__mro__)
        hints = {name: Any for base in classes for name in getattr(base, "__annotations__", ())}
    names = (
        [f.name for f in dataclasses.fields(cls)] if dataclasses.is_dataclass(cls) else list(hints)
    )
    found = {
        name: from_annotation(hints.get(name, Any)) for name in names if not name.startswith("_")
    }
    for name in dir(cls):
        member = getattr(cls, name, None)
        if isinstance(member, property) and not name.startswith("_"):
            found[name] = _returned(member)
    return tuple(found.items())


def _returned(member: property) -> ValueType:
    try:
        return from_annotation(
            typing.get_type_hints(member.fget, include_extras=True).get("return", Any)
        )
    except Exception:  # see above
        return ANY


def from_annotation(annotation: Any) -> ValueType:
    """Return the static type of an annotated field; `ANY` if there is no counterpart."""
    annotation = without_alias(annotation)
    origin = typing.get_origin(annotation)
    arguments = typing.get_args(annotation)
    if origin in (typing.Union, types.UnionType):
        kinds = [argument for argument in arguments if argument is not type(None)]
        return from_annotation(kinds[0]) if len(kinds) == 1 else ANY
    if origin is typing.Annotated:
        return _annotated_type(arguments)
    if annotation is float:
        return SI_NUMBER
    if origin in (list, tuple, Sequence):
        kinds = [argument for argument in arguments if argument is not Ellipsis]
        length = len(kinds) if origin is tuple and kinds and Ellipsis not in arguments else None
        same = bool(kinds) and all(k == kinds[0] for k in kinds)
        return ListType(from_annotation(kinds[0]) if same else ANY, length)
    if isinstance(origin, type):
        return origin
    if annotation is None or annotation is type(None):
        return NONE
    return annotation if isinstance(annotation, type) and annotation is not Any else ANY


def _annotated_type(arguments: tuple[Any, ...]) -> ValueType:
    """`Annotated[float, LENGTH]` is a length, `Annotated[NDArray, Array(3, of=LENGTH)]` three of them."""
    annotation, *said = arguments
    for word in said:
        if isinstance(word, Quantity) and annotation is float:
            return word
        if isinstance(word, Array):
            found: ValueType = word.of or SI_NUMBER
            for length in reversed(word.shape):
                found = ListType(found, length, array=True)
            return found
    return from_annotation(annotation)
