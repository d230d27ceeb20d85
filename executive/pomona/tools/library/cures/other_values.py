"""Other values of a place: nearer and farther numbers, the default, the other choices."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from pomona.executive.language.expression import UNITS
from pomona.executive.ports import Port, Quantity
from pomona.executive.values.units import split_unit

FACTORS = (2.0, 5.0, 25.0)
"""A number is multiplied and divided by these [-]. With three steps a value is tried that is wrong by one decade."""
STEPS = (
    1.0,
    0.6,
    0.35,
)  # how likely each factor is the right one, relative to the first: an assumption
AGAINST = 0.15  # how likely the direction is that a remedy does not name, relative to the other: an assumption
UNKNOWN = 0.5  # how likely each direction is when no remedy names one
BACK = 1.5  # how likely a default is that the tree or the run replaced, relative to the first factor: an assumption


@dataclass(frozen=True, slots=True)
class OtherValue:
    """Another value: its text, how much it changes, how likely it is the right one relative to the others."""

    text: str
    size: float
    share: float


def other_values(
    text: str, port: Port, default: str | None = None, direction: int = 0
) -> list[OtherValue]:
    """Return other values of a port, each once.

    Args:
        text: the present value, as written.
        port: its type, bounds and choices.
        default: the value that it would have if nobody had written one, as text; None without one.
        direction: +1 if a remedy proposes to raise it, -1 to lower it, 0 if none does.
    """
    found: dict[str, OtherValue] = {}
    number = _number(text, port)
    if default is not None and default != text:
        before = number
        after = _number(default, port)
        size = _size(before, after)
        against = (
            direction
            and before is not None
            and after is not None
            and (after - before) * direction < 0
        )
        found[default] = OtherValue(default, size, BACK * (AGAINST if against else 1.0))
    if port.type is bool or text in ("true", "false"):
        other = "false" if text == "true" else "true"
        found.setdefault(other, OtherValue(other, 1.0, 1.0))
    elif port.choices:
        for choice in port.choices:
            if choice != text:
                found.setdefault(choice, OtherValue(choice, 1.0, UNKNOWN))
    elif number is not None:
        for other_text, size, share in _numbers(text, number, port, direction):
            found.setdefault(other_text, OtherValue(other_text, size, share))
    return list(found.values())


def text_of(value: Any, port: Port) -> str | None:
    """Return a default as it would be written in a tree file; None if it is no single value."""
    if value is None or isinstance(value, str):
        return value or None
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, (int, float)):
        return port.type.format(value) if isinstance(port.type, Quantity) else f"{value:.6g}"
    return None


def _number(text: str, port: Port) -> float | None:
    """Return the number of a text, in the unit that it is written in SI for a quantity; None for a word."""
    if port.type is str:
        return None
    if isinstance(port.type, Quantity):
        try:
            return port.type.parse(text)
        except ValueError:
            return None
    number, unit = split_unit(text) or ("", "none")
    return None if unit and unit not in UNITS else float(number)


def _numbers(
    text: str, number: float, port: Port, direction: int
) -> Iterator[tuple[str, float, float]]:
    parts = split_unit(text)
    if parts is None or number == 0.0 or not math.isfinite(number):
        return
    written = float(parts[0])
    unit = parts[1]
    whole = port.type is object and bool(
        re.fullmatch(r"\d+", text)
    )  # an option of a cell has no type
    low, high = port.bounds
    for sign in (1, -1):
        share = UNKNOWN if direction == 0 else 1.0 if direction == sign else AGAINST
        for factor, step in zip(FACTORS, STEPS, strict=True):
            ratio = factor**sign if number > 0 else factor**-sign
            bound = high if sign > 0 else low
            beyond = bound is not None and (number * ratio - bound) * sign >= 0
            if beyond:  # the bound itself is the last value in this direction
                ratio = bound / number
                if ratio <= 0 or (ratio - 1.0) * sign * math.copysign(1.0, number) <= 1e-6:
                    break
            value = _written(written * ratio, port, sign, whole)
            if value is not None and value != written:
                yield _with_unit(value, unit), abs(math.log2(max(ratio, 1e-9))), share * step
            if beyond:
                break


def _written(value: float, port: Port, sign: int, whole: bool) -> float | None:
    if port.type is int or whole:
        value = math.ceil(value - 1e-9) if sign > 0 else math.floor(value + 1e-9)
        return (
            value
            if value >= 1 or (port.bounds[0] is not None and value >= port.bounds[0])
            else None
        )
    return value


def _with_unit(value: float, unit: str) -> str:
    return f"{value:.6g} {unit}".strip()


def _size(before: float | None, after: float | None) -> float:
    if before is None or after is None or before * after <= 0:
        return 1.0
    return abs(math.log2(after / before))
