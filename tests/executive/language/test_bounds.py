"""Expressions that feed their values back into themselves end in a typed failure, in little time and memory."""

from __future__ import annotations

import math
import re

import pytest
from hypothesis import given, strategies as st

from pomona.executive.language.expression import parse_expression
from pomona.executive.language.expression_run import MOST_ITEMS, MOST_WHOLE, compile_expression
from pomona.executive.reasons import NoValue, reason_of


def value(text: str, **names: object) -> object:
    return compile_expression(parse_expression(text), lambda name: lambda: names[name])()


@pytest.mark.parametrize(
    ("start", "again", "words"),
    [
        ("3", "{n} * {n}", "too large for a whole number"),
        ("-3", "{n} * 1000000000", "too large for a whole number"),
        ("1.5", "{n} * 1e300", "too large for a number"),
        ("[1, 2]", "[{n}, {n}]", f"at most {MOST_ITEMS} items"),
    ],
)
def test_a_value_that_grows_fails_where_it_is_calculated(
    built, start: str, again: str, words: str
) -> None:
    run = built(
        f"root:\n  sequence:\n    - set: {{n: {start}}}\n    - {{set: {{n: '{again}'}}, name: Grow, repeat: 40}}\n"
    )
    assert run.run() == "FAILURE"
    reason = reason_of(run.tree.root)
    while reason.causes:
        reason = reason.causes[-1]
    assert reason.code == "BAD_VALUE"
    assert reason.node_path.endswith("Grow")
    assert words in reason.message
    assert re.search(r", in \w+\.yaml:6$", reason.message)


@pytest.mark.parametrize(
    "text", ["{s} + {s}", "{s} * 1000000", "[1] + [2]", "{s} - {s}", "[1, 2] * 2"]
)
def test_only_numbers_are_calculated_with(text: str) -> None:
    with pytest.raises(NoValue, match="only numbers are calculated with"):
        value(text, s="abc")


@given(st.integers(-(2**70), 2**70), st.integers(-(2**70), 2**70), st.sampled_from("+-*"))
def test_whole_numbers_are_exact_or_refused(a: int, b: int, operator: str) -> None:
    exact = {"+": a + b, "-": a - b, "*": a * b}[operator]
    try:
        found = value(f"{{a}} {operator} {{b}}", a=a, b=b)
    except NoValue:
        assert abs(exact) > MOST_WHOLE
    else:
        assert (type(found), found) == (int, exact)
        assert abs(exact) <= MOST_WHOLE


@given(
    st.floats(allow_nan=False, allow_infinity=False),
    st.floats(allow_nan=False, allow_infinity=False),
)
def test_finite_numbers_give_finite_numbers_or_none(a: float, b: float) -> None:
    for operator in "+-*/":
        try:
            found = value(f"{{a}} {operator} {{b}}", a=a, b=b)
        except NoValue:
            continue
        assert isinstance(found, float)
        assert math.isfinite(found)


def test_a_counter_counts_exactly_to_the_largest_whole_number() -> None:
    assert value("{n} + 1", n=MOST_WHOLE - 1) == MOST_WHOLE
    with pytest.raises(NoValue, match="decimal point"):
        value("{n} + 1", n=MOST_WHOLE)
    assert value("{n} + 1.0", n=MOST_WHOLE) == 2.0**63


def test_an_overflow_of_constants_is_found_before_the_run(findings_of) -> None:
    found = findings_of("constants: {c: 100000000000000000}\nroot: {check: '{c} * 1000 + 1 > 1'}\n")
    assert [(finding.code, finding.severity, finding.line) for finding in found] == [
        ("overflow", "error", 4)
    ]
