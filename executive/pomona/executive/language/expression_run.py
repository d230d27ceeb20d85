"""Expressions as functions without arguments: compiled once when the tree is built, cheap in the tick.

A value is bounded, so that a tree that feeds values back into themselves exhausts neither time nor memory. Whole
numbers are exact and at most `MOST_WHOLE`, other results are finite floats, lists have at most `MOST_ITEMS` items at
all levels. Only numbers are calculated with, so a text never grows.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping, Sequence
from enum import Enum
from numbers import Number
from typing import Any, assert_never

from pomona.executive.language.expression import (
    Binary,
    Call,
    Constant,
    Expression,
    Index,
    Items,
    Member,
    Reference,
    Unary,
)
from pomona.executive.reasons import NoValue

Getter = Callable[[], Any]


MOST_WHOLE = 2**63 - 1  # of a whole number, on both sides of zero: records and other programs keep 64 bits
MOST_ITEMS = (
    10_000  # of a list, with those of the lists in it; longer ones come from skills, which choose their own size
)

GetterOf = Callable[[str], Getter]  # returns the getter of a name; the getter raises NoValue without a value

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
        case Call():
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
        left, right = compile_condition(expression.left, names), compile_condition(expression.right, names)
        return (lambda: left() and right()) if expression.operator == "and" else (lambda: left() or right())
    if expression.operator in ("==", "!="):
        wanted = expression.operator == "=="
        return _apply(lambda a, b: _equal(a, b) is wanted, expression.left, expression.right, names)
    if expression.operator in ("in", "not in"):
        wanted = expression.operator == "in"
        return _apply(
            lambda a, b: any(_equal(a, item) for item in b) is wanted, expression.left, expression.right, names
        )
    function = _ARITHMETIC[expression.operator]
    if expression.operator in ("+", "-", "*", "/"):
        return _apply(lambda a, b: _calculated(function, a, b), expression.left, expression.right, names)
    return _apply(function, expression.left, expression.right, names)


def _apply(function: Callable[[Any, Any], Any], left: Expression, right: Expression, names: GetterOf) -> Getter:
    get_left, get_right = compile_expression(left, names), compile_expression(right, names)
    return _guarded(lambda: function(get_left(), get_right()))


def _negated(get: Getter) -> Getter:
    return _guarded(lambda: _bounded_number(-get()))


def _calculated(function: Callable[[Any, Any], Any], a: Any, b: Any) -> Any:
    """Return the bounded result of an operation on two numbers."""
    for operand in (a, b):
        if not isinstance(operand, Number):
            raise NoValue(f"only numbers are calculated with, this is a {type(operand).__name__}")
    result = function(a, b)
    if isinstance(result, float) and not math.isfinite(result) and math.isfinite(a) and math.isfinite(b):
        raise NoValue("the result is too large for a number")
    return _bounded_number(result)


def _bounded_number(value: Any) -> Any:
    """Return a value as it is; raise NoValue for a whole number beyond `MOST_WHOLE`."""
    if isinstance(value, int) and not -MOST_WHOLE <= value <= MOST_WHOLE:
        words = "the result is too large for a whole number: its size is at most 2^63 - 1, about 9.2e18"
        raise NoValue(f"{words}; write one operand with a decimal point to calculate with rounded numbers")
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
