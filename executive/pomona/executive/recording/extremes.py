"""Many samples as few: the least and the greatest of each quantity, so that a peak is never lost."""

from __future__ import annotations

import math
from typing import Any

import orjson


class Extremes:
    """Messages of one topic's samples, added up; `message` gives one that stands for all of them."""

    def __init__(self) -> None:
        self._count = 0
        self._begin = math.nan
        self._last = b""
        self._found: dict[str, tuple[float, int, float, int]] = {}

    def add(self, content: bytes) -> None:
        """Add a message's samples. One that is not as expected adds nothing: it is left to whoever reads it whole."""
        self._last = content
        try:
            value = orjson.loads(content)["value"]
            times, values = value["t"], value["values"]
            if not self._count:
                self._begin = float(times[0])
            for name, series in values.items():
                measured = series if None not in series else [sample for sample in series if sample is not None]
                if measured:
                    low, high = min(measured), max(measured)
                    self._widen(name, low, self._count + series.index(low), high, self._count + series.index(high))
            self._count += len(times)
        except (ValueError, TypeError, KeyError, IndexError, AttributeError):
            return

    def join(self, later: Extremes) -> None:
        """Add what came after this."""
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
        """The last of the messages, with two samples for all: of each quantity least and greatest, as they came."""
        if self._count <= 2:
            return self._last
        try:
            event: dict[str, Any] = orjson.loads(self._last)
            value = event["value"]
            times = [self._begin, float(value["t"][-1])]
        except (ValueError, TypeError, KeyError, IndexError):
            return self._last
        values = {
            name: [low, high] if low_at <= high_at else [high, low]
            for name, (low, low_at, high, high_at) in self._found.items()
        }
        event["value"] = {**value, "t": times, "values": values, "thinned": self._count}
        return orjson.dumps(event)
