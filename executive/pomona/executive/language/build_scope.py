"""Meaning of names while one instance of a definition is built: getters for reading, keys for writing."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import PurePath
from typing import Any, TypeVar

from pomona.executive.board import Board
from pomona.executive.language.bind_ports import plain
from pomona.executive.language.check import Analysis
from pomona.executive.language.expression import SPECIAL, references
from pomona.executive.language.expression_run import Getter, compile_condition, compile_expression
from pomona.executive.language.model import Definition
from pomona.executive.language.scope import ComputedValue, Given, Value
from pomona.executive.nodes.conditions import Condition
from pomona.executive.nodes.surroundings import ForEachCount, LastFailure, RepeatCount, RetryCount
from pomona.executive.reasons import NoValue

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
            fresh = {"retry": RetryCount, "repeat": RepeatCount, "for_each": ForEachCount, "failure": LastFailure}
            found = getattr(self, name) or fresh[name]()
            return constant(found)
        if name in self.names:
            return self.names[name]
        named = self.analysis.scopes[id(self.definition)].names[name]
        if named.origin == "constant":
            return constant(named.value)
        get, key = self.board.get, self.key(name)

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
    for name, shown in (("retry", "attempt"), ("repeat", "round"), ("for_each", "index"), ("failure", "code")):
        if name in names:
            reads[f"{name}.{shown}"] = _field(scope.getter(name), shown)
    return Condition(value.text, _placed(compile_condition(value.expression, scope.getter), value), reads)


def _placed(get: Callable[[], T], value: ComputedValue) -> Callable[[], T]:
    """Name the file and line of an expression that gives no value, also where another one reads it."""

    def read() -> T:
        try:
            return get()
        except NoValue as missing:
            raise missing.at(f"{PurePath(value.where.source.path).name}:{value.where.line}") from None

    return read


def _field(get: Getter, name: str) -> Getter:
    return lambda: getattr(get(), name)
