"""Quantities and their units: the one table that ports, tree files, cells, campaigns and fruit use."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass

NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d{1,3})?"  # a number in files, as a regular expression for JSON Schema

_WRITTEN = re.compile(rf"\s*({NUMBER})(?:\s*([^\s\d]\S*)|\s+(1/\S+))?\s*", re.ASCII)


def split_unit(text: str) -> tuple[str, str] | None:
    """Return the number of a text and the word behind it, or an empty word; None if the text begins with no number."""
    match = _WRITTEN.fullmatch(text)
    return None if match is None else (match[1], match[2] or match[3] or "")


def is_number(text: str) -> bool:
    """Return True for a number without a unit."""
    return (split_unit(text) or ("", "none"))[1] == ""


def is_within(value: float, low: float, high: float) -> bool:
    """Return True if a value lies in a closed range, with tolerance for the rounding of a unit's factor."""
    return low - 1e-9 * _scale(low) <= value <= high + 1e-9 * _scale(high)


def _scale(bound: float) -> float:
    return max(1.0, abs(bound)) if math.isfinite(bound) else 0.0


def with_article(noun: str) -> str:
    """`a length`, `an angle`, `a number of pixels`."""
    return (
        "a number of pixels"
        if noun == "pixels"
        else f"{'an' if noun[0] in 'aeiou' else 'a'} {noun}"
    )


@dataclass(frozen=True, slots=True)
class Quantity:
    """A physical quantity. `units` maps the name of a unit to its size in SI; the first is the SI unit."""

    name: str
    units: Mapping[str, float]
    most: float = math.inf  # size from which on a value is a slip of the pen, in SI

    @property
    def si_unit(self) -> str:
        """The unit in which values are kept."""
        return next(iter(self.units))

    @property
    def bare(self) -> bool:
        """Whether a number without a unit is meant: of a ratio only."""
        return self.si_unit == "1"

    def parse(self, text: str) -> float:
        """`"120 mm"` -> 0.12.

        Raises ValueError: no finite number, no unit, or a unit of another quantity; the text lists the known units.
        """
        written = split_unit(text)
        if written is None:
            how = (
                "a number or a percentage"
                if self.bare
                else f"a number and a unit, such as '1 {self.si_unit}'"
            )
            if split_unit(text.replace(",", ".", 1)) is not None:
                how = f"'{text.strip().replace(',', '.', 1)}', with a point"
            raise ValueError(f"'{text}' is not {with_article(self.name)}: write {how}")
        unit = written[1] or ("1" if self.bare else "")
        if not unit:
            raise ValueError(
                f"'{text.strip()}' lacks a unit: {with_article(self.name)} is given in {', '.join(self.units)}"
            )
        if unit not in self.units:
            raise ValueError(f"'{unit}' is no unit of {self.name}: {', '.join(self.units)}")
        value = float(written[0]) * self.units[unit]
        if not abs(value) < self.most:
            raise ValueError(f"'{text.strip()}' is too large for {with_article(self.name)}")
        return value

    def __call__(self, text: str) -> float:
        """`LENGTH("120 mm")` is 0.12: `parse`, as defaults of ports are written."""
        return self.parse(text)

    def format(self, value: float, like: str = "") -> str:
        """Return the value in the unit of a text, else in the shortest: 0.12 -> '12 cm'; a ratio without one."""
        _, unit = split_unit(like) or ("", "")
        if unit in self.units:
            return f"{value / self.units[unit]:.6g} {unit}"
        if self.bare:
            return f"{value:.6g}"
        readable = [
            (f"{value / size:.6g}", unit)
            for unit, size in self.units.items()
            if 1.0 <= abs(value) / size < 1000.0
        ]
        number, unit = min(
            readable, key=lambda entry: len(entry[0]), default=(f"{value:.6g}", self.si_unit)
        )
        return f"{number} {unit}"


_DEGREE = math.pi / 180.0

LENGTH = Quantity("length", {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6})
ANGLE = Quantity("angle", {"rad": 1.0, "deg": _DEGREE, "°": _DEGREE})
TIME = Quantity(
    "time", {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0, "h": 3600.0}, most=1e10
)  # 317 years
MASS = Quantity("mass", {"kg": 1.0, "g": 1e-3})
FORCE = Quantity("force", {"N": 1.0, "mN": 1e-3})
TORQUE = Quantity("torque", {"N·m": 1.0, "Nm": 1.0, "N·mm": 1e-3, "Nmm": 1e-3})
STIFFNESS = Quantity("stiffness", {"N/m": 1.0, "N/mm": 1e3, "kN/m": 1e3})
PRESSURE = Quantity("pressure", {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "bar": 1e5})
SPEED = Quantity("speed", {"m/s": 1.0, "mm/s": 1e-3, "cm/s": 1e-2})
ANGULAR_SPEED = Quantity("angular_speed", {"rad/s": 1.0, "deg/s": _DEGREE, "°/s": _DEGREE})
ACCELERATION = Quantity("acceleration", {"m/s²": 1.0, "m/s^2": 1.0, "mm/s²": 1e-3, "mm/s^2": 1e-3})
RATE = Quantity("rate", {"Hz": 1.0, "1/s": 1.0, "kHz": 1e3})
PIXELS = Quantity("pixels", {"px": 1.0})
RATIO = Quantity("ratio", {"1": 1.0, "%": 1e-2})

QUANTITIES: Mapping[str, Quantity] = {
    q.name: q
    for q in (
        LENGTH,
        ANGLE,
        TIME,
        MASS,
        FORCE,
        TORQUE,
        STIFFNESS,
        PRESSURE,
        SPEED,
        ANGULAR_SPEED,
        ACCELERATION,
        RATE,
        PIXELS,
        RATIO,
    )
}
"""Every quantity by its name in files. A ratio may be written as a bare number, all others need their unit."""


@dataclass(frozen=True, slots=True)
class Array:
    """Shape and unit of an array: `dimensions: Annotated[Float64, Array(3, of=LENGTH)]`."""

    shape: tuple[int, ...]  # its length along each axis
    of: Quantity | None  # quantity of its elements, if they have one unit

    def __init__(self, *shape: int, of: Quantity | None = None) -> None:
        object.__setattr__(self, "shape", shape)
        object.__setattr__(self, "of", of)
