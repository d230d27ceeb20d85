"""Any value of a run as plain JSON: for `--json`, recordings and the dashboard's stream."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Mapping
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np

LARGE = 256
"""Arrays with more elements are described by shape and type, unless they are asked for."""

_ADDRESS = re.compile(r" at 0x[0-9a-f]+")
"""Where an object lies in memory says nothing, and would make two equal runs look different."""


def plain(value: Any, *, arrays: int = LARGE, depth: int = 12) -> Any:
    """A JSON value that says the same.

    Dataclasses become objects with their class in `type`; arrays up to `arrays` elements become lists, larger ones
    `{"array": "float64 480×640"}`; NaN and infinities become null; what is unknown becomes its text.
    """
    if value is None or isinstance(value, (bool, int, str)):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
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
        return plain(value.tolist(), arrays=arrays, depth=depth)
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {f.name: plain(getattr(value, f.name), arrays=arrays, depth=deeper) for f in dataclasses.fields(value)}
        return {"type": type(value).__name__, **fields}
    if isinstance(value, Mapping):
        return {str(key): plain(item, arrays=arrays, depth=deeper) for key, item in value.items()}
    if isinstance(value, (list, tuple, set, frozenset)):
        return [plain(item, arrays=arrays, depth=deeper) for item in value]
    if isinstance(value, Path):
        return _ADDRESS.sub("", str(value))
    if isinstance(value, type):
        return value.__name__
    return _ADDRESS.sub("", str(value))
