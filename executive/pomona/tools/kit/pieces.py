"""Templates of a skill, a node type, and a tree that uses them."""

from __future__ import annotations

from pomona.tools.kit.piece import Piece

SKILL = Piece(
    "a skill: typed ports, a body that is polled, failure codes, a test",
    {
        "$module/$name.py": '''"""$Name: a skill to begin with."""

from __future__ import annotations

from typing import Annotated

from pomona.executive import LENGTH, TIME, Length, Outputs, Port, Skill, Time, Work


class ${Name}Result(Outputs):
    """Outputs of $Name."""

    height: Length


class $Name(Skill):
    """Wait a moment, then return the height to reach."""

    failures = ("TOO_HIGH",)

    def run(
        self,
        above: Annotated[Length, Port(min="0 mm", help="on top of the least height")] = LENGTH("5 cm"),
        limit: Length = LENGTH("1 m"),
        settle: Time = TIME("100 ms"),
    ) -> Work[${Name}Result]:
        yield "settling"
        yield from self.wait(settle)
        height = LENGTH("10 cm") + above
        if height > limit:
            raise self.failure("TOO_HIGH", f"{height:g} m is above the limit of {limit:g} m", height=height)
        return ${Name}Result(height=height)
''',
        "tests/test_$name.py": '''"""$Name, driven without a tree, a runner or a cell."""

from __future__ import annotations

import pytest
from pomona.executive import drive

from $module.$name import $Name


def test_it_adds_to_the_least_height() -> None:
    outcome = drive($Name(), {"above": 0.2, "limit": 1.0, "settle": 0.1})
    assert outcome.outputs["height"] == pytest.approx(0.3)
    assert outcome.duration == pytest.approx(0.1, abs=0.05)


def test_it_says_why_it_fails() -> None:
    outcome = drive($Name(), {"above": 2.0, "limit": 1.0, "settle": 0.0})
    assert outcome.reason is not None
    assert outcome.reason.code == "TOO_HIGH"
''',
    },
    entry=("pomona.skills", "$Name", "$module.$name:$Name"),
)

NODE = Piece(
    "a word of the tree language: here a modifier that forgives failures",
    {
        "$module/$name.py": '''"""`$name: 2`: the first failures of a run count as successes."""

from __future__ import annotations

from collections.abc import Callable

from pomona.executive.nodes import Modifier, takes
from pomona.executive.nodes.behaviours import Wrapper
from pomona.executive.nodes.facts import Ends, Names
from pomona.executive.nodes.context import BuildContext, FlowContext
from pomona.executive.ports import Port
from py_trees.behaviour import Behaviour
from py_trees.common import Status


class $Name(Wrapper):
    """Ends as its child does, but for the first failures of the run."""

    def __init__(self, name: str, child: Behaviour, most: Callable[[], int]) -> None:
        super().__init__(name, child)
        self._most, self.forgiven = most, 0

    def after(self, status: Status) -> Status:
        if status is not Status.FAILURE or self.forgiven >= self._most():
            return status
        self.forgiven += 1
        self.feedback_message = f"forgiven {self.forgiven} times"
        return Status.SUCCESS


class ${Name}Type(Modifier):
    """forgives so many failures in a run"""

    key, symbol = "$name", "~"
    value = takes.Value(Port(int, min=1), "how many failures count as successes", known=True)

    def written_ports(self, at: FlowContext, before: Names) -> Ends:
        ends = at.inside(before)
        return Ends(ends.success & ends.failure, ends.failure, ends.skipped)

    def build(self, at: BuildContext) -> Behaviour:
        return $Name(at.name, at.inside(), at.value(self.key))
''',
        "tests/test_$name.py": '''"""`$name` in a tree."""

from __future__ import annotations

from pomona.executive.language import build, read
from pomona.executive.nodes.catalogue import BUILTIN, NodeTypes
from pomona.executive.registry import Registry
from pomona.executive.skill_testing import BenchContext
from py_trees.common import Status

from $module.$name import ${Name}Type

TREE = """
pomona: 1
tree: t
root:
  fail: {}
  $name: 2
"""


def test_two_failures_are_forgiven_and_the_third_is_not() -> None:
    types = NodeTypes([*BUILTIN, ${Name}Type])
    tree = build(read(TREE, "t.yaml", types=types), Registry({}), context=BenchContext())
    ends: list[Status] = []
    for _ in range(3):
        tree.root.tick_once()
        ends.append(tree.root.status)
    assert ends == [Status.SUCCESS, Status.SUCCESS, Status.FAILURE]
''',
    },
    entry=("pomona.nodes", "$name", "$module.$name:${Name}Type"),
)
