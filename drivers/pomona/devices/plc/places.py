"""Where signals lie in a PLC's memory, and how numbers are written in its registers."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from pomona.devices.plc.codec import BITS, MOST, READS, MemorySpan

NUMBERS = {"uint16": "H", "int16": "h", "uint32": "I", "int32": "i", "float32": "f"}
"""Kinds of numbers in registers, by their format in `struct`."""


@dataclass(frozen=True, slots=True)
class SignalPlace:
    """Place and meaning of a signal.

    Attributes:
        area, first: of its first bit or register.
        kind: of its number, one of `NUMBERS`; ignored for a bit.
        scale: value of one count.
        low_word_first: whether a number of two registers begins with its lower half.
        safe: value at a safe stop, of an output.
        deadline: age from which it is unknown [s].
    """

    area: str
    first: int
    kind: str = "uint16"
    scale: float = 1.0
    low_word_first: bool = False
    safe: float = 0.0
    deadline: float = 0.5

    @property
    def is_bit(self) -> bool:
        """Return True for a switch."""
        return self.area in BITS

    @property
    def span(self) -> MemorySpan:
        """Its bit or registers."""
        wide = not self.is_bit and NUMBERS[self.kind] in "Iif"
        return MemorySpan(self.area, self.first, 2 if wide else 1)

    def decode(self, values: Sequence[int]) -> bool | float:
        """Return the value of its bit or registers."""
        if self.is_bit:
            return bool(values[0])
        words = tuple(values)[::-1] if self.low_word_first else tuple(values)
        (counts,) = struct.unpack(f">{NUMBERS[self.kind]}", struct.pack(f">{len(words)}H", *words))
        return float(counts) * self.scale

    def encode(self, value: bool | float) -> tuple[int, ...]:
        """Return its bit or registers. Raises ValueError: the value does not fit."""
        if self.is_bit:
            if value not in (0, 1):
                raise ValueError(f"{value:g} is no value of a switch")
            return (int(value),)
        counts = value / self.scale
        try:
            data = struct.pack(
                f">{NUMBERS[self.kind]}", counts if self.kind == "float32" else round(counts)
            )
        except (struct.error, OverflowError, ValueError) as error:
            raise ValueError(
                f"{value:g} does not fit into {self.kind} with the scale {self.scale:g}"
            ) from error
        words = struct.unpack(f">{len(data) // 2}H", data)
        return words[::-1] if self.low_word_first else words


def spans_of(places: Iterable[SignalPlace]) -> tuple[MemorySpan, ...]:
    """Join the spans of signals that lie side by side; nothing is read between them, where a PLC may have nothing."""
    joined: list[MemorySpan] = []
    for span in sorted((place.span for place in places), key=lambda span: (span.area, span.first)):
        last = joined[-1] if joined else None
        end = 0 if last is None else last.first + last.count
        if last is not None and last.area == span.area and span.first <= end:
            count = max(end, span.first + span.count) - last.first
            if count <= MOST[READS[span.area]] - 2:
                joined[-1] = MemorySpan(last.area, last.first, count)
                continue
        joined.append(span)
    return tuple(joined)


def image(
    places: Mapping[str, SignalPlace], values: Mapping[str, bool | float]
) -> dict[tuple[str, int], int]:
    """Return the bits and registers of values, by area and address."""
    return {
        (place.area, place.first + i): word
        for name, place in places.items()
        for i, word in enumerate(place.encode(values[name]))
    }
