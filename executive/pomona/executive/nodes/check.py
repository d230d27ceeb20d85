"""Words that look at a condition: the leaves check and wait_until, the modifiers guard and when."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from pomona.executive.nodes import takes
from pomona.executive.nodes.behaviours import LeafBehaviour, Wrapper
from pomona.executive.nodes.context import BuildContext, FactContext, FlowContext, OutcomeContext
from pomona.executive.nodes.facts import Condition, Ends, Facts, Names, Outcome
from pomona.executive.nodes.node_type import Leaf, Modifier
from pomona.executive.reasons import NoValue


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

    def possible_outcome(self, at: OutcomeContext) -> Outcome:
        return Outcome()

    def known_facts(self, at: FactContext, known: Facts) -> Facts:
        return at.awaits(self.key, known)

    def build(self, at: BuildContext) -> Behaviour:
        return WaitUntil(at.name, at.condition(self.key))


class Guard(Wrapper):
    """Looks at its condition before every tick of its child; when it does not hold, interrupts the child and fails."""

    def __init__(self, name: str, child: Behaviour, condition: Condition) -> None:
        super().__init__(name, child)
        self._condition = condition

    def tick(self) -> Iterator[Behaviour]:
        try:
            holds = self._condition.holds()
        except NoValue as missing:
            self.stop(self.fails("BAD_VALUE", str(missing)))
            yield self
            return
        if holds:
            yield from super().tick()
            return
        self.stop(
            self.fails("CONDITION_FALSE", self._condition.sentence(), **self._condition.values())
        )
        yield self


class When(Wrapper):
    """Looks at its condition at its start; when it does not hold, the child is skipped."""

    def __init__(self, name: str, child: Behaviour, condition: Condition) -> None:
        super().__init__(name, child)
        self._condition = condition

    def begin(self) -> Status | None:
        if self._condition.holds():
            return None
        self.feedback_message = f"skipped: {self._condition.sentence()}"
        return Status.INVALID


class GuardType(Modifier):
    """looked at before each tick; when it does not hold, the node is interrupted and fails"""

    key, symbol = "guard", "◇"
    value = takes.Condition("looked at before each tick; when it does not hold the node fails")
    ends = ("success", "failure")

    def possible_outcome(self, at: OutcomeContext) -> Outcome:
        return at.inside().plus("CONDITION_FALSE")

    def written_ports(self, at: FlowContext, before: Names) -> Ends:
        ends = at.inside(before)
        return Ends(ends.success, ends.failure & before, ends.skipped)

    def known_facts(self, at: FactContext, known: Facts) -> Facts:
        return at.inside(at.must(self.key, known))

    def build(self, at: BuildContext) -> Behaviour:
        condition = at.condition(self.key)
        return Guard(at.name, at.inside(), condition)


class WhenType(Modifier):
    """looked at once, at the start; when it does not hold, the node is **skipped**"""

    key, symbol = "when", "◇"
    value = takes.Condition("looked at once; when it does not hold the node is skipped")
    ends = ("skipped", "not skipped")

    def possible_outcome(self, at: OutcomeContext) -> Outcome:
        return replace(at.inside(), skips=True)

    def written_ports(self, at: FlowContext, before: Names) -> Ends:
        ends = at.inside(before)
        return ends._replace(skipped=ends.skipped & before)

    def known_facts(self, at: FactContext, known: Facts) -> Facts:
        at.inside(at.must(self.key, known))
        return at.forget(known)

    def build(self, at: BuildContext) -> Behaviour:
        condition = at.condition(self.key)
        return When(at.name, at.inside(), condition)
