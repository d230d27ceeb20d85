"""Where signals lie in a PLC's memory, and how numbers are written in its registers."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from pomona.devices.plc.codec import BITS, MOST, READS, WRITES, MemorySpan
from pomona.devices.plc.signals import SignalNames
from pomona.executive import TIME, Measure, Number, Problem, Text, value

NUMBERS = {"uint16": "H", "int16": "h", "uint32": "I", "int32": "i", "float32": "f"}
"""Kinds of numbers in registers, by their format in `struct`."""
ADDRESS = r"(6553[0-5]|655[0-2]\d|65[0-4]\d\d|6[0-4]\d{3}|[1-5]?\d{1,4})"
READABLE = Text(
    pattern=f"(coil|discrete|holding|input) {ADDRESS}",
    words="an area (coil, discrete, holding, input) and an address from 0 to 65535",
)
WRITABLE = Text(
    pattern=f"(coil|holding) {ADDRESS}",
    words="an area that can be written (coil, holding) and an address, 0 to 65535",
)
LAST = 65535
"""Largest address."""


@dataclass(frozen=True, slots=True)
class SignalPlace:
    """Place and meaning of a signal.

    Attributes:
        at: area and address of its first bit or register: `coil 3`.
        type: of its number, one of `NUMBERS`; ignored for a bit.
        scale: value of one count.
        low_word_first: whether a number of two registers begins with its lower half.
        safe: value at a safe stop, of an output.
        deadline: age from which it is unknown [s].
    """

    at: str
    type: str = value(Text(*NUMBERS), "uint16", "kind of a number in registers")
    scale: float = value(Number(1e-6, 1e9), "1", "value of one count")
    low_word_first: bool = False
    safe: float = 0.0
    deadline: float = 0.2

    def problems(self) -> Iterator[Problem]:
        if self.span.cells[-1][1] > LAST:
            yield Problem("at", f"a {self.type} takes two registers, and {self.at} is the last one")
        try:
            self.encode(self.safe)
        except ValueError as error:
            yield Problem("safe", str(error))

    @property
    def area(self) -> str:
        """Its part of the PLC's memory."""
        return self.at.split()[0]

    @property
    def is_bit(self) -> bool:
        """Return True for a switch."""
        return self.area in BITS

    @property
    def span(self) -> MemorySpan:
        """Its bit or registers."""
        wide = not self.is_bit and NUMBERS[self.type] in "Iif"
        return MemorySpan(self.area, int(self.at.split()[1]), 2 if wide else 1)

    def decode(self, values: Sequence[int]) -> bool | float:
        """Return the value of its bit or registers."""
        if self.is_bit:
            return bool(values[0])
        words = tuple(values)[::-1] if self.low_word_first else tuple(values)
        (counts,) = struct.unpack(f">{NUMBERS[self.type]}", struct.pack(f">{len(words)}H", *words))
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
                f">{NUMBERS[self.type]}", counts if self.type == "float32" else round(counts)
            )
        except (struct.error, OverflowError, ValueError) as error:
            raise ValueError(
                f"{value:g} does not fit into {self.type} with the scale {self.scale:g}"
            ) from error
        words = struct.unpack(f">{len(data) // 2}H", data)
        return words[::-1] if self.low_word_first else words


@dataclass(frozen=True, slots=True, kw_only=True)
class SignalHeartbeat:
    """A heartbeat both ways."""

    output: str = value(WRITABLE, help="bit or register of ours that toggles: coil 0")
    input: str = value(READABLE, help="bit or register of the PLC's that changes: discrete 0")
    period: float = value(Measure(TIME, "20 ms", "1 s"), "100 ms", "between two changes of ours")
    deadline: float = value(
        Measure(TIME, "50 ms", "5 s"), "500 ms", "without a change the PLC counts as stopped"
    )


def spans_of(places: Iterable[SignalPlace]) -> tuple[MemorySpan, ...]:
    """Join the spans of signals that lie side by side; nothing is read between them, where a PLC may have nothing."""
    joined: list[MemorySpan] = []
    for span in sorted((place.span for place in places), key=lambda span: (span.area, span.first)):
        last = joined[-1] if joined else None
        end = 0 if last is None else last.first + last.count
        if last is not None and last.area == span.area and span.first <= end:
            count = max(end, span.first + span.count) - last.first
            if count <= MOST[WRITES.get(span.area, READS[span.area])]:
                joined[-1] = MemorySpan(last.area, last.first, count)
                continue
        joined.append(span)
    return tuple(joined)


def names_of(inputs: Mapping[str, SignalPlace], outputs: Mapping[str, SignalPlace]) -> SignalNames:
    """Return the names of signals, with those that are numbers or counts."""
    places = {**inputs, **outputs}
    numbers = {name: place for name, place in places.items() if not place.is_bit}
    counts = {
        name: (place.scale, place.scale * 2.0 ** (16 * place.span.count))
        for name, place in numbers.items()
        if place.type != "float32"
    }
    return SignalNames(tuple(inputs), tuple(outputs), frozenset(numbers), counts)


def image(
    places: Mapping[str, SignalPlace], values: Mapping[str, bool | float]
) -> dict[tuple[str, int], int]:
    """Return the bits and registers of values, by area and address."""
    return {
        cell: word
        for name, place in places.items()
        for cell, word in zip(place.span.cells, place.encode(values[name]), strict=True)
    }
