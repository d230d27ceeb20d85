"""Any value of a run as plain JSON: for `--json`, recordings and the dashboard's stream."""

from __future__ import annotations

import dataclasses
import json
import math
import re
import sys
from collections.abc import Mapping
from enum import Enum
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import orjson

from pomona.executive.reasons import Reason, bounded

LARGE = 256  # arrays with more elements are described by shape and type, unless they are asked for

_ADDRESS = re.compile(
    r" at 0x[0-9a-f]+"
)  # address of an object in memory: differs between two equal runs


_ENCODABLE = frozenset(np.dtype(name) for name in ("float64", "int64", "int32", "uint8", "bool"))
"""Types of arrays of which `encoded` writes the same numbers as of lists; float32 would be written shorter."""


_AS_THEY_ARE = frozenset(
    (str, int, bool, type(None))
)  # the most frequent types, found without base classes


@cache
def _fields(kind: Any) -> tuple[str, ...] | None:
    """Return names of a dataclass's fields; None for any other class."""
    return (
        tuple(field.name for field in dataclasses.fields(kind))
        if dataclasses.is_dataclass(kind)
        else None
    )


def field_names(kind: Any) -> tuple[str, ...]:
    """Return names of a dataclass's fields, looked up once."""
    return _fields(kind) or ()


def plain(value: Any, *, arrays: int = LARGE, depth: int = 12, keep: bool = False) -> Any:
    """Convert a value to an equivalent JSON value.

    Dataclasses become objects with their class in `type`; arrays up to `arrays` elements become lists, larger ones
    `{"array": "float64 480×640"}`; NaN and infinities become null; values of unknown types become their text; values at
    nesting level `depth` become "…", but reasons keep their causes. With `keep`, arrays of numbers that would become
    lists are left as they are, for `encoded`.
    """
    kind: Any = type(value)
    if kind in _AS_THEY_ARE or isinstance(value, (str, int)):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if kind is Reason:  # goes as deep as the tree does
        return _reason(bounded(value), arrays, keep)
    if depth == 0:
        return "…"
    deeper = depth - 1
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, np.generic):
        return plain(value.item(), arrays=arrays, depth=depth)
    if isinstance(value, np.ndarray):
        if value.size > arrays:
            return {"array": f"{value.dtype} {'×'.join(map(str, value.shape))}"}
        if keep and value.dtype in _ENCODABLE and value.ndim:
            return value
        if value.dtype.kind in "iub" or (value.dtype.kind == "f" and np.isfinite(value).all()):
            return value.tolist()  # nothing in it needs another look
        return plain(value.tolist(), arrays=arrays, depth=depth)
    if (names := _fields(kind)) is not None:
        return {"type": type(value).__name__} | {
            name: plain(getattr(value, name), arrays=arrays, depth=deeper, keep=keep)
            for name in names
        }
    if isinstance(value, Mapping):
        return {
            str(key): plain(item, arrays=arrays, depth=deeper, keep=keep)
            for key, item in value.items()
        }
    if isinstance(value, (list, tuple, set, frozenset)):
        return [plain(item, arrays=arrays, depth=deeper, keep=keep) for item in value]
    if isinstance(value, Path):
        return _ADDRESS.sub("", str(value))
    if isinstance(value, type):
        return value.__name__
    return _ADDRESS.sub("", str(value))


def _reason(reason: Reason, arrays: int, keep: bool) -> dict[str, Any]:
    return {
        "type": "Reason",
        "node_path": reason.node_path,
        "code": reason.code,
        "message": reason.message,
        "data": plain(reason.data, arrays=arrays, keep=keep),
        "causes": [_reason(cause, arrays, keep) for cause in reason.causes],
    }


def encoded(message: Any) -> bytes:
    """Encode the result of `plain` with `keep` as compact JSON; compiled, to keep the record's cost low."""
    try:
        return orjson.dumps(message, option=orjson.OPT_SERIALIZE_NUMPY, default=_listed)
    except TypeError:  # a whole number of more than 64 bits, or half of a character
        text = json.dumps(message, ensure_ascii=False, separators=(",", ":"), default=_listed)
        return text.encode(errors="replace")


def _listed(value: Any) -> Any:
    """Return an array that the compiled encoder does not take, for instance a transposed one."""
    return plain(value, arrays=sys.maxsize)
