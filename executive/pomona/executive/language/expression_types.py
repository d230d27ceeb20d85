"""Static types of expressions: every mistake in one is found before the run."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from enum import Enum
from typing import Protocol, assert_never

from pomona.executive.language.expression import (
    Binary,
    Constant,
    Expression,
    FunctionCall,
    Index,
    Items,
    Member,
    Reference,
    Unary,
)
from pomona.executive.language.value_types import (
    ANY,
    NONE,
    SI_NUMBER,
    ListType,
    ValueType,
    can_flow,
    comparable,
    describe,
    element_type,
    fields_of,
    is_numeric,
)
from pomona.executive.ports import Quantity
from pomona.executive.values.findings import Instead, did_you_mean

MAX_TOLD = 8  # fields that a message lists


class TypeScope(Protocol):
    """Context of an expression: the meaning of its names, and the place to report errors."""

    def type_of(self, reference: Reference) -> ValueType:
        """Return the type of a name; report an unknown name and return ANY."""

    def failure_codes(self) -> Iterable[str] | None:
        """Return codes that `failure.code` can have here; None when any."""

    def failed(self) -> str:
        """Return the node that `failure` describes."""

    def renamed_failures(self) -> Mapping[str, str]:
        """Failure codes of the previous version, each with its present name."""

    def report(self, at: Expression, code: str, message: str, hint: str = "") -> None:
        """Report an error in a part of the expression."""


def type_of(expression: Expression, scope: TypeScope) -> ValueType:
    """Return the type of an expression's value; report errors to the scope and return ANY where the type is unknown."""
    match expression:
        case Constant():
            return _constant(expression)
        case Reference():
            return scope.type_of(expression)
        case Member():
            return _field(expression, scope)
        case Index():
            return _index(expression, scope)
        case Items():
            kinds = {type_of(item, scope) for item in expression.items}
            return ListType(kinds.pop() if len(kinds) == 1 else ANY)
        case Unary(operator="not"):
            _require_bool(expression.operand, scope, "'not'")
            return bool
        case Unary():
            return _require_number(expression.operand, scope, "'-'")
        case Binary():
            return _binary(expression, scope)
        case FunctionCall():
            return _call(expression, scope)
        case _:
            assert_never(expression)


def check_condition(expression: Expression, scope: TypeScope) -> None:
    """Report everything wrong in an expression that must be true or false."""
    _require_bool(expression, scope, "a condition")


def _constant(constant: Constant) -> ValueType:
    if constant.quantity is not None:
        return constant.quantity
    return NONE if constant.value is None else type(constant.value)


def _field(expression: Member, scope: TypeScope) -> ValueType:
    of = type_of(expression.of, scope)
    fields = fields_of(of)
    if fields is None or (isinstance(of, type) and issubclass(of, Mapping)):
        return ANY
    if expression.name not in fields:
        known = _told(fields)
        hint = did_you_mean(expression.name, fields)
        if isinstance(expression.of, Constant) and expression.of.symbol:
            hint = f'write "{{{expression.of.value}.{expression.name}}}" to read a port'
        hint = hint or (f"it has {known}" if known else "")
        scope.report(
            expression, "unknown-field", f"{describe(of)} has no field '{expression.name}'", hint
        )
        return ANY
    return fields[expression.name]


def _told(fields: Mapping[str, ValueType]) -> str:
    """Return the first fields with their types, those that can be compared before the others."""

    def place(name: str) -> int:
        found = fields[name]
        if isinstance(found, ListType):
            return 1 if isinstance(found.element, Quantity) else 3
        return 0 if is_numeric(found) else 2

    first = sorted(fields, key=place)
    said = [
        f"{name} ({describe(fields[name]).removeprefix('a ').removeprefix('an ')})"
        for name in first[:MAX_TOLD]
    ]
    return ", ".join(said) + (f" and {len(first) - MAX_TOLD} more" if len(first) > MAX_TOLD else "")


