"""Check and wait_until: leaves that look at a condition."""

from __future__ import annotations

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from pomona.executive.nodes import takes
from pomona.executive.nodes.behaviours import LeafBehaviour
from pomona.executive.nodes.conditions import Condition
from pomona.executive.nodes.context import BuildContext, FactContext, OutcomeContext
from pomona.executive.nodes.ends import Outcome
from pomona.executive.nodes.facts import Facts
from pomona.executive.nodes.node_type import Leaf


class Check(LeafBehaviour):
    """Succeeds when its condition holds, fails otherwise."""

    def __init__(self, name: str, condition: Condition) -> None:
        super().__init__(name)
        self._condition = condition

    def act(self) -> Status:
        if self._condition.holds():
            return Status.SUCCESS
        return self.fails("CONDITION_FALSE", self._condition.sentence(), **self._condition.values())


class WaitUntil(LeafBehaviour):
    """Runs until its condition holds."""

    def __init__(self, name: str, condition: Condition) -> None:
        super().__init__(name)
        self._condition = condition

    def act(self) -> Status:
        if self._condition.holds():
            return Status.SUCCESS
        self.feedback_message = f"waiting until {self._condition.text}"
        return Status.RUNNING


class CheckType(Leaf):
    """succeeds when it holds, else fails with `CONDITION_FALSE` and the values that it saw"""

    key, symbol, colour = "check", "◇", "#b26a00"
    value = takes.Condition("succeeds when it holds, fails otherwise")
    ends = ("success", "failure")
    instant = True
    xml_value = "condition"

    def possible_outcome(self, at: OutcomeContext) -> Outcome:
        return Outcome(frozenset({"CONDITION_FALSE"}))

    def known_facts(self, at: FactContext, known: Facts) -> Facts:
        return at.must(self.key, known)

    def build(self, at: BuildContext) -> Behaviour:
        return Check(at.name, at.condition(self.key))


class WaitUntilType(Leaf):
    """runs until it holds"""

    key, symbol = "wait_until", "◇"
    value = takes.Condition("runs until it holds")
    xml_value = "condition"

    def possible_outcome(self, at: OutcomeContext) -> Outcome:
        return Outcome()

    def known_facts(self, at: FactContext, known: Facts) -> Facts:
        return at.awaits(self.key, known)

    def build(self, at: BuildContext) -> Behaviour:
        return WaitUntil(at.name, at.condition(self.key))
