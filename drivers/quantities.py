"""Numbers with units, as cell files write them: 120 mm, 30 deg, 2 ms."""

from __future__ import annotations

import math
import re

# unit -> (what it measures, factor to SI)
UNITS: dict[str, tuple[str, float]] = {
    "m": ("length", 1.0),
    "cm": ("length", 1e-2),
    "mm": ("length", 1e-3),
    "rad": ("angle", 1.0),
    "deg": ("angle", math.pi / 180.0),
    "°": ("angle", math.pi / 180.0),
    "s": ("time", 1.0),
    "ms": ("time", 1e-3),
    "Hz": ("rate", 1.0),
    "m/s": ("speed", 1.0),
    "mm/s": ("speed", 1e-3),
    "N": ("force", 1.0),
    "kg": ("mass", 1.0),
    "g": ("mass", 1e-3),
}

_PATTERN = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\S*)\s*")


def parse_quantity(text: str, kind: str) -> float:
    """A number in SI units; a bare number is in SI units already, and kind 'number' takes no unit.

    Raises:
        ValueError: not a finite number, or a unit that does not measure `kind`; the text is a sentence for a person.
    """
    match = _PATTERN.fullmatch(text)
    if match is None or not math.isfinite(value := float(match[1])):
        raise ValueError(f"'{text}' is not a number" + (f" with a unit of {kind}" if kind != "number" else ""))
    unit = match[2]
    if not unit:
        return value
    known = [name for name, (measured, _) in UNITS.items() if measured == kind]
    if unit not in known:
        wanted = f"use {', '.join(known)}" if known else "no unit is meant here"
        raise ValueError(f"'{unit}' is not a unit of {kind}; {wanted}")
    return value * UNITS[unit][1]