def _index(expression: Index, scope: TypeScope) -> ValueType:
    of = type_of(expression.of, scope)
    index = type_of(expression.index, scope)
    if index not in (int, ANY):
        scope.report(
            expression.index, "expression-type", f"an index is an int, this is {describe(index)}"
        )
    element = element_type(of)
    if element is None:
        scope.report(expression.of, "expression-type", f"{describe(of)} has no elements")
        return ANY
    length = of.length if isinstance(of, ListType) else None
    at = _whole_number(expression.index)
    if length is not None and at is not None and not -length <= at < length:
        message = f"there is no element {at}: this has {length}"
        scope.report(
            expression.index, "no-element", message, f"the first is 0, the last {length - 1}"
        )
    return element


def _whole_number(index: Expression) -> int | None:
    """Return a literal index, which may be negative."""
    if isinstance(index, Unary) and index.operator == "-":
        found = _whole_number(index.operand)
        return None if found is None else -found
    return index.value if isinstance(index, Constant) and type(index.value) is int else None


def _require_bool(expression: Expression, scope: TypeScope, who: str) -> None:
    found = type_of(expression, scope)
    if found not in (bool, ANY):
        hint = "compare it: '… > 0'" if is_numeric(found) else _wire_hint(expression)
        scope.report(
            expression,
            "expression-type",
            f"{who} takes true or false, this is {describe(found)}",
            hint,
        )


def _require_number(expression: Expression, scope: TypeScope, who: str) -> ValueType:
    found = type_of(expression, scope)
    if not is_numeric(found):
        scope.report(
            expression,
            "expression-type",
            f"{who} takes numbers, this is {describe(found)}",
            _wire_hint(expression),
        )
        return ANY
    return found


def _binary(expression: Binary, scope: TypeScope) -> ValueType:
    operator = expression.operator
    if operator in ("and", "or"):
        _require_bool(expression.left, scope, f"'{operator}'")
        _require_bool(expression.right, scope, f"'{operator}'")
        return bool
    if operator in ("+", "-", "*", "/"):
        left = _require_number(expression.left, scope, f"'{operator}'")
        right = _require_number(expression.right, scope, f"'{operator}'")
        return _arithmetic(expression, left, right, scope)
    left = type_of(expression.left, scope)
    right = type_of(expression.right, scope)
    if operator in ("in", "not in"):
        element = element_type(right)
        if element is None:
            scope.report(
                expression.right,
                "expression-type",
                f"'{operator}' takes a list, this is {describe(right)}",
            )
        elif not comparable(left, element):
            message = (
                f"{describe(left)} is never in a list of {describe(element).removeprefix('a ')}"
            )
            scope.report(expression, "expression-type", message)
        _check_symbols(expression.left, left, expression.right, scope)
        return bool
    is_equality = operator in ("==", "!=")
    if is_equality:
        _check_symbols(expression.left, left, expression.right, scope)
        _check_symbols(expression.right, right, expression.left, scope)
    for side, kind in ((expression.left, left), (expression.right, right)):
        if not is_equality and not is_numeric(kind):
            whole = side.name if isinstance(side, (Member, Reference)) else "…"
            hint = (
                f"take one element: {whole}[0]"
                if element_type(kind) is not None
                else _wire_hint(side)
            )
            scope.report(
                side,
                "expression-type",
                f"'{operator}' compares numbers, this is {describe(kind)}",
                hint,
            )
            return bool
    if not comparable(left, right):
        message = f"{describe(left)} and {describe(right)} cannot be compared"
        scope.report(expression, "expression-type", message, _unit_hint(left, right))
    return bool


def _wire_hint(expression: Expression) -> str:
    """Return how a word that was written without braces is read as a port."""
    word = expression.value if isinstance(expression, Constant) else None
    return (
        f'write "{{{word}}}" to read a port'
        if isinstance(word, str) and word.isidentifier()
        else ""
    )


