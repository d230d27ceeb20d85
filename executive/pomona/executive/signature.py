"""A skill's ports, read from the signature of its `run`: inputs and outputs.

    def run(
        self,
        grasp: Grasp,
        height: Annotated[Length, Port(min="1 mm", help="how far up")] = LENGTH("150 mm"),
        map: Annotated[OccupancyMap | None, Port(help="obstacles")] = None,
    ) -> Work[Lifted]: ...

A parameter without a default must be wired; one that may be None may stay unwired. `Lifted` is an `Outputs` whose
fields are the output ports; a skill without outputs returns None.
"""

from __future__ import annotations

import inspect
import types
from collections.abc import Callable, Generator, Mapping
from dataclasses import replace
from enum import Enum
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from pomona.executive.errors import SkillError
from pomona.executive.ports import REQUIRED, Outputs, Port, Ports, Quantity, without_alias

_UNIONS = (Union, types.UnionType)


def ports_of(skill: str, run: Callable[..., Any]) -> tuple[Ports, Ports] | None:
    """Return the input and output ports of a `run`, or None for a `run(**inputs)` whose class declares them.

    Args:
        skill: the class's name, for errors.
        run: the function, its first parameter being the skill itself.

    Raises SkillError: an annotation is missing or is no port, a default does not fit its own declaration, or an output
    has the name of an input.
    """
    parameters = list(inspect.signature(run).parameters.values())[1:]
    if any(parameter.kind is parameter.VAR_KEYWORD for parameter in parameters):
        return None
    try:
        hints = get_type_hints(run, include_extras=True)
    except Exception as error:  # evaluating a foreign annotation may raise any exception
        raise SkillError(skill, f"the annotations of run cannot be read: {error}") from error
    inputs: dict[str, Port] = {}
    for parameter in parameters:
        if parameter.name not in hints:
            raise SkillError(
                skill,
                f"run's parameter {parameter.name} has no annotation: annotate it with the port's type",
            )
        default = REQUIRED if parameter.default is parameter.empty else parameter.default
        inputs[parameter.name] = _port(skill, parameter.name, hints[parameter.name], default)
    if "return" not in hints:
        raise SkillError(
            skill, "run has no return annotation: annotate it with the outputs, or None"
        )
    outputs = _outputs(skill, hints["return"])
    for name in outputs:
        if name in inputs:
            raise SkillError(
                skill, f"{name} is an input and an output: a tree could wire one of them only"
            )
    return Ports(**inputs), outputs


def _outputs(skill: str, returned: Any) -> Ports:
    if get_origin(returned) is Generator:
        returned = get_args(returned)[2]
    if (
        returned is None or returned is types.NoneType or isinstance(returned, TypeVar)
    ):  # a bare Work gives nothing
        return Ports()
    if not (isinstance(returned, type) and issubclass(returned, Outputs)):
        raise SkillError(
            skill, f"run returns {returned}: outputs are the fields of an Outputs class, or None"
        )
    fields: Mapping[str, Any] = get_type_hints(returned, include_extras=True)
    return Ports(**{name: _port(skill, name, field, REQUIRED) for name, field in fields.items()})


def _port(skill: str, name: str, annotation: Any, default: Any) -> Port:
    """One port from its annotation and default."""
    about: list[Any] = []
    carried, optional = _unwrapped(annotation, about)
    declarations = [entry for entry in about if isinstance(entry, Port)]
    quantities = [entry for entry in about if isinstance(entry, Quantity)]
    if len(declarations) > 1 or len(quantities) > 1:
        raise SkillError(skill, f"{name} is declared twice in its annotation")
    declared = declarations[0] if declarations else Port()
    if optional and default is not None:
        raise SkillError(skill, f"{name} may be None, so its default must be None")
    if default is None and not optional:
        raise SkillError(
            skill, f"{name}: the default is None, so its type must be one that may be None"
        )
    if get_origin(carried) is Literal:
        declared = replace(declared, choices=get_args(carried))
        carried = str
    port = replace(
        declared,
        type=quantities[0] if quantities else get_origin(carried) or carried,
        default=default,
    )
    if not isinstance(port.type, (type, Quantity)) or get_origin(carried) in _UNIONS:
        raise SkillError(skill, f"{name}: {annotation} is no type that a port can carry")
    if isinstance(port.type, Quantity) and carried is not float:
        raise SkillError(skill, f"{name}: a {port.type.name} is a float, not {carried}")
    _refuse_contradictions(skill, name, port)
    return port


def _unwrapped(annotation: Any, about: list[Any]) -> tuple[Any, bool]:
    """Return the carried type and whether None is allowed; other annotations are appended to `about`."""
    annotation = without_alias(annotation)
    if get_origin(annotation) is Annotated:
        inner, *said = get_args(annotation)
        about.extend(said)
        return _unwrapped(inner, about)
    if get_origin(annotation) in _UNIONS:
        kinds = [kind for kind in get_args(annotation) if kind is not types.NoneType]
        if len(kinds) == 1:
            return _unwrapped(kinds[0], about)[0], True
    return annotation, False


def _refuse_contradictions(skill: str, name: str, port: Port) -> None:
    try:
        least, most, value = (
            None if v is None else port.si(v) for v in (port.min, port.max, port.default_value)
        )
    except ValueError as error:
        raise SkillError(skill, f"{name}: {error}") from error
    if least is not None and most is not None and least > most:
        raise SkillError(skill, f"{name}: min {port.min} is above max {port.max}")
    if port.required or value is None:
        return
    if not port.accepts(value):
        raise SkillError(skill, f"{name}: the default {value!r} is not of its type")
    if (least is not None and value < least) or (most is not None and value > most):
        raise SkillError(
            skill, f"{name}: the default {value!r} is out of its range {port.min} … {port.max}"
        )
    if port.choices and (value.value if isinstance(value, Enum) else value) not in port.choices:
        raise SkillError(
            skill, f"{name}: the default {value!r} is not one of {', '.join(port.choices)}"
        )
