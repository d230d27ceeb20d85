"""A script means the same as in BehaviorTree.CPP, or is refused."""

from __future__ import annotations

import operator

import pytest
from hypothesis import given, strategies as st

from pomona.executive.language.expression import parse_expression
from pomona.executive.language.expression_run import compile_expression
from pomona.executive.reasons import NoValue
from pomona.tools.groot.keys import KeyNames, NoEquivalentError
from pomona.tools.groot.scripts import condition_of

VALUES = {"a": 2, "b": 3, "p": True, "q": False}
_BINDS = {"||": 6, "&&": 8, "==": 10, "!=": 10, "<": 10, ">": 10, "+": 16, "-": 16, "*": 18}
"""Binding powers of BehaviorTree.CPP 4.10 (script_parser.cpp); prefix operators bind tighter than all."""
_COMPUTE = {"==": operator.eq, "!=": operator.ne, "<": operator.lt, ">": operator.gt,
            "+": operator.add, "-": operator.sub, "*": operator.mul}  # fmt: skip


def evaluate(tokens: list[str]) -> float:
    """Return the number that BehaviorTree.CPP computes: precedence climbing over its binding powers."""

    def operand() -> float:
        token = tokens.pop(0)
        if token == "!":
            return float(not operand())
        if token == "-":
            return -operand()
        if token == "(":
            found = expression(0)
            tokens.pop(0)
            return found
        return float(VALUES[token]) if token in VALUES else float(token)

    def expression(least: int) -> float:
        left = operand()
        while tokens and _BINDS.get(tokens[0], -1) >= least:
            sign = tokens.pop(0)
            right = expression(_BINDS[sign] + 1)
            if sign in ("&&", "||"):
                left = (
                    float(bool(left) and bool(right))
                    if sign == "&&"
                    else float(bool(left) or bool(right))
                )
            else:
                left = float(_COMPUTE[sign](left, right))
        return left

    return expression(0)


def _grown(inner: st.SearchStrategy[list[str]]) -> st.SearchStrategy[list[str]]:
    return st.one_of(
        st.builds(lambda sign, x: [sign, *x], st.sampled_from(["!", "-"]), inner),
        st.builds(lambda x: ["(", *x, ")"], inner),
        st.builds(lambda x, sign, y: [*x, sign, *y], inner, st.sampled_from(sorted(_BINDS)), inner),
    )


@given(
    st.recursive(
        st.sampled_from([*VALUES, "0", "1", "2"]).map(lambda name: [name]), _grown, max_leaves=6
    )
)
def test_a_translated_script_has_the_value_of_behaviortree_cpp(tokens: list[str]) -> None:
    try:
        translated = condition_of(" ".join(tokens), KeyNames(set()))
        found = compile_expression(
            parse_expression(translated), lambda name: lambda: VALUES[name]
        )()
    except (NoEquivalentError, NoValue):
        return  # refused by the import, or by the run
    comparisons = sum(token in ("==", "!=", "<", ">") for token in tokens)
    if comparisons < 2:  # chains are refused above; nested ones compare truth with numbers
        assert float(found) == evaluate(list(tokens)), translated


@pytest.mark.parametrize(
    ("script", "expected"),
    [
        ("!a && b", "(not {a}) and {b}"),
        ("!(a == b)", "(not ({a} == {b}))"),
        ("a || !(b) && !!c", "{a} or (not ({b})) and (not (not {c}))"),
        ("(!a) == b", "((not {a})) == {b}"),
        ("-a + b > 1", "-{a} + {b} > 1"),
        ("@a == 1", "{a} == 1"),
    ],
)
def test_operators_keep_their_precedence(script: str, expected: str) -> None:
    assert condition_of(script, KeyNames(set())) == expected


@pytest.mark.parametrize(
    "script",
    ["!n == 1", "!n != 0", "!n < 1", "!n + 1", "!(n) * 2", "!!n == 1", "!-n == 1", "a && !n == 1", "a == !b", "1 - !a",
     "a == b == c", "a & b", "a | b", "a ^ b", "~a", "a .. b", "a ? b : c", "a = 1", "größe > 1", "0x1F", "a b",
     "f(a)"],
)  # fmt: skip
def test_a_script_that_would_mean_something_else_is_refused(script: str) -> None:
    with pytest.raises(NoEquivalentError):
        condition_of(script, KeyNames(set()))
