"""A foreign package that adds two words to the tree language, as its README would describe."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import ClassVar

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from pomona.executive.nodes import Composite, Modifier, TreeNode, takes
from pomona.executive.nodes.ask import Question
from pomona.executive.nodes.behaviours import Branch, Wrapper
from pomona.executive.nodes.context import BuildContext, FlowContext, OutcomeContext
from pomona.executive.nodes.facts import ALL, Ends, Names, Outcome, codes_of
from pomona.executive.nodes.node_type import Field
from pomona.executive.ports import RATE, Port


class TakeTurns(Branch):
    """Each start runs the next child only, and ends as it does."""

    turn = -1

    def tick(self) -> Iterator[Behaviour]:
        if self.status is not Status.RUNNING:
            self.reset()
            self.turn = (self.turn + 1) % len(self.children)
        child = self.current_child = self.children[self.turn]
        yield from child.tick()
        if child.status is Status.RUNNING:
            self.status = Status.RUNNING
        else:
            self.stop(child.status)
        yield self


class TakeTurnsType(Composite):
    """runs the next of its children at each start"""

    key, symbol = "take_turns", "⟲"
    value = takes.Children("they take turns")

    def possible_outcome(self, at: OutcomeContext) -> Outcome:
        outcomes = at.children()
        return Outcome(
            codes_of(outcomes),
            any(end.succeeds for end in outcomes),
            any(end.skips for end in outcomes),
        )

    def written_ports(self, at: FlowContext, before: Names) -> Ends:
        success = failure = skipped = ALL
        for index in range(len(at.node.children)):
            ends = at.child(index, before)
            success, failure, skipped = (
                success & ends.success,
                failure & ends.failure,
                skipped & ends.skipped,
            )
        return Ends(success, failure, skipped)

    def build(self, at: BuildContext) -> Behaviour:
        return TakeTurns(at.name, at.children())


class Paced(Wrapper):
    """Limits the ticks of its child per second; in between the status stays."""

    def __init__(
        self, name: str, child: Behaviour, rate: Callable[[], float], now: Callable[[], float]
    ) -> None:
        super().__init__(name, child)
        self.rate, self.now, self.due = rate, now, 0.0

    def tick(self) -> Iterator[Behaviour]:
        if self.now() < self.due - 1e-9:
            self.status = Status.RUNNING
            yield self
            return
        self.due = self.now() + 1.0 / self.rate()
        yield from super().tick()


class PacedType(Modifier):
    """ticks the node so many times a second at most"""

    key, symbol = "paced", "♪"
    value = takes.Value(Port(RATE, min=0.001), "ticks a second at most")
    fields: ClassVar[takes.Fields] = {"because": takes.Value(Port(str), "for people", known=True)}
    outside_of = "timeout"

    def build(self, at: BuildContext) -> Behaviour:
        return Paced(at.name, at.inside(), at.value("paced"), at.now)


class NoFlow(Composite):
    """forgets to say what is written when it ends"""

    key, symbol = "no_flow", "x"
    value = takes.Children()

    def possible_outcome(self, at: OutcomeContext) -> Outcome:
        return Outcome()

    def build(self, at: BuildContext) -> Behaviour:
        return TakeTurns(at.name, at.children())


class Broken(PacedType):
    """raises while it is asked"""

    key = "broken"

    @property
    def slots(self) -> dict[str, Field]:
        raise RuntimeError("of its own making")


class Signed(Question, Wrapper):
    """Requires a signature before its child starts."""

    choices = ("signed",)

    def tick(self) -> Iterator[Behaviour]:
        if self.status is not Status.RUNNING:
            self.ask()
        if self.given is not None:
            yield from super().tick()
            return
        self.status = Status.RUNNING
        yield self


class SignedType(Modifier):
    """waits for a signature"""

    key, symbol = "signed", "✎"
    value = takes.Nothing()

    def choices(self, node: TreeNode) -> tuple[str, ...]:
        return Signed.choices

    def build(self, at: BuildContext) -> Behaviour:
        return Signed(at.name, at.inside())
