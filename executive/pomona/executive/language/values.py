"""The text behind a port or a modifier → a `Value`: a literal, or an expression of a fitting type."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import islice
from typing import Any

from pomona.executive.language.expression import (
    SPECIAL,
    Expression,
    ExpressionSyntaxError,
    Reference,
    parse_expression,
)
from pomona.executive.language.expression_run import overflows, zero_divisors
from pomona.executive.language.expression_types import check_condition, type_of
from pomona.executive.language.literals import LiteralError, literal
from pomona.executive.language.scope import (
    ComputedValue,
    Given,
    Named,
    Read,
    Resolved,
    Scope,
    Value,
)
from pomona.executive.language.value_types import ANY, ValueType, can_flow, describe
from pomona.executive.nodes.context import COUNTERS, Around, LastFailure
from pomona.executive.nodes.facts import UNKNOWN
from pomona.executive.ports import RATIO, Port, Quantity
from pomona.executive.values.findings import Edit, Findings, Located, Spot, Within, did_you_mean
from pomona.executive.values.units import is_within
from pomona.executive.values.yaml_nodes import YamlMapping, YamlNode, YamlScalar

_IN_BRACES = re.compile(r"\{\s*([A-Za-z_][A-Za-z0-9_]*)")
ALWAYS_POSSIBLE = frozenset(
    {"BAD_VALUE"}
)  # codes with which any node may fail that computes a value


@dataclass(slots=True, eq=False)
class _Stand:
    """Where one expression stands (a `TypeScope`)."""

    reader: ValueReader
    scalar: YamlScalar
    around: Around
    slot: str
    required: bool

    def spot(self, at: Expression) -> Located:
        scalar = self.scalar
        if scalar.line != scalar.end_line:
            return scalar
        return Within(scalar, at.offset, max(1, at.end - at.offset))

    def report(self, at: Expression, code: str, message: str, hint: str = "") -> None:
        self.reader.findings.error(self.spot(at), code, message, hint)

    def failure_codes(self) -> Iterable[str] | None:
        codes = self.around.failure
        return None if codes is None or UNKNOWN in codes else codes | ALWAYS_POSSIBLE

    def failed(self) -> str:
        return self.around.failed

    def renamed_failures(self) -> Mapping[str, str]:
        return self.reader.scope.skills.renamed_failures

    def type_of(self, reference: Reference) -> ValueType:
        name = reference.name
        if name in SPECIAL:
            return self._special(reference)
        named = self.reader.scope.names.get(name)
        if named is None:
            self._unknown(reference)
            return ANY
        named.read = True
        self.reader.resolved.reads.append(
            Read(self.slot, name, self.spot(reference), self.required)
        )
        return named.type

    def calculations(self, expression: Expression) -> None:
        """Report divisions by a constant zero, and results of constants that are too large."""
        if any(sign in self.scalar.text for sign in "+-*/"):
            names = self.reader.scope.names
            known = {name: named.value for name, named in names.items() if named.value is not None}
            for divisor in zero_divisors(expression, known):
                self.report(divisor, "division", "this is zero: nothing can be divided by it")
            for part in overflows(expression, known):
                self.report(part, "overflow", "the result is too large for a number")

    def _special(self, reference: Reference) -> ValueType:
        name = reference.name
        if name == "failure":
            if self.around.failure is None:
                message = "nothing can have failed before this"
                hint = "'failure' is known after the first child of a fallback, in retry_if and in on_failure"
                self.report(reference, "no-failure", message, hint)
            return LastFailure
        inside_subtree = not self.reader.scope.definition.main
        if name not in self.around.counters and not inside_subtree:
            message = f"there is no {name} around this node"
            self.report(
                reference,
                "no-counter",
                message,
                f"add '{name}: …' to this node or to one around it",
            )
        return COUNTERS[name]

    def _unknown(self, reference: Reference) -> None:
        scope = self.reader.scope
        main = scope.definition.file.parameters
        hint = did_you_mean(reference.name, scope.names)
        if reference.name in main and not scope.definition.main:
            hint = f"a subtree sees only its own names: add '{reference.name}' to its 'in' and wire it where it is called"
        elif not hint:
            writers = [
                skill for skill, there in scope.skills.items() if reference.name in there.outputs
            ]
            known = "known names: " + ", ".join(islice(scope.names, 12)) if scope.names else ""
            wire = f'{reference.name}: "{{{reference.name}}}"'
            verb = "writes" if len(writers) == 1 else "write"
            hint = (
                f"{' and '.join(writers[:2])} {verb} one: put it before this node, with {wire}"
                if writers
                else known
            )
        self.report(
            reference,
            "unknown-port",
            f"nothing writes '{reference.name}' and nothing declares it",
            hint,
        )


@dataclass(slots=True, eq=False)
class ValueReader:
    """Reads the values of one node."""

    findings: Findings
    scope: Scope
    resolved: Resolved

    def parsed(self, scalar: YamlScalar) -> Expression | None:
        """Return a text as an expression; a syntax error is reported at its character, and gives None."""
        try:
            return parse_expression(scalar.text)
        except ExpressionSyntaxError as error:
            where: Located = scalar
            if scalar.line == scalar.end_line:
                where = Spot(
                    scalar.source, scalar.line, scalar.text_column + error.offset, error.length
                )
            self.findings.error(where, "expression", error.message, error.hint)
            for name in _IN_BRACES.findall(scalar.text):  # one mistake, one finding
                if name in self.scope.names:
                    self.scope.names[name].read = True
            return None

    def condition(self, slot: str, node: YamlNode, around: Around) -> Value | None:
        """Return an expression that must be true or false."""
        if not isinstance(node, YamlScalar):
            hint = 'write it in quotes: "{port} > 1"'
            self.findings.error(node, "shape", f"'{slot}' takes an expression", hint)
            return None
        expression = self.parsed(node)
        if expression is None:
            return None
        stand = _Stand(self, node, around, slot, True)
        check_condition(expression, stand)
        stand.calculations(expression)
        return ComputedValue(expression, bool, node.text, node)

    def value(
        self, slot: str, node: YamlNode, port: Port, around: Around, who: str
    ) -> Value | None:
        """Return the value of a port: a literal of its type, or an expression (any text with braces)."""
        if isinstance(node, YamlScalar) and "{" in node.text:
            return self._computed(slot, node, port, around, who)
        if isinstance(node, YamlMapping) and _forgot_quotes(node):
            name = next(iter(node.entries), "name")
            if name in self.scope.names:  # one mistake, one finding
                self.scope.names[name].read = True
            edits = (
                [Edit(node.line, node.column, node.length, f'"{{{name}}}"')]
                if node.line == node.end_line
                else []
            )
            self.findings.error(
                node, "shape", f"{who} is wired without quotes", f'write "{{{name}}}"', edits
            )
            return None
        if (
            isinstance(node, YamlScalar)
            and not port.required
            and (node.is_null or node.text == "none")
        ):
            return Given(None, node)
        try:
            value = literal(node, static_type(port), port.choices)
        except LiteralError as error:
            self.findings.error(error.where, "value", f"{who}: {error.message}", error.hint)
            return None
        return Given(value, node) if self.in_range(node, value, port, who) else None

    def _computed(
        self, slot: str, node: YamlScalar, port: Port, around: Around, who: str
    ) -> Value | None:
        expression = self.parsed(node)
        if expression is None:
            return None
        stand = _Stand(self, node, around, slot, port.required)
        found = type_of(expression, stand)
        stand.calculations(expression)
        named = self.scope.names.get(expression.name) if isinstance(expression, Reference) else None
        wanted = static_type(port)
        if not can_flow(found, wanted):
            message = f"{who} takes {describe(wanted)}, '{node.text}' is {describe(found)}{_written_by(named)}"
            self.findings.error(node, "port-type", message)
            return None
        if named is not None and named.origin in ("parameter", "constant"):
            return Given(named.value, node) if self.in_range(node, named.value, port, who) else None
        if named is not None and named.may_be_none and port.required:
            message = f"{who} must have a value, and '{node.text}' may have none"
            self.findings.error(
                node, "unset", message, f"give the input '{node.text.strip('{}')}' a default"
            )
        return ComputedValue(expression, found, node.text, node)

    def in_range(self, where: Located, value: Any, port: Port, who: str) -> bool:
        """Return whether a value is in a port's range; report one that is not."""
        problem = out_of_range(value, port, getattr(where, "text", ""))
        if not problem:
            return True
        is_percent = port.type == RATIO and not out_of_range(value / 100, port)
        self.findings.error(
            where, "range", f"{who} {problem}", f"write '{value:g} %'" if is_percent else ""
        )
        return False


