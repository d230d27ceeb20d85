"""Typed ports: inputs and outputs of a skill, known without running it.

A port's type is a Python class (a dataclass that skills exchange, or bool, int, float, str, an Enum), or a `Quantity`:
a float with a dimension, written in tree files with a unit (`120 mm`) and handed to the skill in SI.
"""

from __future__ import annotations

import re
from collections.abc import ItemsView, Iterator, Mapping
from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property
from typing import Annotated, Any, dataclass_transform, get_args, get_origin

from pomona.executive.values.units import (
    ACCELERATION,
    ANGLE,
    ANGULAR_SPEED,
    FORCE,
    LENGTH,
    MASS,
    PRESSURE,
    QUANTITIES,
    RATE,
    RATIO,
    SPEED,
    TIME,
    TORQUE,
    Quantity,
)

__all__ = [
    "ACCELERATION",
    "ANGLE",
    "ANGULAR_SPEED",
    "FORCE",
    "LENGTH",
    "MASS",
    "PRESSURE",
    "QUANTITIES",
    "RATE",
    "RATIO",
    "REQUIRED",
    "SPEED",
    "TIME",
    "TORQUE",
    "Acceleration",
    "Angle",
    "AngularSpeed",
    "Force",
    "Length",
    "Mass",
    "Outputs",
    "Port",
    "PortType",
    "Ports",
    "Pressure",
    "Quantity",
    "Rate",
    "Ratio",
    "Speed",
    "Time",
    "Torque",
    "type_name",
]


class _Missing(Enum):
    REQUIRED = "required"


REQUIRED = _Missing.REQUIRED  # default of a port that must be given


PortType = type[Any] | Quantity

Length = Annotated[float, LENGTH]
Angle = Annotated[float, ANGLE]
Time = Annotated[float, TIME]
Mass = Annotated[float, MASS]
Force = Annotated[float, FORCE]
Torque = Annotated[float, TORQUE]
Pressure = Annotated[float, PRESSURE]
Speed = Annotated[float, SPEED]
AngularSpeed = Annotated[float, ANGULAR_SPEED]
Acceleration = Annotated[float, ACCELERATION]
Rate = Annotated[float, RATE]
Ratio = Annotated[float, RATIO]


def without_alias(annotation: Any) -> Any:
    """Return the type behind a name that a `type` statement made, such as numpy's NDArray from 2.5 on.

    `NDArray[np.float64]` becomes `np.ndarray[…, np.dtype[np.float64]]`; every other annotation is returned as it is.
    """
    value = getattr(get_origin(annotation) or annotation, "__value__", None)
    if value is None:
        return annotation
    arguments = get_args(annotation)
    return without_alias(value[arguments] if arguments else value)


def type_name(port_type: PortType) -> str:
    """Return the type's name in tree files: the quantity's, or the class's in snake case (`measured_fruit`)."""
    if isinstance(port_type, Quantity):
        return port_type.name
    builtin = {str: "text", bool: "bool", int: "int", float: "number"}
    if port_type in builtin:
        return builtin[port_type]
    return re.sub(
        r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", port_type.__name__
    ).lower()


@dataclass(frozen=True, slots=True)
class Port:
    """One port's declaration.

    Attributes:
        type: of its value; read from the annotation in a skill's `run`.
        default: value when the tree wires nothing; a quantity may be written as text. `REQUIRED` when there is none.
        help: description in one line.
        min, max: closed range of a number or quantity, as text with a unit or in SI.
        choices: the only texts that are allowed.
        was: its name in the previous version; the checker reports trees that still use it.
    """

    type: PortType = object
    default: Any = REQUIRED
    help: str = ""
    min: Any = None
    max: Any = None
    choices: tuple[str, ...] = ()
    was: str = ""
    _bounds: tuple[Any, Any] | None = field(default=None, init=False, repr=False, compare=False)

    @property
    def bounds(self) -> tuple[Any, Any]:
        """`min` and `max` in SI, None where there is none; parsed once, for all values that are held against them."""
        if self._bounds is None:
            low, high = (
                None if limit is None else self.si(limit) for limit in (self.min, self.max)
            )
            object.__setattr__(self, "_bounds", (low, high))
            return low, high
        return self._bounds

    @property
    def required(self) -> bool:
        """Whether it must be wired."""
        return self.default is REQUIRED

    def si(self, value: Any) -> Any:
        """Return a literal of a declaration or a tree file in SI; a quantity written as text is parsed."""
        if isinstance(self.type, Quantity):
            return self.type.parse(value) if isinstance(value, str) else float(value)
        return value

    @property
    def default_value(self) -> Any:
        """The default as the skill gets it; None for an optional port that is not wired."""
        return None if self.required or self.default is None else self.si(self.default)

    def accepts(self, value: Any) -> bool:
        """Return True if a value may travel through this port (an int may pass as a number)."""
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

    def __contains__(self, name: object) -> bool:
        return name in self._ports

    def items(self) -> ItemsView[str, Port]:
        """Return names with their ports; the check of a large tree asks often, and Mapping's own way takes longer."""
        return self._ports.items()

    @cached_property
    def needed(self) -> tuple[str, ...]:
        """Names of the ports that must be wired."""
        return tuple(name for name, port in self._ports.items() if port.required)


@dataclass_transform(frozen_default=True)
class Outputs:
    """Outputs of a skill: subclasses are frozen dataclasses, each field an output port.

    class Weighed(Outputs):
        mass: Mass

    A value may have a `sentence` (text), which the record and the page show, and `facts` (a mapping), for reports.
    """

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        dataclass(frozen=True)(cls)
