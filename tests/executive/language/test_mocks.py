"""Mocks of a dry run: which result each call of a node gets, and what is wrong in their file."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Annotated, Any, ClassVar

import pytest

from pomona.executive.language import read
from pomona.executive.language.expression_run import NoValue
from pomona.executive.language.mocks import (
    MockPlan,
    MockResult,
    Placeholder,
    mock_class,
    placeholder,
    read_mocks,
)
from pomona.executive.ports import Outputs, Port, Time
from pomona.executive.registry import Registry
from pomona.executive.skill import Skill, Work
from pomona.executive.skill_testing import drive
from pomona.executive.values.units import LENGTH


class Side(Enum):
    """Two sides."""

    LEFT = "left"
    RIGHT = "right"


@dataclass(frozen=True)
class Fruit:
    """A fruit with a place."""

    name: str
    width: Annotated[float, LENGTH]


class Seen(Outputs):
    fruit: Fruit
    count: int
    width: Annotated[float, LENGTH]
    words: str
    sure: bool
    side: Side


class Look(Skill):
    """Look for fruit."""

    failures = ("NOTHING_FOUND", "NO_FRAME")
    renamed_failures: ClassVar = {"NOTHING": "NOTHING_FOUND"}

    def run(self, patience: Time = 0.5) -> Work[Seen]:
        yield None
        raise AssertionError


class Stay(Skill):
    """Stay."""

    def run(self) -> Work[None]:
        yield None
        return None


SKILLS = Registry({"Look": Look, "Stay": Stay})
TREE = """
pomona: 1
tree: two_looks
root:
  sequence:
    - Look: {}
      name: first
    - sequence:
        - Look: {}
        - Stay: {}
