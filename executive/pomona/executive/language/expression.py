"""The expression language of tree files: its syntax tree."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from pomona.executive.ports import Quantity

SPECIAL = ("failure", "retry", "repeat", "for_each")
FUNCTIONS = ("abs", "len", "max", "min")


@dataclass(frozen=True, slots=True)
class _Written:
    """Base of all expressions; `text[offset:end]` is the source text."""

    offset: int
    end: int

    @property
    def parts(self) -> tuple[Expression, ...]:
        return ()


@dataclass(frozen=True, slots=True)
class Constant(_Written):
    """A literal; `quantity` is the dimension of a number with a unit, already in SI. A bare word is a `symbol`."""

    value: bool | int | float | str | None
    quantity: Quantity | None = None
    symbol: bool = False


@dataclass(frozen=True, slots=True)
class Reference(_Written):
    """A port's value, or one of the special names."""

    name: str


@dataclass(frozen=True, slots=True)
class Member(_Written):
    """`of.name`: a field of a value."""

    of: Expression
    name: str

    @property
    def parts(self) -> tuple[Expression, ...]:
        return (self.of,)


@dataclass(frozen=True, slots=True)
class Index(_Written):
    """`of[index]`: an item of a value."""

    of: Expression
    index: Expression

    @property
    def parts(self) -> tuple[Expression, ...]:
        return (self.of, self.index)


@dataclass(frozen=True, slots=True)
class Items(_Written):
    """`[a, b, …]`: a list that is written out."""

    items: tuple[Expression, ...]

    @property
    def parts(self) -> tuple[Expression, ...]:
        return self.items


@dataclass(frozen=True, slots=True)
class Unary(_Written):
    """`-x` or `not x`."""

    operator: Literal["-", "not"]
    operand: Expression

    @property
    def parts(self) -> tuple[Expression, ...]:
        return (self.operand,)


@dataclass(frozen=True, slots=True)
class Binary(_Written):
    """`left operator right`."""

    operator: str
    left: Expression
    right: Expression

    @property
    def parts(self) -> tuple[Expression, ...]:
        return (self.left, self.right)


@dataclass(frozen=True, slots=True)
class Call(_Written):
    """`function(arguments)`."""

    function: str
    arguments: tuple[Expression, ...]

    @property
    def parts(self) -> tuple[Expression, ...]:
        return self.arguments


Expression = Constant | Reference | Member | Index | Items | Unary | Binary | Call
"""A node of the syntax tree. Functions that distinguish them end with `assert_never`, so mypy finds omissions."""


def references(expression: Expression) -> list[Reference]:
    """Return all references in an expression, in order."""
    if isinstance(expression, Reference):
        return [expression]
    return [found for part in expression.parts for found in references(part)]
