"""Expressions → cases: the facts that make a condition true, as far as they are known before the run."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any, assert_never

from pomona.executive.language.expression import (
    SPECIAL,
    Binary,
    Call,
    Constant,
    Expression,
    Index,
    Items,
    Member,
    Reference,
    Unary,
    references,
)
from pomona.executive.language.expression_run import compile_expression
from pomona.executive.nodes.facts import MAX_CASES, Case, Fact, Plain, Possible
from pomona.executive.reasons import NoValue
from pomona.executive.values.findings import Located

_FLIPPED = {"<": ">", "<=": ">=", ">": "<", ">=": "<=", "==": "==", "!=": "!="}
_NEGATED = {
    "<": ">=",
    "<=": ">",
    ">": "<=",
    ">=": "<",
    "==": "!=",
    "!=": "==",
    "in": "not in",
    "not in": "in",
}
_ANYTHING: tuple[Case, ...] = ({},)


def fact_of(expression: Expression, known: Mapping[str, Any], where: Located, text: str) -> Fact | None:
    """Return the fact that a true condition implies, or None if it has none that can be compared.

    `known` are the values before the run by name; `where` and `text` are the condition as it is written.
    """
    cases = _cases(expression, True, known)
    names = frozenset(reference.name for reference in references(expression))
    if cases == _ANYTHING:
        return None
    lasts = not _looks_inside(expression) and not names.intersection(SPECIAL)
    return Fact(cases, names, lasts, text, where)


def always_same(expression: Expression, known: Mapping[str, Any]) -> bool | None:
    """Return the condition's value when it is the same in every run."""
    value = _fold(expression, known)
    return value if isinstance(value, bool) else None


def zero_divisors(expression: Expression, known: Mapping[str, Any]) -> list[Expression]:
    """Return the divisors that are certainly zero."""
    found = [divisor for part in expression.parts for divisor in zero_divisors(part, known)]
    if isinstance(expression, Binary) and expression.operator == "/":
        value = _fold(expression.right, known)
        if isinstance(value, (int, float)) and value == 0:
            found.append(expression.right)
    return found


def overflows(expression: Expression, known: Mapping[str, Any]) -> list[Expression]:
    """Return the calculations whose result is certainly too large."""
    found = [part for inner in expression.parts for part in overflows(inner, known)]
    if isinstance(expression, Binary) and expression.operator in ("+", "-", "*", "/"):
        left, right = _fold(expression.left, known), _fold(expression.right, known)
        zero = expression.operator == "/" and right == 0
        numbers = isinstance(left, (int, float)) and isinstance(right, (int, float))
        if numbers and not zero and _fold(expression, known) is _UNKNOWN:
            found.append(expression)
    return found


def _cases(expression: Expression, wanted: bool, known: Mapping[str, Any]) -> tuple[Case, ...]:
    match expression:
        case Unary(operator="not"):
            return _cases(expression.operand, not wanted, known)
        case Binary(operator="and" | "or"):
            left, right = _cases(expression.left, wanted, known), _cases(expression.right, wanted, known)
            if (expression.operator == "or") is wanted:
                both = (*left, *right)
                return _ANYTHING if any(not case for case in both) or len(both) > MAX_CASES else both
            if len(left) * len(right) > MAX_CASES:
                return _ANYTHING
            return tuple(_merged(one, other) for one in left for other in right)
        case Binary() if expression.operator in _NEGATED:
            return _comparison(expression, wanted, known)
        case Reference() | Member() | Index():
            return ({said(expression): Possible(among=frozenset({wanted}))},)
        case Constant() | Items() | Unary() | Binary() | Call():
            value = _fold(expression, known)
            return () if value is (not wanted) else _ANYTHING
        case _:
            assert_never(expression)


def _comparison(expression: Binary, wanted: bool, known: Mapping[str, Any]) -> tuple[Case, ...]:
    operator = expression.operator if wanted else _NEGATED[expression.operator]
    left, right = _fold(expression.left, known), _fold(expression.right, known)
    if isinstance(left, Plain) and isinstance(right, Plain):
        value = _fold(expression, known)
        return () if value is (not wanted) else _ANYTHING
    about = expression.left
    if isinstance(left, Plain) and operator in _FLIPPED:
        about, operator, right = expression.right, _FLIPPED[operator], left
    possible = _possible(operator, right)
    if possible is None or not references(about):
        return _ANYTHING
    return ({said(about): possible.and_also(_natural(about))},)


def _possible(operator: str, value: object) -> Possible | None:
    if operator in ("in", "not in"):
        items = value if isinstance(value, (list, tuple)) else ()
        words = frozenset(_word(item) for item in items if isinstance(item, Plain))
        if len(words) != len(items) or not items:
            return None
        return Possible(among=words) if operator == "in" else Possible(without=words)
    if not isinstance(value, Plain):
        return None
    if operator == "==":
        return Possible(among=frozenset({_word(value)}))
    if operator == "!=":
        return Possible(without=frozenset({_word(value)}))
    if isinstance(value, str):
        return None
    if operator in ("<", "<="):
        return Possible(high=float(value), below=operator == "<")
    return Possible(low=float(value), above=operator == ">")


def _natural(about: Expression) -> Possible:
    """Return all values that the subject can have."""
    counts = isinstance(about, Call) and about.function in ("len", "abs")
    return Possible(low=0.0) if counts else Possible(low=-math.inf)


def _word(value: Plain) -> Plain:
    """A member of an enum may be written by its name or its value: RRT_CONNECT is RRTConnect."""
    return re.sub(r"[\W_]", "", value).casefold() if isinstance(value, str) else value


def _merged(one: Case, other: Case) -> Case:
    both = dict(one)
    for about, possible in other.items():
        both[about] = both[about].and_also(possible) if about in both else possible
    return both


def _fold(expression: Expression, known: Mapping[str, Any]) -> Any:
    """Return its value, if that is known before the run; else an object that equals nothing."""
    if isinstance(expression, Constant):
        return expression.value
    if not all(reference.name in known for reference in references(expression)):
        return _UNKNOWN
    try:
        return compile_expression(expression, lambda name: lambda: known[name])()
    except NoValue:
        return _UNKNOWN


_UNKNOWN = object()


def said(expression: Expression) -> str:
    """Return one text for equal expressions, independent of spacing."""
    match expression:
        case Constant():
            return repr(expression.value)
        case Reference():
            return expression.name
        case Member():
            return f"{said(expression.of)}.{expression.name}"
        case Index():
            return f"{said(expression.of)}[{said(expression.index)}]"
        case Unary():
            return f"({expression.operator} {said(expression.operand)})"
        case Binary():
            return f"({said(expression.left)} {expression.operator} {said(expression.right)})"
        case Items():
            return f"[{', '.join(map(said, expression.items))}]"
        case Call():
            return f"{expression.function}({', '.join(map(said, expression.arguments))})"
        case _:
            assert_never(expression)


def _looks_inside(expression: Expression) -> bool:
    """Return True if it reads a part of a value, which may live on."""
    return isinstance(expression, (Index, Member)) or any(map(_looks_inside, expression.parts))
