"""JSON that somebody else may have written: no depth, no number and no name in it stops a reader."""

from __future__ import annotations

import contextlib
import json
import math
import re
from typing import Any

import orjson

MOST_DEPTH = 200
"""Objects and lists within one another. A chain of reasons takes two for each node on its way up a tree."""

LONGEST = 1e12
"""Largest time, of a run or since 1970, that is believed [s]: 30 000 years."""

_STRINGS = re.compile(rb'"(?:[^"\\]|\\.)*"', re.DOTALL)
_HUGE = re.compile(rb"[eE]\+?\d{3}")
_HALF = re.compile(rb"\\u[dD][89a-fA-F]")


def parse(content: bytes | str) -> Any:
    """The value; NaN and infinities, which JSON does not have, are None; halves of characters become "?".

    Raises:
        ValueError: it is no JSON, or deeper than `MOST_DEPTH`.
    """
    if not isinstance(content, (bytes, str)):
        raise ValueError("a text is expected here")
    coded = content.encode(errors="replace") if isinstance(content, str) else content
    if is_deep(coded):
        raise ValueError(f"objects within objects, more than {MOST_DEPTH} deep")
    with contextlib.suppress(ValueError):
        return orjson.loads(coded)  # it refuses whatever the lines below repair
    hooks: dict[str, Any] = {"parse_float": _finite} if _HUGE.search(coded) else {}
    try:
        value = json.loads(coded.decode(errors="replace"), parse_constant=lambda _name: None, parse_int=_whole, **hooks)
    except RecursionError as error:  # what is_deep took for a string
        raise ValueError("objects within objects, too deep") from error
    if _HALF.search(coded) is None:
        return value
    return json.loads(json.dumps(value, ensure_ascii=False).encode(errors="replace"))


def parse_object(content: bytes | str) -> dict[str, Any]:
    """The object.

    Raises:
        ValueError: it is none.
    """
    value = parse(content)
    if not isinstance(value, dict):
        raise ValueError(f"an object is expected here, not {str(value)[:40]!r}")
    return value


def is_deep(content: bytes) -> bool:
    """Whether a text goes deeper than `MOST_DEPTH`."""
    if content.count(b"{") + content.count(b"[") <= MOST_DEPTH:
        return False
    import numpy as np  # few texts come as far as here, and who lists runs need not load it

    step = np.zeros(256, np.int8)
    step[[ord("["), ord("{")]], step[[ord("]"), ord("}")]] = 1, -1
    steps = step[np.frombuffer(_STRINGS.sub(b"", content), np.uint8)]
    return bool(np.cumsum(steps, dtype=np.int64).max(initial=0) > MOST_DEPTH)


def _whole(digits: str) -> int | float | None:
    """A whole number; one of more digits than any counter has is read as a float, in linear time."""
    return int(digits) if len(digits) <= 20 else _finite(digits)


def _finite(digits: str) -> float | None:
    value = float(digits)
    return value if math.isfinite(value) else None
