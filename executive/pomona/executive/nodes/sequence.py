"""Sequences: one node after the other while they succeed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence as SequenceOf
from itertools import islice
from typing import ClassVar

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from pomona.executive.nodes import takes
from pomona.executive.nodes.behaviours import Branch
from pomona.executive.nodes.context import (
    BuildContext,
    CheckContext,
    FactContext,
    FlowContext,
    OutcomeContext,
)
from pomona.executive.nodes.facts import ALL, NO_CODES, Ends, Facts, Names, Outcome
from pomona.executive.nodes.node_type import Composite


class Sequence(Branch):
    """Ticks its children in order while they succeed. Without memory every tick starts again with the first.

    Args:
        keeps: whether a start after a failure goes on with the child that failed.
    """

    def __init__(self, name: str, memory: bool, children: SequenceOf[Behaviour], keeps: bool = False) -> None:
        super().__init__(name, children)
        self.memory, self.keeps = memory, keeps
        self._at = self._skipped = 0

    def tick(self) -> Iterator[Behaviour]:
        children = self.children
        if self.status is not Status.RUNNING:
            self.reset()
            if not self.keeps:
                self._at = 0
            self._skipped = 0
        elif not self.memory:
            self._at = self._skipped = 0
        for at, child in islice(enumerate(children), self._at, None):  # a held tick may find more children
            self.current_child = child
            yield from child.tick()
            status = child.status
            if status is Status.SUCCESS:
                continue
            if status is Status.INVALID:
                self._skipped += 1
                continue
            self._at = at
            if not self.memory:
                for later in children[at + 1 :]:
                    if later.status is not Status.INVALID:
                        later.stop(Status.INVALID)
            if status is Status.RUNNING:
                self.status = status
            else:
                self.stop(Status.FAILURE)
            yield self
            return
        self._at = 0
        self.stop(Status.INVALID if self._skipped == len(children) else Status.SUCCESS)
        yield self


class SequenceType(Composite):
    """one after the other while they succeed; goes on where it was"""

    key, symbol = "sequence", "→"
    value = takes.Children("one after the other while they succeed")
    other_names: ClassVar[tuple[str, ...]] = ("Sequence", "AsyncSequence")
    memory: ClassVar[bool] = True
    keeps: ClassVar[bool] = False

    def check_layer(self, at: CheckContext) -> None:
        super().check_layer(at)
        outcomes = at.outcomes.children()
        for before, outcome, child in zip(at.node.children, outcomes, at.node.children[1:], strict=False):
            if not (outcome.succeeds or outcome.skips):
                message = f"{child.label} is never reached: {before.label} cannot succeed"
                at.findings.warning(child.key, "unreachable", message)
                break

    def possible_outcome(self, at: OutcomeContext) -> Outcome:
        codes, least, succeeds, skips = NO_CODES, 0.0, False, True
        for outcome in at.children():
            codes |= outcome.codes
            if not (outcome.succeeds or outcome.skips):
                return Outcome(codes, False)
            least += 0.0 if outcome.skips else outcome.least
            succeeds, skips = succeeds or outcome.succeeds, skips and outcome.skips
        return Outcome(codes, succeeds, skips, least)

    def written_ports(self, at: FlowContext, before: Names) -> Ends:
        success, skipped, failure = ALL, before, ALL
        for index in range(len(at.node.children)):
            ends = at.child(index, success & skipped)
            failure &= ends.failure
            success = ends.success & ends.skipped.when(success)
            skipped = ends.skipped.when(skipped)
        return Ends(success, failure, skipped)

    def known_facts(self, at: FactContext, known: Facts) -> Facts:
        if not self.memory or self.keeps:
            return super().known_facts(at, known)
        for index, outcome in enumerate(at.outcomes.children()):
            succeeded = at.child(index, known)
            known = at.after(index, known) if outcome.skips else succeeded
        return known

    def build(self, at: BuildContext) -> Behaviour:
        return Sequence(at.name, self.memory, at.children(), self.keeps)


class ReactiveSequenceType(SequenceType):
    """begins again with the first in every tick; interrupts the running child when an earlier one fails"""

    key, symbol = "reactive_sequence", "⇉"
    value = takes.Children("begins again with the first in every tick")
    other_names = ("ReactiveSequence",)
    memory = False


class SequenceWithMemoryType(SequenceType):
    """a sequence that goes on with the child that failed when it is started again"""

    key, symbol = "sequence_with_memory", "⇥"
    value = takes.Children("goes on with the child that failed when it is started again")
    other_names = ("SequenceWithMemory", "SequenceStar")
    keeps = True