def _unit_hint(left: ValueType, right: ValueType) -> str:
    for quantity, other in ((left, right), (right, left)):
        if isinstance(quantity, Quantity) and other in (int, float):
            return f"give the number a unit: {', '.join(quantity.units)}"
    return ""


def _arithmetic(
    expression: Binary, left: ValueType, right: ValueType, scope: TypeScope
) -> ValueType:
    if ANY in (left, right):
        return ANY
    plain = (int, float)
    if expression.operator in ("+", "-"):
        if left == right:
            return left
        if left in plain and right in plain:
            return float
        if can_flow(left, right) or can_flow(right, left):
            return right if left is SI_NUMBER else left
        word = "added" if expression.operator == "+" else "subtracted"
        message = f"{describe(left)} and {describe(right)} cannot be {word}"
        scope.report(expression, "expression-type", message, _unit_hint(left, right))
        return ANY
    if expression.operator == "/" and left == right:
        return float
    if right in plain:
        if left is int:
            return int if right is int and expression.operator == "*" else float
        return left
    if expression.operator == "*" and left in plain:
        return right
    if SI_NUMBER in (left, right):
        return SI_NUMBER
    word = "multiplied" if expression.operator == "*" else "divided"
    message = (
        f"{describe(left)} and {describe(right)} cannot be {word}: the result has no name here"
    )
    scope.report(expression, "expression-type", message)
    return ANY


def _check_symbols(
    value: Expression, value_type: ValueType, other: Expression, scope: TypeScope
) -> None:
    """A word that an enum or a failure code is compared with must be one that it can be."""
    known: set[str] | None = None
    if isinstance(value_type, type) and issubclass(value_type, Enum):
        known = {word for member in value_type for word in (member.name, str(member.value))}
    elif isinstance(value, Member) and value.name == "code" and isinstance(value.of, Reference):
        codes = scope.failure_codes() if value.of.name == "failure" else None
        known = None if codes is None else set(codes)
    if known is None:
        return
    for word in other.items if isinstance(other, Items) else (other,):
        if isinstance(word, Constant) and isinstance(word.value, str) and word.value not in known:
            new = scope.renamed_failures().get(word.value, "")
            renamed = Instead(f"it is called '{new}' now", word.value, new) if new in known else ""
            message = f"{scope.failed() or 'the node before'} cannot fail with {word.value}"
            can = "it can with"
            if isinstance(value_type, type) and issubclass(value_type, Enum):
                message = f"this is never {word.value}"
                can = "it can be"
            hint = renamed or did_you_mean(word.value, known) or f"{can} {', '.join(sorted(known))}"
            scope.report(word, "removed" if renamed else "unknown-code", message, hint)


def _call(expression: FunctionCall, scope: TypeScope) -> ValueType:
    arguments = [type_of(argument, scope) for argument in expression.arguments]
    if expression.function in ("abs", "len") and len(arguments) != 1:
        scope.report(
            expression,
            "expression-type",
            f"{expression.function} takes one argument, got {len(arguments)}",
        )
        return ANY
    if expression.function == "len":
        if element_type(arguments[0]) is None and arguments[0] is not str:
            scope.report(
                expression, "expression-type", f"len takes a list, this is {describe(arguments[0])}"
            )
        return int
    if not arguments:
        scope.report(
            expression, "expression-type", f"{expression.function} takes at least one argument"
        )
        return ANY
    for argument, kind in zip(expression.arguments, arguments, strict=True):
        if not is_numeric(kind):
            message = f"{expression.function} takes numbers, this is {describe(kind)}"
            scope.report(argument, "expression-type", message)
            return ANY
        if not comparable(kind, arguments[0]):
            message = f"{describe(arguments[0])} and {describe(kind)} cannot be compared"
            scope.report(argument, "expression-type", message, _unit_hint(kind, arguments[0]))
            return ANY
    return arguments[0]
