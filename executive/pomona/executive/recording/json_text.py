"""Parse JSON from any source: depth, numbers and names in it are bounded."""

from __future__ import annotations

import contextlib
import json
import math
import re
from typing import Any

import orjson

MOST_DEPTH = 200  # deepest nesting of objects and lists. A chain of reasons needs two levels per node up the tree.
LONGEST = 1e12  # largest valid number of seconds, of a run [s]: 30 000 years
LATEST = 253_370_764_800.0  # latest valid moment, since 1970 [s]: the year 9999, the last that can be written as a date

_STRINGS = re.compile(rb'"(?:[^"\\]|\\.)*"', re.DOTALL)
_HUGE = re.compile(rb"[eE]\+?\d{3}")
_HALF = re.compile(rb"\\u[dD][89a-fA-F]")


def parse(content: bytes | str) -> Any:
    """Return the value; NaN and infinity, which JSON lacks, become None, unpaired surrogates "?".

    Raises ValueError: the text is no JSON, or deeper than `MOST_DEPTH`.
    """
    if not isinstance(content, (bytes, str)):
        raise ValueError("a text is expected here")
    coded = content.encode(errors="replace") if isinstance(content, str) else content
    if is_deep(coded):
        raise ValueError(f"nested more than {MOST_DEPTH} levels deep")
    with contextlib.suppress(ValueError):
        return orjson.loads(coded)  # it refuses the cases that the lines below repair
    hooks: dict[str, Any] = {"parse_float": _finite} if _HUGE.search(coded) else {}
    try:
        value = json.loads(coded.decode(errors="replace"), parse_constant=lambda _name: None, parse_int=_whole, **hooks)
    except RecursionError as error:  # `is_deep` took a part for a string
        raise ValueError("nested too deep") from error
    if _HALF.search(coded) is None:
        return value
    return json.loads(json.dumps(value, ensure_ascii=False).encode(errors="replace"))


def parse_object(content: bytes | str) -> dict[str, Any]:
    """Return the object. Raises ValueError: the text is no object."""
    value = parse(content)
    if not isinstance(value, dict):
        raise ValueError(f"an object is expected here, not {str(value)[:40]!r}")
    return value


def moment_of(value: Any) -> float:
    """Return a moment in seconds since 1970; null becomes 0, unknown. Raises ValueError: it is none up to year 9999."""
    if value is None:
        return 0.0
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0.0 <= value <= LATEST:
        raise ValueError(f"{str(value)[:40]!r} stands where a moment in seconds since 1970 is expected")
    return float(value)


def is_deep(content: bytes) -> bool:
    """Return True for a text deeper than `MOST_DEPTH`."""
    if content.count(b"{") + content.count(b"[") <= MOST_DEPTH:
        return False
    import numpy as np  # rarely needed; a list of runs does without

    step = np.zeros(256, np.int8)
    step[[ord("["), ord("{")]], step[[ord("]"), ord("}")]] = 1, -1
    steps = step[np.frombuffer(_STRINGS.sub(b"", content), np.uint8)]
    return bool(np.cumsum(steps, dtype=np.int64).max(initial=0) > MOST_DEPTH)


def _whole(digits: str) -> int | float | None:
    """Return a whole number; one of more than 20 digits becomes a float, in linear time."""
    return int(digits) if len(digits) <= 20 else _finite(digits)


def _finite(digits: str) -> float | None:
    value = float(digits)
    return value if math.isfinite(value) else None