def out_of_range(value: Any, port: Port, written: str = "") -> str:
    """Explain why a value is outside the port's range or choices, in the unit of the text that gave it.

    An empty text means that it is inside.
    """
    if port.choices and isinstance(value, str) and value not in port.choices:
        return f"must be one of {', '.join(port.choices)}, not '{value}'"
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return ""
    low, high = port.bounds
    if low is not None and not is_within(value, low, math.inf):
        bound = low
        words = "is at least {}, {} is below"
    elif high is not None and not is_within(value, -math.inf, high):
        bound = high
        words = "is at most {}, {} is above"
    else:
        return ""
    if isinstance(port.type, Quantity):
        return words.format(port.type.format(bound, written), port.type.format(value, written))
    return words.format(f"{bound:g}", f"{value:g}")


def static_type(port: Port) -> ValueType:
    """Return the port's type; a port of `object` takes anything."""
    return ANY if port.type is object else port.type


def _written_by(named: Named | None) -> str:
    if named is None:
        return ""
    if named.origin == "written":
        return f" (written by {named.by}, line {named.where.line})"
    return f" ({named.origin}, line {named.where.line})"


def _forgot_quotes(node: YamlMapping) -> bool:
    """`port: {name}` is a mapping with one key and no value in YAML."""
    values = [value for _, value in node.entries.values()]
    return len(values) == 1 and isinstance(values[0], YamlScalar) and values[0].is_null
