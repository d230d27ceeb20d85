"""Words that look at a condition: the leaves check and wait_until, the modifiers guard and when."""

from __future__ import annotations

from collections.abc import Iterator

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from pomona.executive.nodes import takes
from pomona.executive.nodes.behaviours import LeafBehaviour, Wrapper
from pomona.executive.nodes.context import FactContext
from pomona.executive.nodes.facts import Condition, Facts
from pomona.executive.nodes.node_type import Leaf, Modifier
from pomona.executive.reasons import NoValue


class Conditional(LeafBehaviour):
    """A leaf with a condition."""

    def __init__(self, name: str, condition: Condition) -> None:
        super().__init__(name)
        self._condition = condition


class Check(Conditional):
    """Succeeds when its condition holds, fails otherwise."""

    def act(self) -> Status:
        if self._condition.holds():
            return Status.SUCCESS
        return self.fails("CONDITION_FALSE", self._condition.sentence(), **self._condition.values())


class WaitUntil(Conditional):
    """Runs until its condition holds."""

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
    codes = ("CONDITION_FALSE",)

    def known_facts(self, at: FactContext, known: Facts) -> Facts:
        return at.must(self.key, known)

    makes = Check
    gives = ("condition",)


class WaitUntilType(Leaf):
    """runs until it holds"""

    key = "wait_until"
    symbol = "◇"
    value = takes.Condition("runs until it holds")

    def known_facts(self, at: FactContext, known: Facts) -> Facts:
        return at.awaits(self.key, known)

    makes = WaitUntil
    gives = ("condition",)


class ConditionalWrapper(Wrapper):
    """A wrapper with a condition."""

    def __init__(self, name: str, child: Behaviour, condition: Condition) -> None:
        super().__init__(name, child)
        self._condition = condition


class Guard(ConditionalWrapper):
    """Looks at its condition before every tick of its child; when it does not hold, interrupts the child and fails."""

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


class When(ConditionalWrapper):
    """Looks at its condition at its start; when it does not hold, the child is skipped."""

    def begin(self) -> Status | None:
        if self._condition.holds():
            return None
        self.feedback_message = f"skipped: {self._condition.sentence()}"
        return Status.INVALID


class GuardType(Modifier):
    """looked at before each tick; when it does not hold, the node is interrupted and fails"""

    key = "guard"
    symbol = "◇"
    value = takes.Condition("looked at before each tick; when it does not hold the node fails")
    ends = ("success", "failure")
    codes = ("CONDITION_FALSE",)

    def known_facts(self, at: FactContext, known: Facts) -> Facts:
        return at.inside(at.must(self.key, known))

    makes = Guard
    gives = ("condition",)


class WhenType(Modifier):
    """looked at once, at the start; when it does not hold, the node is **skipped**"""

    key = "when"
    symbol = "◇"
    value = takes.Condition("looked at once; when it does not hold the node is skipped")
    ends = ("skipped", "not skipped")
    skips = True

    def known_facts(self, at: FactContext, known: Facts) -> Facts:
        at.inside(at.must(self.key, known))
        return at.forget(known)

    makes = When
    gives = ("condition",)
