"""The script language of BehaviorTree.CPP → expressions and assignments of tree files, as far as both mean the same."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

from pomona.executive.language.expression import ExpressionSyntaxError, parse_expression
from pomona.executive.language.expression_run import compile_expression
from pomona.executive.reasons import NoValue
from pomona.tools.groot.keys import NAME, KeyNames, NoEquivalentError
from pomona.tools.groot.yaml_text import Written

_TOKEN = re.compile(
    r"\s*(?:(?P<number>\d+\.?\d*(?:[eE][-+]?\d+)?)(?![\w.])|(?P<text>'[^']*')|(?P<name>[A-Za-z_@][A-Za-z0-9_]*)"
    r"|(?P<operator>&&|\|\||==|!=|<=|>=|[-+*/<>!()]))"
)
_WORDS = {"&&": "and", "||": "or"}
_BETWEEN = ("&&", "||", "==", "!=", "<=", ">=", "<", ">", "+", "-", "*", "/")
_ASSIGNMENT = re.compile(r"\s*([A-Za-z_@][A-Za-z0-9_]*)\s*(:=|=|\+=|-=|\*=|/=)(?!=)(.*)", re.DOTALL)
_STATEMENT = re.compile(r"(?:'[^']*'|[^';])+")


def condition_of(script: str, keys: KeyNames) -> str:
    """Translate a script into an expression. Raises NoEquivalentError: it has no equivalent expression."""
    found = _Translation(script, keys).expression()
    try:
        parse_expression(found)
    except ExpressionSyntaxError as error:
        raise NoEquivalentError(f"has the script '{script}': {error.message}") from None
    return found


class _Translation:
    """A script's tokens; operators before an operand bind tighter than all others, unlike `not`."""

    def __init__(self, script: str, keys: KeyNames) -> None:
        self.script = script
        self.keys = keys
        self.tokens: list[re.Match[str]] = []
        text = script.strip()
        at = 0
        while at < len(text):
            token = _TOKEN.match(text, at)
            if token is None:
                raise self.refused("which is no expression here")
            self.tokens.append(token)
            at = token.end()

    def refused(self, why: str) -> NoEquivalentError:
        return NoEquivalentError(f"has the script '{self.script}', {why}")

    def next_operator(self) -> str | None:
        return self.tokens[0]["operator"] if self.tokens else None

    def expression(self) -> str:
        """Return the text of all tokens up to the end, or up to a parenthesis that closes."""
        found = self.inside()
        if self.tokens:
            raise self.refused("which is no expression here")
        return found

    def inside(self) -> str:
        parts = [self.operand()]
        compares = False
        while (sign := self.next_operator()) in _BETWEEN:
            self.tokens.pop(0)
            compares = compares or sign not in _WORDS
            parts += [_WORDS.get(sign, sign), self.operand()]
        if compares and any(part.startswith("(not ") for part in parts):
            raise self.refused("where ! stands before a number")
        return " ".join(parts)

    def operand(self) -> str:
        if not self.tokens:
            raise self.refused("which ends too early")
        token = self.tokens.pop(0)
        sign = token["operator"]
        name = token["name"]
        if sign == "!":
            return f"(not {self.operand()})"
        if sign == "-":
            return f"-{self.operand()}"
        if sign == "(":
            found = f"({self.inside()})"
            if self.next_operator() != ")":
                raise self.refused("which lacks a parenthesis")
            self.tokens.pop(0)
            return found
        if sign is not None:
            raise self.refused(f"where {sign} has nothing before it")
        if name is not None:
            return name if name in ("true", "false") else self.keys.read(name)
        return token["number"] or token["text"]


def statements_of(script: str) -> list[str]:
    """Return the parts of a script; the last one is its value."""
    return [part for part in _STATEMENT.findall(script) if part.strip()]


def assignments_of(script: str, keys: KeyNames) -> list[tuple[str, str]]:
    """Return names with the values that a script gives them, in order.

    Raises NoEquivalentError: it does something else as well.
    """
    found = []
    for statement in statements_of(script):
        match = _ASSIGNMENT.fullmatch(statement)
        if match is None or not NAME.fullmatch(keys.target(match[1])):
            raise NoEquivalentError(
                f"has the script '{script}', which does more than assign values"
            )
        name = keys.target(match[1])
        operator = match[2]
        value = condition_of(match[3], keys)
        if operator not in ("=", ":="):
            value = f"{{{name}}} {operator[0]} ({value})"
        found.append((name, _literal(value)))
    if not found:
        raise NoEquivalentError("has an empty script")
    return found


def _literal(value: str) -> str:
    """Return a value of `set`: an expression with braces, or the value of one without."""
    if "{" in value:
        return Written(value)
    try:
        computed = compile_expression(parse_expression(value), _no_port)()
    except (NoValue, ExpressionSyntaxError):
        raise NoEquivalentError(f"computes '{value}' without any port") from None
    if isinstance(computed, str):
        return computed
    return Written(str(computed).lower())


def _no_port(name: str) -> Callable[[], Any]:
    raise NoValue(name)
