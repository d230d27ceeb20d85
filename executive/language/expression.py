"""The expression language of tree files: its syntax tree."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from executive.ports import Quantity

SPECIAL = ("failure", "retry", "repeat", "for_each")
FUNCTIONS = ("abs", "len", "max", "min")


@dataclass(frozen=True, slots=True)
class Expression:
    """A node of the syntax tree; `text[offset:end]` is how it is written."""

    offset: int
    end: int


@dataclass(frozen=True, slots=True)
class Constant(Expression):
    """A literal; `quantity` is the dimension of a number with a unit, already in SI. A bare word is a `symbol`."""

    value: bool | int | float | str | None
    quantity: Quantity | None = None
    symbol: bool = False


@dataclass(frozen=True, slots=True)
class Reference(Expression):
    """A port's value, or one of the special names."""

    name: str


@dataclass(frozen=True, slots=True)
class Member(Expression):
    """`of.name`: a field of a value."""

    of: Expression
    name: str


@dataclass(frozen=True, slots=True)
class Index(Expression):
    """`of[index]`: an item of a value."""

    of: Expression
    index: Expression


@dataclass(frozen=True, slots=True)
class Items(Expression):
    """`[a, b, …]`: a list that is written out."""

    items: tuple[Expression, ...]


@dataclass(frozen=True, slots=True)
class Unary(Expression):
    """`-x` or `not x`."""

    operator: Literal["-", "not"]
    operand: Expression


@dataclass(frozen=True, slots=True)
class Binary(Expression):
    """`left operator right`."""

    operator: str
    left: Expression
    right: Expression


@dataclass(frozen=True, slots=True)
class Call(Expression):
    """`function(arguments)`."""

    function: str
    arguments: tuple[Expression, ...]


def parts(expression: Expression) -> tuple[Expression, ...]:
    """What an expression is made of, one level down."""
    match expression:
        case Member():
            return (expression.of,)
        case Index():
            return (expression.of, expression.index)
        case Unary():
            return (expression.operand,)
        case Binary():
            return (expression.left, expression.right)
        case Items():
            return expression.items
        case Call():
            return expression.arguments
        case _:
            return ()


def references(expression: Expression) -> list[Reference]:
    """All references in an expression, in order."""
    if isinstance(expression, Reference):
        return [expression]
    return [found for part in parts(expression) for found in references(part)]
