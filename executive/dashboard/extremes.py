"""Many samples as few: the least and the greatest of each quantity, so that a peak is never lost."""

from __future__ import annotations

import math
from typing import Any

import orjson

from executive.dashboard.messages import encode_number

Line = tuple[int, float, bytes, int]
"""One event of a record: its number, its time [s], its text, and where its image stands in the file, or -1."""


class Extremes:
    """Messages of one topic's samples, added up; `message` gives one that stands for all of them."""

    def __init__(self) -> None:
        self._count = 0
        self._begin = math.nan
        self._found: dict[str, tuple[float, int, float, int]] = {}

    def add(self, content: bytes) -> None:
        """Add a message's samples. One that is not as expected adds nothing: it is left to whoever reads it whole."""
        try:
            value = orjson.loads(content)["value"]
            times, values = value["t"], value["values"]
            if not self._count:
                self._begin = float(times[0])
            for name, series in values.items():
                self._look(name, series)
            self._count += len(times)
        except (ValueError, TypeError, KeyError, IndexError, AttributeError):
            return

    def _look(self, name: str, series: list[Any]) -> None:
        measured = series if None not in series else [sample for sample in series if sample is not None]
        if not measured:
            return
        low, high = min(measured), max(measured)
        found = self._found.get(name)
        if found is None:
            found = (low, self._count + series.index(low), high, self._count + series.index(high))
        elif low < found[0] or high > found[2]:
            least, least_at, greatest, greatest_at = found
            if low < least:
                least, least_at = low, self._count + series.index(low)
            if high > greatest:
                greatest, greatest_at = high, self._count + series.index(high)
            found = (least, least_at, greatest, greatest_at)
        else:
            return
        self._found[name] = found

    def message(self, last: Line) -> bytes | Line:
        """The last of the messages, with two samples for all: of each quantity least and greatest, as they came."""
        if self._count <= 2:
            return last
        try:
            event = orjson.loads(last[2])
            value = event["value"]
            times = [self._begin, float(value["t"][-1])]
            values = {
                name: [low, high] if low_at <= high_at else [high, low]
                for name, (low, low_at, high, high_at) in self._found.items()
            }
        except (ValueError, TypeError, KeyError, IndexError):
            return last
        event["value"] = {**value, "t": times, "values": values, "thinned": self._count}
        return encode_number(last[0]) + orjson.dumps(event)[1:]
