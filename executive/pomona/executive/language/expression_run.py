"""Expressions as functions without arguments, compiled once; and the cases, known before the run, that make one true.

A value is bounded, so that a tree that feeds values back into themselves exhausts neither time nor memory. Whole
numbers are exact and at most `MOST_WHOLE`, other results are finite floats, lists have at most `MOST_ITEMS` items at
all levels. Only numbers are calculated with, so a text never grows.
"""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable, Mapping, Sequence
from enum import Enum
from numbers import Number
from typing import Any, assert_never

from pomona.executive.language.expression import (
    SPECIAL,
    Binary,
    Constant,
    Expression,
    FunctionCall,
    Index,
    Items,
    Member,
    Reference,
    Unary,
    references,
)
from pomona.executive.nodes.facts import MAX_CASES, Case, Fact, Plain, Possible, merged
from pomona.executive.reasons import NoValue
from pomona.executive.values.findings import Located

Getter = Callable[[], Any]


MOST_WHOLE = (
    2**63 - 1
)  # of a whole number, on both sides of zero: records and other programs keep 64 bits
MOST_ITEMS = 10_000  # of a list, with those of the lists in it; longer ones come from skills, which choose their own size

GetterOf = Callable[
    [str], Getter
]  # returns the getter of a name; the getter raises NoValue without a value

_ARITHMETIC: Mapping[str, Callable[[Any, Any], Any]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}
_FUNCTIONS: Mapping[str, Callable[..., Any]] = {
    "abs": abs,
    "len": len,
    "max": lambda *values: max(values),
    "min": lambda *values: min(values),
}


def compile_expression(expression: Expression, names: GetterOf) -> Getter:
    """Return a function that gives the expression's value now.

    The function raises NoValue when there is none.
    """
    match expression:
        case Constant():
            value = expression.value
            return lambda: value
        case Reference():
            return names(expression.name)
        case Member():
            return _field(compile_expression(expression.of, names), expression.name)
        case Index():
            return _apply(operator.getitem, expression.of, expression.index, names)
        case Items():
            getters = [compile_expression(item, names) for item in expression.items]
            return lambda: _bounded_list([get() for get in getters])
        case Unary(operator="not"):
            operand = compile_condition(expression.operand, names)
            return lambda: not operand()
        case Unary():
            return _negated(compile_expression(expression.operand, names))
        case FunctionCall():
            function = _FUNCTIONS[expression.function]
            arguments = [compile_expression(argument, names) for argument in expression.arguments]
            return _guarded(lambda: _bounded_number(function(*(get() for get in arguments))))
        case Binary():
            return _binary(expression, names)
        case _:
            assert_never(expression)


def compile_condition(expression: Expression, names: GetterOf) -> Callable[[], bool]:
    """Like `compile_expression`, for an expression that must be true or false."""
    get = compile_expression(expression, names)

    def condition() -> bool:
        value = get()
        if isinstance(value, bool):
            return value
        if type(value).__name__ in ("bool_", "bool"):  # numpy's
            return bool(value)
        raise NoValue(f"a condition must be true or false, this is {value!r}")

    return condition


def _binary(expression: Binary, names: GetterOf) -> Getter:
    if expression.operator in ("and", "or"):
        left = compile_condition(expression.left, names)
        right = compile_condition(expression.right, names)
        return (
            (lambda: left() and right())
            if expression.operator == "and"
            else (lambda: left() or right())
        )
    if expression.operator in ("==", "!="):
        wanted = expression.operator == "=="
        return _apply(lambda a, b: _equal(a, b) is wanted, expression.left, expression.right, names)
    if expression.operator in ("in", "not in"):
        wanted = expression.operator == "in"
        return _apply(
            lambda a, b: any(_equal(a, item) for item in b) is wanted,
            expression.left,
            expression.right,
            names,
        )
    function = _ARITHMETIC[expression.operator]
    if expression.operator in ("+", "-", "*", "/"):
        return _apply(
            lambda a, b: _calculated(function, a, b), expression.left, expression.right, names
        )
    return _apply(function, expression.left, expression.right, names)


def _apply(
    function: Callable[[Any, Any], Any], left: Expression, right: Expression, names: GetterOf
) -> Getter:
    get_left = compile_expression(left, names)
    get_right = compile_expression(right, names)
    return _guarded(lambda: function(get_left(), get_right()))


def _negated(get: Getter) -> Getter:
    return _guarded(lambda: _bounded_number(-get()))


