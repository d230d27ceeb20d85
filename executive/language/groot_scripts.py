"""The script language of BehaviorTree.CPP → expressions and assignments of tree files, as far as both mean the same."""

from __future__ import annotations

import re
from collections.abc import Callable

from executive.language.expression import SPECIAL
from executive.language.expression_parser import ExpressionSyntaxError, parse_expression

_TOKEN = re.compile(
    r"\s*(?:(?P<number>\d+\.?\d*(?:[eE][-+]?\d+)?)(?![\w.])|(?P<text>'[^']*')|(?P<name>[A-Za-z_]\w*)"
    r"|(?P<operator>&&|\|\||==|!=|<=|>=|[-+*/<>!()]))"
)
_WORDS = {"&&": "and", "||": "or", "!": "not"}
_ASSIGNMENT = re.compile(r"\s*([A-Za-z_]\w*)\s*(:=|=|\+=|-=|\*=|/=)(?!=)(.*)", re.DOTALL)
_NAME = re.compile(r"[a-z][a-z0-9_]*")


class ScriptError(ValueError):
    """A script that cannot be said as an expression; the text ends a sentence about it."""


def condition_of(script: str, called: Callable[[str], str] = str) -> str:
    """An expression; `called` gives what a name is called in tree files.

    Raises:
        ScriptError: it says something that expressions cannot say.
    """
    words, at = [], 0
    text = script.strip()
    while at < len(text):
        match = _TOKEN.match(text, at)
        if match is None:
            raise ScriptError(f"has the script '{script}', which is no expression here")
        at = match.end()
        words.append(_word(match, called))
    found = " ".join(words).replace("( ", "(").replace(" )", ")")
    try:
        parse_expression(found)
    except ExpressionSyntaxError as error:
        raise ScriptError(f"has the script '{script}': {error.message}") from None
    return found


def _word(match: re.Match[str], called: Callable[[str], str]) -> str:
    name = match["name"]
    if name in ("true", "false"):
        return str(name)
    if name is not None:
        name = called(name)
        if name in SPECIAL or not _NAME.fullmatch(name):
            raise ScriptError(f"uses '{name}', which is no name of a port here")
        return f"{{{name}}}"
    operator = match["operator"]
    return _WORDS.get(operator, operator) if operator is not None else match["number"] or match["text"]


def assignments_of(script: str, called: Callable[[str], str] = str) -> list[tuple[str, str]]:
    """Names with the values that a script gives them, in order.

    Raises:
        ScriptError: it does something else as well.
    """
    found = []
    for statement in filter(str.strip, script.split(";")):
        match = _ASSIGNMENT.fullmatch(statement)
        if match is None or not _NAME.fullmatch(called(match[1])):
            raise ScriptError(f"has the script '{script}', which does more than assign values to ports")
        name, operator, value = called(match[1]), match[2], condition_of(match[3], called)
        if operator not in ("=", ":="):
            value = f"{{{name}}} {operator[0]} ({value})"
        found.append((name, _literal(value)))
    if not found:
        raise ScriptError("has an empty script")
    return found


def _literal(value: str) -> str:
    """A value of `set`: a literal, or an expression with braces."""
    if "{" in value:
        return value
    if re.fullmatch(r"-? ?\d+\.?\d*(e[-+]?\d+)?|true|false", value):
        return value.replace(" ", "")
    if re.fullmatch(r"'[^']*'", value):
        return value[1:-1]
    raise ScriptError(f"computes '{value}' without any port")
