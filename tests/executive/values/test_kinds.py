"""Kinds of values: each reads what its JSON Schema allows, and nothing else."""

from __future__ import annotations

import argparse
import math
from typing import Any

import jsonschema
import pytest
import yaml

from pomona.executive.values.findings import Findings, Source
from pomona.executive.values.kinds import (
    AsWritten,
    Counts,
    Flag,
    Kind,
    ListOf,
    MappingOf,
    Measure,
    Number,
    OrWord,
    Row,
    Span,
    Text,
    Whole,
    Words,
    between,
    bounds_schema,
    choose,
)
from pomona.executive.values.units import ANGLE, LENGTH, RATIO
from pomona.executive.values.yaml_nodes import Reader, Refused, YamlNode, YamlScalar, read_yaml

Refusal = tuple[str, str]
"""Code and beginning of a message."""


def read(kind: Kind[Any], text: str, options: dict[str, str] | None = None) -> Any:
    """Return the value of a YAML text, or the refusal."""
    findings = Findings()
    node = read_yaml(Source("a.yaml", text), findings)
    assert isinstance(node, YamlNode)
    scalars: Any = None
    if options is not None:
        scalars = {name: read_yaml(Source("b", value), findings) for name, value in options.items()}
    try:
        return kind.read(node, Reader(findings, "it", scalars))
    except Refused:
        return next((finding.code, finding.message) for finding in findings.sorted())


def fits(kind: Kind[Any], text: str, options: bool = False) -> bool:
    """Return True if the schema allows a YAML text."""
    schema = kind.schema(options)
    jsonschema.Draft202012Validator.check_schema(schema)
    return bool(jsonschema.Draft202012Validator(schema).is_valid(yaml.safe_load(text)))


GOOD: list[tuple[Kind[Any], str, Any]] = [
    (Text("left", "right", "2"), "left", "left"),
    (Text("left", "right", "2"), "2", "2"),
    (Text(pattern="[a-c]+", words="letters"), "abc", "abc"),
    (Text(), "3.5", "3.5"),
    (Text(), "true", "true"),
    (Flag(), "true", True),
    (Flag(), "false", False),
    (Number(), "-1000", -1000.0),
    (Number(0.0, 1.0), "0", 0.0),
    (Number(0.0, 1.0), "1.0", 1.0),
    (Number(low=2.0), "1.0e+9", 1e9),
    (Number(high=2.0), "-1.0e+9", -1e9),
    (Whole(1, 3), "1", 1),
    (Whole(1, 3), "3", 3),
    (Measure(LENGTH), "5 cm", 0.05),
    (Measure(LENGTH, "1 mm", "2 m"), "1 mm", 0.001),
    (Measure(LENGTH, "1 mm", "2 m"), "2 m", 2.0),
    (Measure(ANGLE), "180 deg", math.pi),
    (Measure(RATIO), "0.5", 0.5),
    (Measure(RATIO), "50 %", 0.5),
    (Span(Number(0.0, 1.0)), "0.8", (0.8, 0.8)),
    (Span(Number(0.0, 1.0)), "0.7..0.9", (0.7, 0.9)),
    (Span(Number(0.0, 1.0)), "0.7..0.7", (0.7, 0.7)),
    (Span(Number(0.0, 1.0)), "[0.7, 0.9]", (0.7, 0.9)),
    (Span(Measure(LENGTH)), "[7 mm, 1 cm]", (0.007, 0.01)),
    (Row(Number()), "[1, 2, 3]", (1.0, 2.0, 3.0)),
    (Row(Number(), 2), "[1, 2]", (1.0, 2.0)),
    (Row(Measure(LENGTH), 2), "[90 mm, 8 cm]", (0.09, 0.08)),
    (Row(Measure(LENGTH), 2), "90 80 mm", (0.09, 0.08)),
    (Row(Measure(LENGTH)), "90 mm", (0.09,)),
    (Row(Measure(LENGTH)), "90 80 70 mm", (0.09, 0.08, 0.07)),
    (Counts(2, 1, 640), "[640, 1]", (640, 1)),
    (OrWord(Number(), "auto"), "auto", None),
    (OrWord(Number(), "auto"), "2", 2.0),
    (OrWord(Span(Number()), "auto"), "[1, 2]", (1.0, 2.0)),
    (Words(), "a b", ("a", "b")),
    (Words(), "[a, b]", ("a", "b")),
    (Words("a", "b"), "[b, a]", ("b", "a")),
    (Words(once=False), "[a, a]", ("a", "a")),
    (ListOf(Number()), "[1, 2]", (1.0, 2.0)),
    (ListOf(Number()), "[]", ()),
    (MappingOf(Number()), "{a: 1, b: 2}", {"a": 1.0, "b": 2.0}),
    (MappingOf(Number()), "null", {}),
]