def _calculated(function: Callable[[Any, Any], Any], a: Any, b: Any) -> Any:
    """Return the bounded result of an operation on two numbers."""
    for operand in (a, b):
        if not isinstance(operand, Number):
            raise NoValue(f"only numbers are calculated with, this is a {type(operand).__name__}")
    result = function(a, b)
    if (
        isinstance(result, float)
        and not math.isfinite(result)
        and math.isfinite(a)
        and math.isfinite(b)
    ):
        raise NoValue("the result is too large for a number")
    return _bounded_number(result)


def _bounded_number(value: Any) -> Any:
    """Return a value as it is; raise NoValue for a whole number beyond `MOST_WHOLE`."""
    if isinstance(value, int) and not -MOST_WHOLE <= value <= MOST_WHOLE:
        words = (
            "the result is too large for a whole number: its size is at most 2^63 - 1, about 9.2e18"
        )
        raise NoValue(
            f"{words}; write one operand with a decimal point to calculate with rounded numbers"
        )
    return value


def _bounded_list(items: list[Any]) -> list[Any]:
    """Return a list as it is; raise NoValue if it and the lists in it hold more than `MOST_ITEMS` items."""
    left = MOST_ITEMS
    waiting: list[Sequence[Any]] = [items]
    while waiting:
        inner = waiting.pop()
        left -= len(inner)
        if left < 0:
            raise NoValue(f"a list has at most {MOST_ITEMS} items, with those of the lists in it")
        waiting += [item for item in inner if isinstance(item, (list, tuple))]
    return items


def _guarded(compute: Getter) -> Getter:
    def value() -> Any:
        try:
            return compute()
        except (ArithmeticError, LookupError, TypeError, ValueError) as error:
            raise NoValue(f"{type(error).__name__}: {error}") from error

    return value


def _field(get: Getter, name: str) -> Getter:
    def value() -> Any:
        of = get()
        try:
            return of[name] if isinstance(of, Mapping) else getattr(of, name)
        except (AttributeError, KeyError):
            raise NoValue(f"{type(of).__name__} has no field '{name}' now") from None

    return value


def _equal(left: Any, right: Any) -> bool:
    """Equality in which an enum's member equals its name and its value."""
    if isinstance(left, Enum) and isinstance(right, str):
        return right in (left.name, left.value)
    if isinstance(right, Enum) and isinstance(left, str):
        return left in (right.name, right.value)
    return bool(left == right)


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


def fact_of(
    expression: Expression, known: Mapping[str, Any], where: Located, text: str
) -> Fact | None:
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
        left = _fold(expression.left, known)
        right = _fold(expression.right, known)
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
            left = _cases(expression.left, wanted, known)
            right = _cases(expression.right, wanted, known)
            if (expression.operator == "or") is wanted:
                both = (*left, *right)
                return (
                    _ANYTHING if any(not case for case in both) or len(both) > MAX_CASES else both
                )
            if len(left) * len(right) > MAX_CASES:
                return _ANYTHING
            return tuple(merged(one, other) for one in left for other in right)
        case Binary() if expression.operator in _NEGATED:
            return _comparison(expression, wanted, known)
        case Reference() | Member() | Index():
            return ({said(expression): Possible(among=frozenset({wanted}))},)
        case Constant() | Items() | Unary() | Binary() | FunctionCall():
            return () if _fold(expression, known) is (not wanted) else _ANYTHING
        case _:
            assert_never(expression)


def _comparison(expression: Binary, wanted: bool, known: Mapping[str, Any]) -> tuple[Case, ...]:
    operator = expression.operator if wanted else _NEGATED[expression.operator]
    left = _fold(expression.left, known)
    right = _fold(expression.right, known)
    if isinstance(left, Plain) and isinstance(right, Plain):
        return () if _fold(expression, known) is (not wanted) else _ANYTHING
    about = expression.left
    if isinstance(left, Plain) and operator in _FLIPPED:
        about = expression.right
        operator = _FLIPPED[operator]
        right = left
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
    counts = isinstance(about, FunctionCall) and about.function in ("len", "abs")
    return Possible(low=0.0) if counts else Possible(low=-math.inf)


def _word(value: Plain) -> Plain:
    """A member of an enum may be written by its name or its value: RRT_CONNECT is RRTConnect."""
    return re.sub(r"[\W_]", "", value).casefold() if isinstance(value, str) else value


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
        case FunctionCall():
            return f"{expression.function}({', '.join(map(said, expression.arguments))})"
        case _:
            assert_never(expression)


def _looks_inside(expression: Expression) -> bool:
    """Return True if it reads a part of a value, which may live on."""
    return isinstance(expression, (Index, Member)) or any(map(_looks_inside, expression.parts))
