"""Expressions as functions without arguments: compiled once when the tree is built, cheap in the tick."""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping
from enum import Enum
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
            return lambda: [get() for get in getters]
        case Unary(operator="not"):
            operand = compile_condition(expression.operand, names)
            return lambda: not operand()
        case Unary():
            return _negated(compile_expression(expression.operand, names))
        case Call():
            function = _FUNCTIONS[expression.function]
            arguments = [compile_expression(argument, names) for argument in expression.arguments]
            return _guarded(lambda: function(*(get() for get in arguments)))
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
    return _apply(_ARITHMETIC[expression.operator], expression.left, expression.right, names)


def _apply(function: Callable[[Any, Any], Any], left: Expression, right: Expression, names: GetterOf) -> Getter:
    get_left, get_right = compile_expression(left, names), compile_expression(right, names)
    return _guarded(lambda: function(get_left(), get_right()))


def _negated(get: Getter) -> Getter:
    return _guarded(lambda: -get())


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