@pytest.mark.parametrize(("kind", "text", "value"), GOOD)
def test_a_value_is_read_and_its_schema_allows_it(kind: Kind[Any], text: str, value: Any) -> None:
    found = read(kind, text)
    assert found == (pytest.approx(value) if isinstance(value, (float, tuple)) else value)
    assert type(found) is type(value)
    assert fits(kind, text)
    assert fits(kind, text, options=True)


WRONG: list[tuple[Kind[Any], str, str, str]] = [
    (Text("left", "right", "2"), "lift", "value", "it: it cannot be 'lift'"),
    (Text(pattern="[a-c]+", words="letters"), "abcd", "value", "it: 'abcd' is not letters"),
    (Text(), "[a]", "shape", "it must be a text, not "),
    (Text("a", "b"), "{a: 1}", "shape", "it must be one of a, b, not "),
    (Flag(), "yes please", "value", "it: it cannot be 'yes please'"),
    (Number(0.0, 1.0), "1.1", "range", "it: it is 1.1, but must be between 0 and 1"),
    (Number(0.0, 1.0), "-0.1", "range", "it: it is -0.1, but must be between 0 and 1"),
    (Number(low=2.0), "1.9", "range", "it: it is 1.9, but must be at least 2"),
    (Number(high=2.0), "2.1", "range", "it: it is 2.1, but must be at most 2"),
    (Number(), "2 mm", "value", "it: '2 mm' is not a number; it takes no unit"),
    (Whole(1, 3), "0", "range", "it: it is 0, but must be between 1 and 3"),
    (Whole(1, 3), "4", "range", "it: it is 4, but must be between 1 and 3"),
    (Whole(), "1.5", "value", "it: it must be a whole number, not '1.5'"),
    (Measure(LENGTH), "5 kg", "value", "it: "),
    (Measure(LENGTH), "5", "value", "it: "),
    (Span(Number(0.0, 1.0)), "[0.7]", "shape", "it must be a list of 2 numbers"),
    (Span(Number(0.0, 1.0)), "[0.1, 0.2, 0.3]", "shape", "it must be a list of 2 numbers"),
    (Row(Number()), "[]", "shape", "it must be a list of numbers"),
    (Row(Number(), 2), "[1]", "shape", "it must be a list of 2 numbers"),
    (Row(Number(), 2), "[1, 2, 3]", "shape", "it must be a list of 2 numbers"),
    (Row(Number()), "1 2", "shape", "it must be a list of numbers"),
    (Row(Measure(LENGTH), 2), "90 mm", "shape", "it must be a list of 2 numbers with a unit of"),
    (Row(Measure(LENGTH), 2), "9 8 7 mm", "shape", "it must be a list of 2 numbers with a unit"),
    (Row(Measure(LENGTH)), "90 80", "shape", "it must be a list of numbers with a unit of length"),
    (Row(Measure(LENGTH)), "mm", "shape", "it must be a list of numbers with a unit of length"),
    (Row(Number()), "[[1]]", "value", "it: "),
    (Counts(2, 1, 640), "[640]", "shape", "it must be a list of 2 whole numbers"),
    (Counts(2, 1, 640), "[640, 480, 1]", "shape", "it must be a list of 2 whole numbers"),
    (Counts(2, 1, 640), "[640, 641]", "range", "it: it is 641, but must be between 1 and 640"),
    (Counts(2, 1, 640), "640", "shape", "it must be a list of 2 whole numbers"),
    (OrWord(Number(), "auto"), "{}", "shape", "it must be a number or 'auto', not "),
    (Words("a", "b"), "[c]", "value", "it: there is no 'c'"),
    (Words(), "[a, a]", "duplicate", "it: 'a' is given twice"),
    (Words(), "[[a]]", "shape", "it must be a list of words"),
    (Words("a", "b"), "{a: 1}", "shape", "it must be a list of words out of a, b"),
    (AsWritten(), "[1]", "shape", "it must be a single value, not "),
    (AsWritten(), "null", "shape", "it must be a single value, not "),
    (ListOf(Number()), "1", "shape", "it must be a list, each item a number, not "),
    (ListOf(Number()), "[1, true]", "value", "it.2: 'true' is not a number"),
    (MappingOf(Number()), "[1]", "shape", "it must be a mapping, not "),
    (MappingOf(Number()), "{a: 1, b: x}", "value", "it.b: 'x' is not a number"),
]


@pytest.mark.parametrize(("kind", "text", "code", "message"), WRONG)
def test_what_is_not_of_a_kind_is_refused_and_its_schema_forbids_it(
    kind: Kind[Any], text: str, code: str, message: str
) -> None:
    found = read(kind, text)
    assert found[0] == code
    assert found[1].startswith(message)
    assert not fits(kind, text)


