"""Composites of Nav2: round_robin and pipeline_sequence."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from pomona.executive.nodes import takes
from pomona.executive.nodes.behaviours import Branch
from pomona.executive.nodes.composites import SequenceType
from pomona.executive.nodes.context import BuildContext, FlowContext, OutcomeContext
from pomona.executive.nodes.facts import ALL, Ends, Names, Outcome, codes_of
from pomona.executive.nodes.node_type import Composite
from pomona.executive.reasons import Reason, from_causes, reason_of


class RoundRobin(Branch):
    """Each start goes on with the child after the one that succeeded last; a child that fails hands on to the next.

    It fails when every child has failed since the last success, and then begins with the first again; an interruption
    does so, too.
    """

    def __init__(self, name: str, children: Sequence[Behaviour]) -> None:
        super().__init__(name, children)
        self._at = self._failed = 0
        self._causes: list[Reason] = []

    def explain(self) -> Reason:
        """Why each child failed."""
        return from_causes(self, tuple(self._causes))

    def stop(self, new_status: Status = Status.INVALID) -> None:
        if new_status is Status.INVALID and self.status is Status.RUNNING:
            self._at = self._failed = 0
        super().stop(new_status)

    def tick(self) -> Iterator[Behaviour]:
        if self.status is not Status.RUNNING:
            self.reset()
        skipped, number = 0, len(self.children)
        while self._failed + skipped < number:
            child = self.current_child = self.children[self._at]
            yield from child.tick()
            status = child.status
            if status is Status.RUNNING:
                self.status = status
                yield self
                return
            self._at = (self._at + 1) % number
            if status is Status.SUCCESS:
                self._failed = 0
                self._causes.clear()
                self.stop(status)
                yield self
                return
            if status is Status.INVALID:
                skipped += 1
            else:
                if not self._failed:
                    self._causes.clear()
                self._failed += 1
                self._causes.append(reason_of(child))
        self._at = self._failed = 0
        self.stop(Status.INVALID if skipped == number else Status.FAILURE)
        yield self


class Pipeline(Branch):
    """Ticks its children in order, those before the one that runs again in every tick, also while they run."""

    def __init__(self, name: str, children: Sequence[Behaviour]) -> None:
        super().__init__(name, children)
        self._furthest = 0

    def tick(self) -> Iterator[Behaviour]:
        if self.status is not Status.RUNNING:
            self.reset()
            self._furthest = 0
        skipped = 0
        for index, child in enumerate(self.children):
            yield from child.tick()
            status = child.status
            if status is Status.FAILURE:
                self.current_child = child
                self.stop(status)
                yield self
                return
            skipped += status is Status.INVALID
            if status is Status.RUNNING and index >= self._furthest:
                self._furthest, self.current_child, self.status = index, child, status
                yield self
                return
        self.stop(Status.INVALID if skipped == len(self.children) else Status.SUCCESS)
        yield self


class RoundRobinType(Composite):
    """takes turns: each start runs the child after the one that succeeded last; fails when all have failed"""

    key, symbol = "round_robin", "⟳"
    value = takes.Children("they take turns")
    other_names = ("RoundRobin",)

    def possible_outcome(self, at: OutcomeContext) -> Outcome:
        outcomes = at.children()
        never = not all(outcome.codes or outcome.skips for outcome in outcomes)
        succeeds = any(outcome.succeeds for outcome in outcomes)
        return Outcome(
            frozenset() if never else codes_of(outcomes), succeeds, all(o.skips for o in outcomes)
        )

    def written_ports(self, at: FlowContext, before: Names) -> Ends:
        ends = [at.child(index, before) for index in range(len(at.node.children))]
        success, fails = ALL, bool(self.possible_outcome(at.outcomes).codes)
        for end in ends:
            success &= end.success
        return Ends(
            success,
            before if fails else ALL,
            before if all(end.skipped.reachable for end in ends) else ALL,
        )

    def build(self, at: BuildContext) -> Behaviour:
        return RoundRobin(at.name, at.children())


class PipelineSequenceType(SequenceType):
    """a sequence that ticks its earlier children again in every tick, also while they run"""

    key, symbol = "pipeline_sequence", "⇛"
    value = takes.Children("the earlier ones are ticked again in every tick")
    other_names = ("PipelineSequence",)
    memory = False

    def build(self, at: BuildContext) -> Behaviour:
        return Pipeline(at.name, at.children())
