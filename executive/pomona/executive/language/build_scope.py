"""Meaning of names and ports while a definition is built: getters for reading, keys for writing, conversion."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import PurePath
from typing import Any, TypeVar

from pomona.executive.board import Board
from pomona.executive.language.check import Analysis
from pomona.executive.language.expression import SPECIAL, references
from pomona.executive.language.expression_run import Getter, compile_condition, compile_expression
from pomona.executive.language.model import Definition
from pomona.executive.language.scope import ComputedValue, Given, Value
from pomona.executive.language.values import out_of_range
from pomona.executive.nodes.context import ForEachCount, LastFailure, RepeatCount, RetryCount
from pomona.executive.nodes.facts import Condition
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
                    raise SkillFailure(
                        Failure("BAD_VALUE", f"input {name}: {missing}", {"port": name})
                    ) from None
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
    if type(value) is int and (port.type is float or isinstance(port.type, Quantity)):
        return float(value)
    return value


def _shown(value: Any) -> str:
    return "nothing" if value is None else f"a {type(value).__name__}"


def plain(value: Any) -> Any:
    """Return a number of numpy's as Python's own; other values as they are."""
    if type(value).__module__ == "numpy" and getattr(value, "ndim", None) == 0:
        return value.item()
    return value


T = TypeVar("T")


def constant(value: Any) -> Getter:
    """Reads a value that never changes."""
    return lambda: value


@dataclass(frozen=True, slots=True)
class InstanceScope:
    """Meaning of names for the nodes of one instance of a definition."""

    analysis: Analysis
    definition: Definition
    board: Board
    prefix: str  # of the keys that its nodes write, ending in '/'
    names: Mapping[str, Getter] = field(default_factory=dict)  # parameters and wired inputs
    # absolute keys of wired outputs; other written names get the prefix
    keys: Mapping[str, str] = field(default_factory=dict)
    retry: RetryCount | None = None
    repeat: RepeatCount | None = None
    for_each: ForEachCount | None = None
    failure: LastFailure | None = None

    def key(self, name: str) -> str:
        """Return the absolute key to which a name is written."""
        return self.keys.get(name, self.prefix + name)

    def getter(self, name: str) -> Getter:
        """Return the function that reads a name's value; it raises NoValue before the first write."""
        if name in SPECIAL:
            fresh = {
                "retry": RetryCount,
                "repeat": RepeatCount,
                "for_each": ForEachCount,
                "failure": LastFailure,
            }
            found = getattr(self, name) or fresh[name]()
            return constant(found)
        if name in self.names:
            return self.names[name]
        named = self.analysis.scopes[id(self.definition)].names[name]
        if named.origin == "constant":
            return constant(named.value)
        get = self.board.get
        key = self.key(name)

        def read() -> Any:
            entry = get(key)
            if entry is None:
                raise NoValue(f"'{name}' has not been written yet")
            return entry.value

        return read


def getter(value: Value, scope: InstanceScope) -> Getter:
    """Reads a value of a port or a modifier."""
    if isinstance(value, Given):
        return constant(value.value)
    compiled = _placed(compile_expression(value.expression, scope.getter), value)
    return lambda: plain(compiled())


def condition(value: Value, scope: InstanceScope) -> Condition:
    """Return a condition, with the values for the sentence that explains why it does not hold."""
    assert isinstance(value, ComputedValue)
    names = {reference.name for reference in references(value.expression)}
    reads = {name: scope.getter(name) for name in sorted(names.difference(SPECIAL))}
    for name, shown in (
        ("retry", "attempt"),
        ("repeat", "round"),
        ("for_each", "index"),
        ("failure", "code"),
    ):
        if name in names:
            reads[f"{name}.{shown}"] = _field(scope.getter(name), shown)
    return Condition(
        value.text, _placed(compile_condition(value.expression, scope.getter), value), reads
    )


def _placed(get: Callable[[], T], value: ComputedValue) -> Callable[[], T]:
    """Name the file and line of an expression that gives no value, also where another one reads it."""

    def read() -> T:
        try:
            return get()
        except NoValue as missing:
            raise missing.at(
                f"{PurePath(value.where.source.path).name}:{value.where.line}"
            ) from None

    return read


def _field(get: Getter, name: str) -> Getter:
    return lambda: getattr(get(), name)
