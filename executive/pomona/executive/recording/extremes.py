"""Many samples as few: the smallest and the largest of each quantity, so that no peak is lost."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import orjson


class Extremes:
    """Messages of one topic's samples, combined; `message` returns one that represents all of them."""

    def __init__(self) -> None:
        self._count = 0
        self._begin = math.nan
        self._last = b"{}"
        self._found: dict[str, tuple[float, int, float, int]] = {}

    def add(self, message: Mapping[str, Any], content: bytes) -> None:
        """Add the samples of a message with this text. A malformed one adds nothing."""
        self._last = content
        try:
            times, values = _listed(message["value"]["t"]), message["value"]["values"]
            if not self._count:
                self._begin = float(times[0])
            for name, series in values.items():
                found = _listed(series)
                measured = [sample for sample in found if sample is not None and sample == sample]  # NaN differs
                if measured:
                    low, high = min(measured), max(measured)
                    self._widen(name, low, self._count + found.index(low), high, self._count + found.index(high))
            self._count += len(times)
        except (ValueError, TypeError, KeyError, IndexError, AttributeError):
            return

    def join(self, later: Extremes) -> None:
        """Add the samples that came after these."""
        if not self._count:
            self._begin = later._begin
        for name, (low, low_at, high, high_at) in later._found.items():
            self._widen(name, low, self._count + low_at, high, self._count + high_at)
        self._count += later._count
        self._last = later._last

    def _widen(self, name: str, low: float, low_at: int, high: float, high_at: int) -> None:
        found = self._found.get(name)
        if found is not None:
            low, low_at = (low, low_at) if low < found[0] else found[:2]
            high, high_at = (high, high_at) if high > found[2] else found[2:]
        self._found[name] = (low, low_at, high, high_at)

    def message(self) -> bytes:
        """Return the last message with two samples for all: of each quantity the smallest and the largest, in order."""
        if self._count <= 2:
            return self._last
        try:
            message = orjson.loads(self._last)
            value = message["value"]
            times = [self._begin, float(value["t"][-1])]
        except (ValueError, TypeError, KeyError, IndexError):
            return self._last
        values = {
            name: [low, high] if low_at <= high_at else [high, low]
            for name, (low, low_at, high, high_at) in self._found.items()
        }
        message["value"] = {**value, "t": times, "values": values, "thinned": self._count}
        return orjson.dumps(message)


def _listed(samples: Any) -> list[Any]:
    """Return samples as a list: an array while a run is recorded, a list when its record is read."""
    listed = samples.tolist() if hasattr(samples, "tolist") else samples
    if not isinstance(listed, list):
        raise TypeError("samples are a list")
    return listed
