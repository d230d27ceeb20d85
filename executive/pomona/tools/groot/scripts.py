"""The script language of BehaviorTree.CPP → expressions and assignments of tree files, as far as both mean the same."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import Any

from pomona.executive.language.expression import ExpressionSyntaxError, parse_expression
from pomona.executive.language.expression_run import compile_expression
from pomona.executive.reasons import NoValue
from pomona.tools.groot.keys import NAME, KeyNames, ScriptError
from pomona.tools.groot.yaml_text import scalar

_TOKEN = re.compile(
    r"\s*(?:(?P<number>\d+\.?\d*(?:[eE][-+]?\d+)?)(?![\w.])|(?P<text>'[^']*')|(?P<name>[A-Za-z_@][A-Za-z0-9_]*)"
    r"|(?P<operator>&&|\|\||==|!=|<=|>=|[-+*/<>!()]))"
)
_WORDS = {"&&": "and", "||": "or", "!": "not"}
_ASSIGNMENT = re.compile(r"\s*([A-Za-z_@][A-Za-z0-9_]*)\s*(:=|=|\+=|-=|\*=|/=)(?!=)(.*)", re.DOTALL)
_STATEMENT = re.compile(r"(?:'[^']*'|[^';])+")


def condition_of(script: str, keys: KeyNames) -> str:
    """Translate a script into an expression. Raises ScriptError: it has no equivalent expression."""
    tokens, at = [], 0
    text = script.strip()
    while at < len(text):
        match = _TOKEN.match(text, at)
        if match is None:
            raise ScriptError(f"has the script '{script}', which is no expression here")
        at = match.end()
        tokens.append(match)
    signs = [token["operator"] for token in tokens]
    if any(sign == "!" and _negates_an_operand(signs, index) for index, sign in enumerate(signs)):
        raise ScriptError(
            f"has the script '{script}', where ! stands before a number: it binds tighter than 'not'"
        )
    words = [_word(token, keys) for token in tokens]
    found = " ".join(words).replace("( ", "(").replace(" )", ")")
    try:
        parse_expression(found)
    except ExpressionSyntaxError as error:
        raise ScriptError(f"has the script '{script}': {error.message}") from None
    return found


def _negates_an_operand(signs: Sequence[str | None], at: int) -> bool:
    """Return True if an operator other than `&&` and `||` follows the operand of the `!` at a place."""
    end = at + 1
    while end < len(signs) and signs[end] in ("!", "-"):
        end += 1
    depth = 0
    while end < len(signs):
        depth += (signs[end] == "(") - (signs[end] == ")")
        end += 1
        if depth <= 0:
            break
    return end < len(signs) and signs[end] not in ("&&", "||", ")")


def _word(match: re.Match[str], keys: KeyNames) -> str:
    name = match["name"]
    if name is not None:
        return str(name) if name in ("true", "false") else keys.read(name)
    operator = match["operator"]
    return (
        _WORDS.get(operator, operator) if operator is not None else match["number"] or match["text"]
    )


def statements_of(script: str) -> list[str]:
    """Return the parts of a script; the last one is its value."""
    return [part for part in _STATEMENT.findall(script) if part.strip()]


def assignments_of(script: str, keys: KeyNames) -> list[tuple[str, str]]:
    """Return names with the values that a script gives them, in order.

    Raises ScriptError: it does something else as well.
    """
    found = []
    for statement in statements_of(script):
        match = _ASSIGNMENT.fullmatch(statement)
        if match is None or not NAME.fullmatch(keys.target(match[1])):
            raise ScriptError(
                f"has the script '{script}', which does more than assign values to ports"
            )
        name, operator, value = keys.target(match[1]), match[2], condition_of(match[3], keys)
        if operator not in ("=", ":="):
            value = f"{{{name}}} {operator[0]} ({value})"
        found.append((name, _literal(value)))
    if not found:
        raise ScriptError("has an empty script")
    return found


def _no_port(name: str) -> Callable[[], Any]:
    raise NoValue(name)


def _literal(value: str) -> str:
    """Return a value of `set`: a literal, or an expression with braces."""
    if "{" in value:
        return value
    if re.fullmatch(r"-? ?\d+\.?\d*(e[-+]?\d+)?|true|false", value):
        return value.replace(" ", "")
    if re.fullmatch(r"'[^']*'", value):
        return value[1:-1]
    try:
        computed = compile_expression(parse_expression(value), _no_port)
        return scalar(computed())
    except (NoValue, ExpressionSyntaxError):
        raise ScriptError(f"computes '{value}' without any port") from None
