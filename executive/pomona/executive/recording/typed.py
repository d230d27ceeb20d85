"""Values of JSON checked by the types of a dataclass's fields: a record and an index may come from any source."""

from __future__ import annotations

import types
import typing
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

from pomona.executive.ports import without_alias
from pomona.executive.reasons import DEEPEST_CAUSE, MOST_CAUSES, Reason
from pomona.executive.recording.plain_file import LONGEST


@cache
def hints_of(cls: Any) -> dict[str, Any]:
    """Return the types of a class's fields by name."""
    return typing.get_type_hints(cls)


@cache
def typed(hint: Any) -> Callable[[Any], Any]:
    """Return the decoder of a field with this type; it raises TypeError for a wrong value."""
    hint = without_alias(hint)
    if hint is Any:
        return lambda value: value
    if hint is float:
        return number_of
    origin = typing.get_origin(hint) or hint
    if origin in (types.UnionType, typing.Union):
        inner = typed(next(h for h in typing.get_args(hint) if h is not type(None)))
        return lambda value: None if value is None else inner(value)
    if hint is Reason:
        return reason_from
    if origin is Mapping:
        of = typing.get_args(hint)[1]
        return lambda value: {key: typed(of)(item) for key, item in checked(value, Mapping).items()}
    return lambda value: checked(value, origin)


def checked(value: Any, kind: Any) -> Any:
    """Return the value. Raises TypeError: it is of another kind."""
    if not isinstance(value, kind) or (kind is int and isinstance(value, bool)):
        raise TypeError(f"{str(value)[:40]!r} stands where {kind.__name__} is expected")
    return value


def number_of(value: Any) -> float:
    """Return a float; a value that was not finite is null in a record and becomes zero.

    Raises TypeError: it is no number, or too large.
    """
    if value is None:
        return 0.0
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) <= LONGEST:
        raise TypeError(
            f"{str(value)[:40]!r} stands where a number is expected, {LONGEST:g} at most"
        )
    return float(value)


def reason_from(value: Any) -> Reason:
    """Return a reason with all its causes.

    Raises:
        TypeError, KeyError: the value is no reason.
        ValueError: it has too many causes, or they are nested too deeply.
    """
    return _reason(value, 0, [MOST_CAUSES])


def _reason(value: Any, depth: int, left: list[int]) -> Reason:
    left[0] -= 1
    if depth > DEEPEST_CAUSE or left[0] < 0:
        raise ValueError(
            f"a reason with causes more than {DEEPEST_CAUSE} deep, or more than {MOST_CAUSES}"
        )
    path, code, message = (checked(value[key], str) for key in ("node_path", "code", "message"))
    causes = tuple(_reason(cause, depth + 1, left) for cause in checked(value["causes"], list))
    return Reason(path, code, message, checked(value["data"], Mapping), causes)