"""


def mocks(text: str) -> tuple[MockPlan, list[Any]]:
    document = read(TREE, "tree.yaml")
    return read_mocks(text, "mocks.yaml", document, SKILLS)


def ends(text: str) -> dict[str, tuple[MockResult, ...]]:
    plan, found = mocks(text)
    assert found == [], [f.message for f in found]
    return dict(plan.results)


@pytest.mark.parametrize(
    ("written", "results"),
    [
        ("success", [MockResult("success", code="MOCKED")]),
        ("running", [MockResult("running", code="MOCKED")]),
        ("failure", [MockResult("failure", code="MOCKED")]),
        ("NO_FRAME", [MockResult("failure", code="NO_FRAME")]),
        ("[success, NO_FRAME]", [MockResult("success", code="MOCKED"), MockResult("failure", code="NO_FRAME")]),
        ("{calls: 3}", [MockResult("success", code="MOCKED")] * 3),
        ("{after: 300 ms, code: NO_FRAME, message: dark}", [MockResult("failure", 0.3, {}, "NO_FRAME", "dark")]),
        ("{status: failure}", [MockResult("failure", code="MOCKED")]),
        ("{status: success, code: NO_FRAME}", [MockResult("success", code="NO_FRAME")]),
        ("{outputs: {count: 3, width: 40 mm, side: right}}",
         [MockResult("success", outputs={"count": 3, "width": 0.04, "side": Side.RIGHT}, code="MOCKED")]),
        ("[{calls: 2, code: NO_FRAME}, success]",
         [MockResult("failure", code="NO_FRAME")] * 2 + [MockResult("success", code="MOCKED")]),
    ],
)  # fmt: skip
def test_results_are_words_or_mappings_one_or_several(
    written: str, results: list[MockResult]
) -> None:
    assert ends(f"mocks: {{Look: {written}}}") == {"Look": tuple(results)}
    assert ends(f"mocks: {{first: {written}}}") == {"first": tuple(results)}


@pytest.mark.parametrize(
    ("text", "line", "column", "message", "hint"),
    [
        ("mocks: {Lok: success}", 1, 9, "the tree has no skill or node 'Lok'", "Look"),
        ("mocks: {xyzzy: success}", 1, 9, "the tree has no skill or node 'xyzzy'", "name a skill or a node"),
        ("mocks: {Look: NO_FRAMES}", 1, 15, "Look never fails with NO_FRAMES", "NO_FRAME"),
        ("mocks: {Look: xyzzy}", 1, 15, "Look never fails with xyzzy", "codes: NOTHING_FOUND, NO_FRAME"),
        ("mocks: {Look: {code: sucess}}", 1, 22, "Look never fails with sucess", "success"),
        ("mocks: {Look: NOTHING}", 1, 15, "Look never fails with NOTHING", "it is called 'NOTHING_FOUND' now"),
        ("mocks: {Look: [[success]]}", 1, 16, "must be success, failure, running, a code, or a mapping", ""),
        ("mocks: {Look: {outputs: {cont: 3}}}", 1, 26, "Look has no output 'cont'", "count"),
        ("mocks: {Stay: {outputs: {a: 3}}}", 1, 26, "Stay has no output 'a'", "outputs: none"),
        ("mocks: {Look: {outputs: {count: many}}}", 1, 33, "many", ""),
        ("mocks: {Look: {outputs: {fruit: {nam: a}}}}", 1, 34, "has no field 'nam'", "name"),
        ("mocks: {Look: {calls: 0}}", 1, 23, "1", ""),
        ("mocks: {Look: {calls: 10001}}", 1, 23, "10000", ""),
        ("mocks: {Look: {after: -1 ms}}", 1, 23, "after", ""),
        ("pomona: 1", 1, 1, "the file holds no mocks", "write 'mocks: {Skill: result}'"),
        ("[]", 1, 1, "a file of mocks", ""),
    ],
)  # fmt: skip
def test_what_is_wrong_has_a_place_and_a_hint(
    text: str, line: int, column: int, message: str, hint: str
) -> None:
    _plan, (found, *_more) = mocks(text)
    assert (found.line, found.column) == (line, column)
    assert message in found.message
    assert hint in str(found.hint)


def test_all_mistakes_are_found_at_once_and_what_is_wrong_replaces_nothing() -> None:
    plan, found = mocks(
        "mocks:\n  Look: {outputs: {a: 1, b: 2}}\n  Stay: xyzzy\n  first: success\n"
    )
    assert [f.line for f in found] == [2, 2, 3]
    assert plan.results == {}


def test_the_cases_of_a_scenario_are_left_to_it() -> None:
    plan, found = mocks("mocks: {Stay: failure}\ncases: []\ntree: tree.yaml\n")
    assert found == []
    assert list(plan.results) == ["Stay"]
    _plan, found = mocks("mocks: {Stay: failure}\ntree: tree.yaml\n")
    assert len(found) == 1
    assert mocks("cases: []\n")[1] == []


def replaced(plan: MockPlan, label: str, path: str) -> Any:
    return plan.replace(Look, "Look", label, path)


def test_the_most_specific_name_applies() -> None:
    names = ("two_looks/0", "0", "first", "Look")
    for most in range(4):
        plan = MockPlan({name: (MockResult(message=name),) for name in names[most:]})
        assert replaced(plan, "first", "two_looks/0").results[0].message == names[most]
    assert replaced(MockPlan(), "first", "two_looks/0").results == (MockResult(),)
    assert replaced(MockPlan(keep=frozenset({"Look"})), "first", "two_looks/0") is None
    assert replaced(MockPlan(keep=frozenset({"Stay"})), "first", "two_looks/0") is not None


def outcome(skill: Skill) -> Any:
    return drive(skill, {}, {}).reason


def test_calls_are_counted_over_all_nodes_of_a_name_and_the_last_result_stays() -> None:
    codes = ("NO_FRAME", "NOTHING_FOUND")
    plan = MockPlan({"Look": tuple(MockResult("failure", code=code) for code in codes)})
    nodes = [replaced(plan, label, "a/0") for label in ("one", "other")]
    told = [outcome(nodes[k]).code for k in (0, 1, 0)]
    assert told == ["NO_FRAME", "NOTHING_FOUND", "NOTHING_FOUND"]
    alone = mock_class(Look, plan.results["Look"])
    assert [outcome(alone("a")).code, outcome(mock_class(Look)("b"))] == ["NO_FRAME", None]


@pytest.fixture
def mock() -> Any:
    def made(*results: MockResult) -> Skill:
        return mock_class(Look, results)("look")

    return made


def test_a_mock_takes_its_time_fails_in_its_words_or_runs_until_it_is_interrupted(
    mock: Any,
) -> None:
    ticks: list[int] = []
    reason = drive(
        mock(MockResult("failure", 0.5, code="NO_FRAME")), {}, {}, each_tick=ticks.append
    ).reason
    assert reason.code == "NO_FRAME"
    assert reason.message.endswith("the mock of Look fails")
    late = len(ticks)
    ticks.clear()
    reason = drive(
        mock(MockResult("failure", code="NO_FRAME", message="dark")), {}, {}, each_tick=ticks.append
    ).reason
    assert reason.message.endswith("dark")
    assert late > len(ticks) + 3
    runs = mock(MockResult("running")).run()
    assert {next(runs) for _ in range(9)} == {"runs until it is interrupted"}


def test_outputs_that_a_mock_does_not_have_are_placeholders(mock: Any) -> None:
    with pytest.raises(StopIteration) as done:
        next(mock(MockResult(outputs={"count": 4})).run())
    values = done.value.value
    assert (values["count"], values["width"], values["words"], values["sure"]) == (
        4,
        0.0,
        "",
        False,
    )
    assert values["side"] is Side.LEFT
    assert values["fruit"].is_placeholder
    assert placeholder(Port(str, choices=("b", "a"))) == "b"
    assert placeholder(Port(float)) == 0.0
    assert placeholder(Port(int)) == 0
    assert placeholder(Port(bool)) is False


def test_a_placeholder_has_the_fields_that_it_was_given() -> None:
    (result,) = ends("mocks: {Look: {outputs: {fruit: {width: 30 mm}}}}")["Look"]
    fruit = result.outputs["fruit"]
    assert fruit.width == 0.03
    with pytest.raises(NoValue, match=r"a fruit without 'name': add it to the mock's outputs"):
        _ = fruit.name
    with pytest.raises(AttributeError):
        _ = fruit._hidden
    assert Placeholder("x").is_placeholder
