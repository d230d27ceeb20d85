"""A skill's ports, wired to the board: values are looked up, converted and checked once at each start."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pomona.executive.board import Board
from pomona.executive.language.expression_run import Getter
from pomona.executive.language.values import out_of_range
from pomona.executive.ports import Port, Ports, Quantity, type_name
from pomona.executive.reasons import NoValue
from pomona.executive.skill import Failure, Skill, SkillContext, SkillFailure
from pomona.executive.values.read_only import own


def bind_skill(
    skill: Skill,
    inputs: Ports,
    context: SkillContext,
    path: str,
    getters: Mapping[str, Getter],
    keys: Mapping[str, str],
    board: Board,
) -> None:
    """Wire a skill: `getters` are the sources of its inputs by port, `keys` the absolute keys that its outputs write.

    `inputs` are the ports as the tree's author knows them; a mock has those of the skill that it replaces.
    """
    defaults = {name: port.default_value for name, port in inputs.items() if name not in getters}
    wired = [(name, inputs[name], get) for name, get in getters.items()]

    def read() -> dict[str, Any]:
        values = dict(defaults)
        for name, port, get in wired:
            try:
                value = get()
            except NoValue as missing:
                if port.required:
                    raise SkillFailure(Failure("BAD_VALUE", f"input {name}: {missing}", {"port": name})) from None
                value = port.default_value
            values[name] = _accepted(name, port, value)
        return {name: own(value) for name, value in values.items()}

    def write(name: str, value: Any) -> None:
        key = keys.get(name)
        if key is not None:
            board.write(key, value, path)

    skill.bind(context, path, read, write)


def _accepted(name: str, port: Port, value: Any) -> Any:
    if getattr(value, "is_placeholder", False):
        return value
    if not port.accepts(value):
        message = f"input {name} takes a {type_name(port.type)}, got {_shown(value)}"
        raise SkillFailure(Failure("BAD_VALUE", message, {"port": name}))
    problem = out_of_range(value, port)
    if problem:
        raise SkillFailure(Failure("BAD_VALUE", f"input {name} {problem}", {"port": name}))
    if (
        isinstance(value, int)
        and not isinstance(value, bool)
        and (port.type is float or isinstance(port.type, Quantity))
    ):
        return float(value)
    return value


def _shown(value: Any) -> str:
    return "nothing" if value is None else f"a {type(value).__name__}"


def plain(value: Any) -> Any:
    """Return a number of numpy's as Python's own; other values as they are."""
    if type(value).__module__ == "numpy" and getattr(value, "ndim", None) == 0:
        return value.item()
    return value