@pytest.mark.parametrize(
    ("kind", "text", "words"),
    [
        (Measure(LENGTH, "1 mm", "2 m"), "0.9 mm", "it: it is 0.9 mm, but must be between 1 mm and 2 m"),
        (Measure(LENGTH, "1 mm", "2 m"), "2.1 m", "it: it is 2.1 m, but must be between 1 mm and 2 m"),
        (Measure(LENGTH, low="1 mm"), "0 m", "it: it is 0 m, but must be at least 1 mm"),
        (Measure(LENGTH, high="1 mm"), "2 mm", "it: it is 2 mm, but must be at most 1 mm"),
        (Span(Number()), "0.9..0.7", "it: it is a range from 0.9 down to 0.7"),
        (Span(Number()), "[0.9, 0.7]", "it: it is a range from 0.9 down to 0.7"),
        (Words(), "a b a", "it: 'a' is given twice"),
        (Whole(), "1234567890123456789", "it: it must be a whole number, not"),
    ],
)  # fmt: skip
def test_what_a_schema_cannot_say_is_refused_by_the_reader(
    kind: Kind[Any], text: str, words: str
) -> None:
    assert read(kind, text)[1].startswith(words)


@pytest.mark.parametrize(
    "kind",
    [Flag(), Number(), Whole(), Measure(LENGTH), Text("a"), Span(Number()), OrWord(Number(), "x")],
)
def test_an_option_stands_for_a_scalar_where_options_are_allowed(kind: Kind[Any]) -> None:
    assert fits(kind, '"{speed}"', options=True)
    assert not fits(kind, '"{speed}"') or isinstance(kind, Text)
    assert not fits(kind, '"{}"', options=True)


def test_options_are_filled_in_before_a_value_is_read() -> None:
    assert read(Number(), '"{speed}"', {"speed": "2.5"}) == 2.5
    assert read(Measure(LENGTH), '"{way} mm"', {"way": "5"}) == pytest.approx(0.005)
    assert read(Number(), '"{sped}"', {"speed": "2.5"}) == (
        "unknown-option",
        "there is no option 'sped'",
    )
    assert read(Row(Number(), 2), '["{a}", 2]', {"a": "1"}) == (1.0, 2.0)
    assert fits(Row(Number(), 2), '["{a}", 2]', options=True)
    assert fits(Row(Number(), 2), '"{both}"', options=True)
    assert not fits(Row(Number(), 2), '"{both}"')
    assert fits(Counts(2, 1, 9), '["{a}", 2]', options=True)
    assert fits(ListOf(Number()), '["{a}"]', options=True)
    assert fits(MappingOf(Number()), '{b: "{a}"}', options=True)
    assert not fits(MappingOf(Number()), '{b: "{a}"}')


def test_as_written_keeps_its_place() -> None:
    found = read(AsWritten(), "  5 mm")
    assert isinstance(found, YamlScalar)
    assert (found.text, found.line, found.column) == ("5 mm", 1, 3)
    assert all(fits(AsWritten(), text) for text in ("5 mm", "5", "true"))
    assert not fits(AsWritten(), "[1]")


def test_a_value_of_the_command_line_is_refused_with_its_hint() -> None:
    assert Number(0.0, 1.0).option("0.5") == 0.5
    with pytest.raises(argparse.ArgumentTypeError, match=r"^it cannot be 'lift'; .*left"):
        Text("left", "right").option("lift")
    with pytest.raises(argparse.ArgumentTypeError, match=r"^it is 2, but must be between 0 and 1$"):
        Number(0.0, 1.0).option("2")


def test_every_mistake_of_a_list_is_a_finding() -> None:
    findings = Findings()
    node = read_yaml(Source("a.yaml", "[1, x, 2, y]"), findings)
    assert node is not None
    with pytest.raises(Refused):
        ListOf(Number()).read(node, Reader(findings, "it"))
    assert [finding.message[:4] for finding in findings.sorted()] == ["it.2", "it.4"]


@pytest.mark.parametrize(
    ("low", "high", "words", "schema"),
    [
        (1.0, 2.0, "between 1 and 2", {"minimum": 1.0, "maximum": 2.0}),
        (1.0, math.inf, "at least 1", {"minimum": 1.0}),
        (-math.inf, 2.0, "at most 2", {"maximum": 2.0}),
    ],
)
def test_a_range_in_words_and_in_a_schema(
    low: float, high: float, words: str, schema: dict[str, float]
) -> None:
    assert between(low, high) == words
    assert bounds_schema(low, high) == schema
    assert bounds_schema(None, None) == {}


def test_a_hint_names_the_nearest_word_or_all_of_them() -> None:
    assert "left" in choose("lift", ["left", "right"])
    assert choose("zzzzzz", ["left", "right"]) == "known: left, right"
    assert choose("zzzzzz", []) == "known: none"
