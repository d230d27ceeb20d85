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

    @property
    def parts(self) -> tuple[Expression, ...]:
        """What it is made of, one level down."""
        return ()


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

    @property
    def parts(self) -> tuple[Expression, ...]:
        return (self.of,)


@dataclass(frozen=True, slots=True)
class Index(Expression):
    """`of[index]`: an item of a value."""

    of: Expression
    index: Expression

    @property
    def parts(self) -> tuple[Expression, ...]:
        return (self.of, self.index)


@dataclass(frozen=True, slots=True)
class Items(Expression):
    """`[a, b, …]`: a list that is written out."""

    items: tuple[Expression, ...]

    @property
    def parts(self) -> tuple[Expression, ...]:
        return self.items


@dataclass(frozen=True, slots=True)
class Unary(Expression):
    """`-x` or `not x`."""

    operator: Literal["-", "not"]
    operand: Expression

    @property
    def parts(self) -> tuple[Expression, ...]:
        return (self.operand,)


@dataclass(frozen=True, slots=True)
class Binary(Expression):
    """`left operator right`."""

    operator: str
    left: Expression
    right: Expression

    @property
    def parts(self) -> tuple[Expression, ...]:
        return (self.left, self.right)


@dataclass(frozen=True, slots=True)
class Call(Expression):
    """`function(arguments)`."""

    function: str
    arguments: tuple[Expression, ...]

    @property
    def parts(self) -> tuple[Expression, ...]:
        return self.arguments


def references(expression: Expression) -> list[Reference]:
    """All references in an expression, in order."""
    if isinstance(expression, Reference):
        return [expression]
    return [found for part in expression.parts for found in references(part)]
