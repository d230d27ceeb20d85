"""Expressions: their values beside Python's own, their types, and facts that follow from a true condition."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np
import pytest

from pomona.executive.language.expression import Expression, Reference, parse_expression
from pomona.executive.language.expression_run import (
    NoValue,
    always_same,
    compile_condition,
    compile_expression,
    overflows,
    said,
    zero_divisors,
)
from pomona.executive.language.expression_types import check_condition, type_of
from pomona.executive.language.value_types import ANY, NONE, SI_NUMBER, ListType, describe
from pomona.executive.ports import LENGTH, TIME


class Side(Enum):
    """Two sides."""

    LEFT = "on the left"
    RIGHT = "on the right"


@dataclass(frozen=True)
class Fruit:
    """A fruit."""

    width: float
    names: tuple[str, ...] = ("a", "b")


NAMES: dict[str, Any] = {
    "a": 3, "b": -2, "x": 0.5, "y": 2.0, "yes": True, "no": False, "words": "one", "some": [1, 2, 3], "most": 2**63 - 1,
    "side": Side.LEFT, "fruit": Fruit(0.08), "table": {"rows": 4}, "none": None, "flag": np.bool_(True),
}  # fmt: skip


def parsed(text: str, names: Iterable[str]) -> Expression:
    """An expression in which these names are ports: a name alone would be a word."""
    ports = rf"(?<![\w.'])(?:{'|'.join(names)})\b(?!')"
    return parse_expression(re.sub(ports, lambda found: "{" + found[0] + "}", text))


def value(text: str) -> Any:
    return compile_expression(parsed(text, NAMES), lambda name: lambda: NAMES[name])()


@pytest.mark.parametrize(
    "text",
    [
        "a + b * 2", "(a + b) * 2", "a - b - 1", "a / 2", "x * y / 4.0", "-a + 1", "-(a - b)", "a < 3", "a <= 3",
        "a > 3", "a >= 3", "a == 3", "a != 3", "b < a", "yes and no", "yes or no", "no or yes", "not yes",
        "not a > 2 and yes", "a in [1, 3]", "a not in [1, 3]", "b in [1, 3]", "b not in []", "abs(b)", "abs(x - y)",
        "len(some)", "len(words)", "max(a, b, 1)", "min(a, b, 1)", "some[0]", "some[-1]", "some[a - 2]",
        "[a, b]", "[a, [x]]", "words == 'one'", "words != 'one'", "none == 3", "1.5e3 + 0.5", "len([a, b, x])",
    ],
)  # fmt: skip
def test_values_are_those_of_python(text: str) -> None:
    found, expected = value(text), eval(text, {}, NAMES)
    assert found == expected
    assert type(found) is type(expected)


def test_fields_keys_and_members_of_an_enum_are_read() -> None:
    assert value("fruit.width") == 0.08
    assert value("fruit.names[1]") == "b"
    assert value("table.rows") == 4
    for word, equal in (("LEFT", True), ("'on the left'", True), ("RIGHT", False), ("left", False)):
        assert value(f"side == {word}") is equal
        assert value(f"{word} == side") is equal
        assert value(f"side != {word}") is not equal
        assert value(f"side in [{word}]") is equal
        assert value(f"side not in [{word}]") is not equal


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("fruit.weight", "Fruit has no field 'weight' now"), ("table.columns", "dict has no field 'columns' now"),
        ("some[3]", "IndexError"), ("a / 0", "ZeroDivisionError"), ("words + a", "only numbers"),
        ("a + words", "only numbers are calculated with, this is a str"), ("-words", "TypeError"),
        ("a < words", "TypeError"), ("a in b", "TypeError"), ("1.0e308 * 10.0", "too large for a number"),
        ("most + 1", "too large for a whole number"), ("-most - 1", "too large"),
        ("abs(words)", "TypeError"),
    ],
)  # fmt: skip
def test_without_a_value_the_reason_is_told(text: str, words: str) -> None:
    with pytest.raises(NoValue, match=words):
        value(text)


def test_the_largest_whole_numbers_are_values() -> None:
    assert value("(most - 1) + 1") == 2**63 - 1
    assert value("-(most - 1) - 1") == 1 - 2**63
    assert value("max(most, 1)") == 2**63 - 1


def condition(text: str) -> bool:
    return compile_condition(parsed(text, NAMES), lambda name: lambda: NAMES[name])()


def test_a_condition_is_true_or_false_and_nothing_else() -> None:
    assert condition("yes") is True
    assert condition("flag") is True
    assert condition("a > 4") is False
    assert condition("not flag") is False
    for text in ("a", "none", "words", "some"):
        with pytest.raises(NoValue, match="a condition must be true or false, this is"):
            condition(text)
    assert condition("yes or fruit.weight > 1") is True  # the second is not read
    assert condition("no and fruit.weight > 1") is False


# ----------------------------------------------------------------------------------------------------- types

TYPES: dict[str, Any] = {
    "n": int, "f": float, "t": bool, "w": str, "length": LENGTH, "time": TIME, "side": Side, "fruit": Fruit,
    "lengths": ListType(LENGTH), "three": ListType(float, 3), "words": ListType(str), "any": ANY,
}  # fmt: skip


class Scope:
    """The meaning of names, and the findings."""

    def __init__(self) -> None:
        self.found: list[tuple[str, str, str, str]] = []

    def type_of(self, reference: Reference) -> Any:
        return TYPES[reference.name]

    def failure_codes(self) -> tuple[str, ...]:
        return ("NO_PATH", "TIMEOUT")

    def failed(self) -> str:
        return "Plan"

    def renamed_failures(self) -> dict[str, str]:
        return {"NO_WAY": "NO_PATH"}

    def report(self, at: Expression, code: str, message: str, hint: str = "") -> None:
        self.found.append((said(at), code, message, str(hint)))


def typed(text: str) -> tuple[Any, list[tuple[str, str, str, str]]]:
    scope = Scope()
    return type_of(parsed(text, TYPES), scope), scope.found


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        ("n + n", int), ("n + f", float), ("f - n", float), ("n * n", int), ("n / n", float), ("n / f", float),
        ("n * f", float), ("f * n", float), ("length + length", LENGTH), ("length * 2", LENGTH), ("2 * length", LENGTH),
        ("length / 2", LENGTH), ("length / length", float), ("-length", LENGTH), ("-n", int), ("abs(length)", LENGTH),
        ("abs(f)", float), ("max(length, 3 mm)", LENGTH), ("min(n, 2)", int), ("len(lengths)", int), ("len(w)", int),
        ("lengths[0]", LENGTH), ("three[-3]", float), ("three[2]", float), ("length > 3 mm", bool), ("not t", bool),
        ("t and n > 1", bool), ("n in [1, 2]", bool), ("w not in words", bool), ("[1, 2]", ListType(int)),
        ("[1, w]", ListType(ANY)), ("[]", ListType(ANY)), ("none", NONE), ("true", bool), ("3 mm", LENGTH),
        ("'a'", str), ("fruit.width", SI_NUMBER), ("any + 1", ANY), ("any.x", ANY), ("any[0]", ANY), ("side == LEFT", bool),
    ],
)  # fmt: skip
def test_a_sound_expression_has_a_type(text: str, kind: Any) -> None:
    found, findings = typed(text)
    assert findings == []
    assert found == kind, describe(found)


@pytest.mark.parametrize(
    ("text", "at", "message"),
    [
        ("length + time", "(length + time)", "cannot be added"),
        ("length - time", "(length - time)", "cannot be subtracted"),
        ("length * time", "(length * time)", "cannot be multiplied: the result has no name here"),
        ("length / time", "(length / time)", "cannot be divided"), ("2 / length", "(2 / length)", "cannot be divided"),
        ("-w", "w", "'-' takes numbers, this is"), ("not n", "n", "'not' takes true or false, this is"),
        ("t and n", "n", "takes true or false, this is"), ("w or t", "w", "takes true or false, this is"),
        ("n in n", "n", "'in' takes a list, this is"), ("n not in w", "w", "'not in' takes a list, this is"),
        ("length in words", "(length in words)", "is never in a list of"),
        ("three[3]", "3", "there is no element 3: this has 3"), ("three[-4]", "(- 4)", "there is no element -4"),
        ("three[w]", "w", "an index is an int, this is"), ("n[0]", "n", "has no elements"),
        ("fruit.weight", "fruit.weight", "has no field 'weight'"),
        ("abs(n, n)", "abs(n, n)", "abs takes one argument, got 2"),
        ("len(n)", "len(n)", "len takes a list, this is"), ("max()", "max()", "max takes at least one argument"),
        ("max(n, w)", "w", "max takes numbers, this is"), ("min(length, time)", "time", "cannot be compared"),
        ("side == 'up'", "'up'", "this is never up"), ("'up' != side", "'up'", "this is never up"),
        ("side in ['up', LEFT]", "'up'", "this is never up"),
    ],
)  # fmt: skip
def test_what_has_no_type_is_found_in_its_part(text: str, at: str, message: str) -> None:
    _, findings = typed(text)
    assert [found[0] for found in findings] == [at], findings
    assert findings[0][1] in ("expression-type", "unknown-field", "no-element", "unknown-code")
    assert message in findings[0][2]


def test_hints_name_what_is_there() -> None:
    assert typed("three[5]")[1][0][3] == "the first is 0, the last 2"
    assert typed("side == 'zzz'")[1][0][3] == "it can be LEFT, RIGHT, on the left, on the right"
    assert "width" in typed("fruit.weight")[1][0][3]
    scope = Scope()
    check_condition(parsed("n", TYPES), scope)
    assert scope.found == [
        ("n", "expression-type", "a condition takes true or false, this is an int", "compare it: '… > 0'")
    ]  # fmt: skip


# ----------------------------------------------------------------------------------------- known before the run


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("a > 2", True), ("a > 3", False), ("a + 1", None), ("z > 2", None), ("z > 2 and no", None),
        ("1 < 2", True), ("fruit.weight > 1", None), ("words == 'one'", True),
    ],
)  # fmt: skip
def test_a_condition_of_known_values_is_always_the_same(text: str, found: bool | None) -> None:
    assert always_same(parsed(text, [*NAMES, "z"]), NAMES) is found


def test_certain_errors_are_found_before_the_run() -> None:
    def texts(found: list[Expression]) -> list[str]:
        return [said(part) for part in found]

    known = {"zero": 0, "nought": 0.0, "big": 2**62, "a": 1}
    divided = parsed("(z / zero) + z / (a - 1) + z / a + z / nought + z / z", [*known, "z"])
    assert texts(zero_divisors(divided, known)) == ["zero", "(a - 1)", "nought"]
    large = parsed("big * 2 > z and big + big > z and big * 1 > z and big / 0 > z", [*known, "z"])
    assert texts(overflows(large, known)) == ["(big * 2)", "(big + big)"]


@pytest.mark.parametrize(
    ("text", "written"),
    [
        ("a+b*2", "(a + (b * 2))"), ("-a.x[0]", "(- a.x[0])"), ("not  (a or b)", "(not (a or b))"),
        ("max( a,b )", "max(a, b)"), ("[a , 1]", "[a, 1]"), ("a in ['x']", "(a in ['x'])"),
    ],
)  # fmt: skip
def test_equal_expressions_have_one_text(text: str, written: str) -> None:
    assert said(parsed(text, "ab")) == written
    assert said(parsed(written, "ab")) == written


def test_comparison_is_right_for_any_two_numbers() -> None:
    signs = ("<", "<=", ">", ">=", "==", "!=")
    for sign, (left, right) in itertools.product(signs, itertools.product((-1, 0, 1.5), repeat=2)):
        expected = eval(f"{left} {sign} {right}")
        assert always_same(parsed(f"l {sign} r", "lr"), {"l": left, "r": right}) is expected
