"""The expression language of tree files: syntax tree, tokenizer and parser. Never Python's `eval`.

    {measured.inlier_ratio} > 0.6 and {measured.dimensions[1]} < 90 mm
    failure.code in [NO_PATH, TIMEOUT]
    {retry.attempt} * 5 mm

Grammar, loosest first: `or`, `and`, `not`, one comparison (`== != < <= > >= in, not in`), `+ -`, `* /`, unary `-`,
then `.field` and `[index]`. `{name}` reads a port; `failure`, `retry`, `repeat` and `for_each` need no braces; any
other bare word is a text (a failure code, an enum's member). Numbers may carry a unit.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

from pomona.executive.ports import QUANTITIES, Quantity

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
class FunctionCall(_Written):
    """`function(arguments)`."""

    function: str
    arguments: tuple[Expression, ...]

    @property
    def parts(self) -> tuple[Expression, ...]:
        return self.arguments


Expression = Constant | Reference | Member | Index | Items | Unary | Binary | FunctionCall
"""A node of the syntax tree. Functions that distinguish them end with `assert_never`, so mypy finds omissions."""


def references(expression: Expression) -> list[Reference]:
    """Return all references in an expression, in order."""
    if isinstance(expression, Reference):
        return [expression]
    return [found for part in expression.parts for found in references(part)]


def comparisons_of_words(expression: Expression) -> list[Binary]:
    """Return the parts that compare one bare word with another, and so no value."""
    if isinstance(expression, Binary) and all(
        isinstance(p, Constant) and p.symbol for p in expression.parts
    ):
        return [expression]
    return [found for part in expression.parts for found in comparisons_of_words(part)]


OR, AND, NOT, COMPARISON, SUM, PRODUCT = range(1, 7)  # how tightly operators bind
_COMPARISONS = ("==", "!=", "<", "<=", ">", ">=", "in", "not")
_BINDS = {
    "or": OR,
    "and": AND,
    **dict.fromkeys(_COMPARISONS, COMPARISON),
    "+": SUM,
    "-": SUM,
    "*": PRODUCT,
    "/": PRODUCT,
}

MAX_LENGTH = 1000
MAX_TOKENS = 160
MAX_DEPTH = 24


class ExpressionSyntaxError(ValueError):
    """An expression that cannot be parsed; `offset` and `length` give the place in its text."""

    def __init__(self, message: str, offset: int, length: int = 1, hint: str = "") -> None:
        self.message = message
        self.offset = offset
        self.length = length
        self.hint = hint
        super().__init__(message)


UNITS: dict[str, tuple[Quantity, float]] = {
    unit: (quantity, size)
    for quantity in QUANTITIES.values()
    for unit, size in quantity.units.items()
    if not unit[0].isdigit()
}
_UNIT = "|".join(re.escape(unit) for unit in sorted(UNITS, key=len, reverse=True))
_TOKEN = re.compile(
    rf"""\s*(?:
      (?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)(?:[ ]*(?P<unit>{_UNIT})(?![\w]))?
    | (?P<word>[A-Za-z_][A-Za-z0-9_]*)
    | '(?P<single>[^']*)' | "(?P<double>[^"]*)"
    | (?P<operator>==|!=|<=|>=|[-+*/<>(){{}}\[\].,])
    )""",
    re.VERBOSE,
)


_ELSEWHERE = {
    "&&": "write 'and'",
    "||": "write 'or'",
    "!": "write 'not'",
    "=": "write '==' to compare",
    "$": 'write "{name}" without it',
}
"""Signs of other languages, and their replacement."""
_WIRE = re.compile(r"\s*\{\s*([A-Za-z_][A-Za-z0-9_]*)\s*\}\s*")
"""A name in braces and nothing else, as most expressions are."""


@dataclass(frozen=True, slots=True)
class _Token:
    kind: str
    text: str
    offset: int
    end: int
    unit: str | None = None


def _tokenize(text: str) -> list[_Token]:
    tokens: list[_Token] = []
    at = 0
    stop = len(text.rstrip())
    while at < stop:
        match = _TOKEN.match(text, at)
        if match is None:
            offset = at + len(text[at:]) - len(text[at:].lstrip())
            sign = next(
                (sign for sign in _ELSEWHERE if text.startswith(sign, offset)), text[offset]
            )
            raise ExpressionSyntaxError(
                f"'{sign}' means nothing in an expression",
                offset,
                len(sign),
                _ELSEWHERE.get(sign, ""),
            )
        kind = match.lastgroup or ""
        unit = match.group("unit")
        if kind == "unit":
            kind = "number"
        word = match.group(kind)
        kind_read = "text" if kind in ("single", "double") else kind
        tokens.append(_Token(kind_read, word, match.start(kind), match.end(), unit))
        at = match.end()
        if len(tokens) > MAX_TOKENS:
            raise ExpressionSyntaxError(
                "the expression is too long", at, 1, "split it into several nodes"
            )
    tokens.append(_Token("end", "", stop, stop))
    return tokens


@lru_cache(4096)
def parse_expression(text: str) -> Expression:
    """Return the syntax tree of `text`. Results are cached, since an editor checks the same file many times.

    Raises ExpressionSyntaxError: it is no expression; the error has the place and the reason.
    """
    if len(text) > MAX_LENGTH:
        raise ExpressionSyntaxError(f"an expression has at most {MAX_LENGTH} characters", 0)
    wire = _WIRE.fullmatch(text)
    return Reference(*wire.span(1), wire[1]) if wire is not None else _Parser(text).whole()


class _Parser:
    def __init__(self, text: str) -> None:
        self.tokens = _tokenize(text)
        self.position = 0
        self.depth = 0

    @property
    def token(self) -> _Token:
        return self.tokens[self.position]

    def take(self) -> _Token:
        token = self.token
        self.position += 1
        return token

    def at(self, *texts: str) -> bool:
        token = self.tokens[self.position]
        return token.text in texts and token.kind in ("operator", "word")

    def expect(self, text: str, why: str) -> _Token:
        if not self.at(text):
            raise self.wrong(f"'{text}' is missing {why}")
        return self.take()

    def wrong(self, message: str, hint: str = "") -> ExpressionSyntaxError:
        token = self.token
        return ExpressionSyntaxError(message, token.offset, max(1, token.end - token.offset), hint)

    def whole(self) -> Expression:
        if self.token.kind == "end":
            raise self.wrong("the expression is empty")
        found = self.nested()
        if self.token.kind == "end":
            return found
        if (
            isinstance(found, Constant)
            and isinstance(found.value, (int, float))
            and self.token.kind == "word"
        ):
            raise self.wrong(f"'{self.token.text}' is no unit", "known units: " + ", ".join(UNITS))
        raise self.wrong(f"'{self.token.text}' is not expected here")

    def expression(self, least: int = OR) -> Expression:
        """Parse an operand and the operators behind it whose precedence is at least `least`."""
        left = self.operand(least)
        while True:
            token = self.tokens[self.position]
            level = _BINDS.get(token.text, 0) if token.kind in ("operator", "word") else 0
            if level < least or not level:
                return left
            self.position += 1
            operator = token.text
            if operator == "not":
                self.expect("in", "after 'not'")
                operator = "not in"
            right = self.expression(level + 1)
            left = Binary(left.offset, right.end, operator, left, right)
            if level == COMPARISON and self.at(*_COMPARISONS):
                raise self.wrong("comparisons cannot be chained", "join two comparisons with 'and'")

    def operand(self, least: int) -> Expression:
        """One operand, with the `not` and `-` before it."""
        token = self.tokens[self.position]
        if (
            token.text not in ("not", "-")
            or token.kind == "text"
            or (token.text == "not" and least > NOT)
        ):
            return self.postfix(self.primary())
        starts = []
        while self.at(token.text):
            starts.append(self.take().offset)
        found = self.expression(COMPARISON) if token.text == "not" else self.postfix(self.primary())
        for start in reversed(starts):
            found = Unary(start, found.end, "not" if token.text == "not" else "-", found)
        return found

    def nested(self) -> Expression:
        """Return a whole expression inside of another."""
        self.depth += 1
        if self.depth > MAX_DEPTH:
            raise self.wrong(f"nested more than {MAX_DEPTH} levels deep")
        found = self.expression()
        self.depth -= 1
        return found

    def postfix(self, found: Expression) -> Expression:
        while self.at(".", "["):
            if self.take().text == ".":
                if self.token.kind != "word":
                    raise self.wrong("a field's name is missing after '.'")
                name = self.take()
                found = Member(found.offset, name.end, found, name.text)
            else:
                index = self.nested()
                found = Index(found.offset, self.expect("]", "after the index").end, found, index)
        return found

    def primary(self) -> Expression:
        token = self.token
        if token.kind == "number":
            return self.number(self.take())
        if token.kind == "text":
            return Constant(self.take().offset - 1, token.end, token.text)
        if token.kind == "word":
            return self.word(self.take())
        if self.at("("):
            self.take()
            found = self.nested()
            self.expect(")", "after the expression in brackets")
            return found
        if self.at("["):
            start = self.take().offset
            items, end = self.listed("]", "after the list")
            return Items(start, end, items)
        if self.at("{"):
            return self.reference()
        at_end = token.kind == "end"
        raise self.wrong(
            "something is missing at the end" if at_end else f"'{token.text}' is not expected here"
        )

    def number(self, token: _Token) -> Constant:
        if token.text.isdigit() and len(token.text) < 19 and token.unit is None:
            return Constant(token.offset, token.end, int(token.text))
        quantity, size = UNITS[token.unit] if token.unit is not None else (None, 1.0)
        value = float(token.text) * size
        if not math.isfinite(value):
            raise ExpressionSyntaxError("this number is too large", token.offset, len(token.text))
        return Constant(token.offset, token.end, value, quantity)

    def word(self, token: _Token) -> Expression:
        if token.text in ("true", "false"):
            return Constant(token.offset, token.end, token.text == "true")
        if token.text == "none":
            return Constant(token.offset, token.end, None)
        if token.text in ("and", "or", "not", "in"):
            raise ExpressionSyntaxError(
                f"'{token.text}' is not expected here", token.offset, len(token.text)
            )
        if self.at("("):
            if token.text not in FUNCTIONS:
                message = f"no function '{token.text}'; there are {', '.join(FUNCTIONS)}"
                raise ExpressionSyntaxError(message, token.offset, len(token.text))
            self.take()
            arguments, end = self.listed(")", f"after the arguments of {token.text}")
            return FunctionCall(token.offset, end, token.text, arguments)
        if token.text in SPECIAL:
            return Reference(token.offset, token.end, token.text)
        return Constant(token.offset, token.end, token.text, symbol=True)

    def listed(self, closing: str, why: str) -> tuple[tuple[Expression, ...], int]:
        items: list[Expression] = []
        while not self.at(closing):
            items.append(self.nested())
            if not self.at(","):
                break
            self.take()
        return tuple(items), self.expect(closing, why).end

    def reference(self) -> Expression:
        self.take()
        if self.token.kind != "word":
            raise self.wrong("a port's name is missing after '{'")
        name = self.take()
        found = self.postfix(Reference(name.offset, name.end, name.text))
        if not self.at("}"):
            hint = "only a port's name and its fields stand in braces: '{a} + {b}', not '{a + b}'"
            raise self.wrong("'}' is missing", hint)
        self.take()
        return found
