"""Typed ports: what a skill reads and writes, known without running it.

A port's type is a Python class (a dataclass that skills exchange, or bool, int, float, str, an Enum), or a `Quantity`:
a float with a dimension, written in tree files with a unit (`120 mm`) and handed to the skill in SI.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any


class _Missing(Enum):
    REQUIRED = "required"


REQUIRED = _Missing.REQUIRED
"""Default of a port that must be given."""


@dataclass(frozen=True, slots=True)
class Quantity:
    """A float with a dimension. `units` maps a unit's name to its size in SI; the first is SI itself."""

    name: str
    units: Mapping[str, float]

    @property
    def si_unit(self) -> str:
        return next(iter(self.units))

    def parse(self, text: str) -> float:
        """`"120 mm"` -> 0.12.

        Raises:
            ValueError: no number, no unit, or a unit of another dimension; the text says which are known.
        """
        match = re.fullmatch(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([^\s\d]\S*)?\s*", text)
        if match is None:
            raise ValueError(f"'{text}' is not a {self.name}: write a number and a unit, such as '1 {self.si_unit}'")
        number, unit = match.groups()
        if unit is None:
            known = ", ".join(self.units)
            raise ValueError(f"'{text.strip()}' lacks a unit: a {self.name} is given in {known}")
        if unit not in self.units:
            known = ", ".join(self.units)
            raise ValueError(f"'{unit}' is no unit of {self.name}: {known}")
        return float(number) * self.units[unit]

    def format(self, value: float) -> str:
        """The value with the unit that keeps it readable: 0.12 -> '120 mm'."""
        readable = [(abs(value) / size, unit, size) for unit, size in self.units.items()]
        fitting = [entry for entry in readable if 1.0 <= entry[0] < 1000.0]
        _, unit, size = min(fitting) if fitting else (0.0, self.si_unit, 1.0)
        return f"{value / size:.6g} {unit}"


_DEGREE = 0.017453292519943295

LENGTH = Quantity("length", {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6})
ANGLE = Quantity("angle", {"rad": 1.0, "deg": _DEGREE, "°": _DEGREE})
TIME = Quantity("time", {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0, "h": 3600.0})
FORCE = Quantity("force", {"N": 1.0, "mN": 1e-3})
TORQUE = Quantity("torque", {"N·m": 1.0, "Nm": 1.0, "N·mm": 1e-3, "Nmm": 1e-3})
MASS = Quantity("mass", {"kg": 1.0, "g": 1e-3})
SPEED = Quantity("speed", {"m/s": 1.0, "mm/s": 1e-3, "cm/s": 1e-2})
ANGULAR_SPEED = Quantity("angular_speed", {"rad/s": 1.0, "deg/s": _DEGREE, "°/s": _DEGREE})
ACCELERATION = Quantity("acceleration", {"m/s²": 1.0, "m/s^2": 1.0, "mm/s²": 1e-3, "mm/s^2": 1e-3})
RATE = Quantity("rate", {"Hz": 1.0, "kHz": 1e3})
RATIO = Quantity("ratio", {"1": 1.0, "%": 1e-2})

QUANTITIES: Mapping[str, Quantity] = {
    q.name: q for q in (LENGTH, ANGLE, TIME, FORCE, TORQUE, MASS, SPEED, ANGULAR_SPEED, ACCELERATION, RATE, RATIO)
}
"""Every quantity by its name in tree files. A ratio may be written as a bare number."""

PortType = type[Any] | Quantity


def type_name(port_type: PortType) -> str:
    """The type's name in tree files: the quantity's, or the class's in snake case (MeasuredFruit -> measured_fruit)."""
    if isinstance(port_type, Quantity):
        return port_type.name
    builtin = {str: "text", bool: "bool", int: "int", float: "number"}
    if port_type in builtin:
        return builtin[port_type]
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", port_type.__name__).lower()


@dataclass(frozen=True, slots=True)
class Port:
    """One port's declaration.

    Attributes:
        type: what it carries.
        default: value when the tree wires nothing; a quantity may be written as text. `REQUIRED` when there is none.
        help: one line for people.
        min, max: closed range of a number or quantity, as text with a unit or in SI.
        choices: the only texts that are allowed.
    """

    type: PortType
    default: Any = REQUIRED
    help: str = ""
    min: Any = None
    max: Any = None
    choices: tuple[str, ...] = ()

    @property
    def required(self) -> bool:
        return self.default is REQUIRED

    def si(self, value: Any) -> Any:
        """A literal of a declaration or a tree file in SI: quantities written as text are parsed, others pass."""
        if isinstance(self.type, Quantity):
            return self.type.parse(value) if isinstance(value, str) else float(value)
        return value

    @property
    def default_value(self) -> Any:
        """The default as the skill gets it; None for an optional port that is not wired."""
        return None if self.required or self.default is None else self.si(self.default)

    def accepts(self, value: Any) -> bool:
        """Whether a value may travel through this port (an int may pass as a number)."""
        if value is None:
            return not self.required
        if isinstance(self.type, Quantity) or self.type is float:
            return isinstance(value, (int, float)) and not isinstance(value, bool)
        if self.type is int:
            return isinstance(value, int) and not isinstance(value, bool)
        return isinstance(value, self.type)


class Ports(Mapping[str, Port]):
    """A skill's inputs or outputs by name: `Ports(detection=Detection, radius=Port(LENGTH, default="120 mm"))`."""

    def __init__(self, **ports: PortType | Port) -> None:
        self._ports = {name: p if isinstance(p, Port) else Port(p) for name, p in ports.items()}

    def __getitem__(self, name: str) -> Port:
        return self._ports[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._ports)

    def __len__(self) -> int:
        return len(self._ports)


def optional(port_type: PortType, help: str = "") -> Port:
    """A port that may stay unwired; the skill then gets None."""
    return Port(port_type, default=None, help=help)
