"""Fallbacks: one alternative after the other until one succeeds, with the reason why each of the others failed."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
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
    XmlExport,
)
from pomona.executive.nodes.ends import ALL, NO_CODES, Ends, Names, Outcome, codes_of
from pomona.executive.nodes.facts import Facts
from pomona.executive.nodes.node_type import Composite
from pomona.executive.nodes.surroundings import Around, LastFailure
from pomona.executive.reasons import Reason, from_causes, path_of, reason_of


class Fallback(Branch):
    """py_trees' selector forgets a child's failure once it has gone on; this one keeps it and shows it to the next.

    Without memory every tick starts again with the first child.
    """

    def __init__(
        self, name: str, memory: bool, children: Sequence[Behaviour], last_failure: LastFailure | None = None
    ) -> None:
        super().__init__(name, children)
        self.memory = memory
        self._at = self._skipped = 0
        self._causes: list[Reason] = []
        self._last_failure = last_failure or LastFailure()

    def explain(self) -> Reason:
        """Return all children's reasons; the code is that of the last one."""
        causes = tuple(self._causes)
        if len(causes) < 2:
            return from_causes(self, causes)
        message = f"none of {len(causes)} alternatives succeeded; the last: {causes[-1].message}"
        return Reason(path_of(self), causes[-1].code, message, causes=causes)

    def tick(self) -> Iterator[Behaviour]:
        children = self.children
        if self.status is not Status.RUNNING:
            self.reset()
            self._begin()
        elif not self.memory:
            self._begin()
        for at in range(self._at, len(children)):
            child = self.current_child = children[at]
            yield from child.tick()
            status = child.status
            if status is Status.INVALID:
                self._skipped += 1
                continue
            if status is Status.FAILURE:
                reason = reason_of(child)
                self._causes.append(reason)
                self._last_failure.see(reason)
                continue
            self._at = at
            for lower in children[at + 1 :]:
                if lower.status is not Status.INVALID:
                    lower.stop(Status.INVALID)
            if status is Status.SUCCESS:
                self.stop(status)
            else:
                self.status = status
            yield self
            return
        self.stop(Status.INVALID if self._skipped == len(children) else Status.FAILURE)
        yield self

    def _begin(self) -> None:
        self._at = self._skipped = 0
        self._causes.clear()


class FallbackType(Composite):
    """one after the other until one succeeds"""

    key, symbol = "fallback", "?"
    value = takes.Children("one after the other until one succeeds")
    xml_tags: ClassVar[tuple[str, ...]] = ("Fallback", "FallbackStar", "AsyncFallback")
    memory: ClassVar[bool] = True

    def around(self, at: CheckContext, index: int) -> Around:
        if index == 0:
            return at.around
        before, codes, failed = at.outcomes.child(index - 1), NO_CODES, at.node.children[index - 1].label
        if not (before.codes or before.skips):
            message = (
                f"{at.node.children[index].label} is never reached: {at.node.children[index - 1].label} cannot fail"
            )
            at.findings.warning(at.node.children[index].key, "unreachable", message)
        while index and before.skips:
            codes, index = codes | before.codes, index - 1
            before = at.outcomes.child(index - 1) if index else Outcome(at.around.failure or NO_CODES)
        return Around(at.around.counters, codes | before.codes, at.around.items, failed)

    def possible_outcome(self, at: OutcomeContext) -> Outcome:
        outcomes = at.children()
        skips = all(outcome.skips for outcome in outcomes)
        succeeds = any(outcome.succeeds for outcome in outcomes)
        least = min((outcome.least for outcome in outcomes if outcome.succeeds), default=0.0)
        if not all(outcome.codes or outcome.skips for outcome in outcomes):
            return Outcome(succeeds=succeeds, least=least)
        return Outcome(codes_of(outcomes), succeeds, skips, least)

    def written_ports(self, at: FlowContext, before: Names) -> Ends:
        success, failure, skipped = ALL, ALL, before
        for index in range(len(at.node.children)):
            ends = at.child(index, failure & skipped)
            success &= ends.success
            failure = ends.failure & ends.skipped.when(failure)
            skipped = ends.skipped.when(skipped)
        return Ends(success, failure, skipped)

    def known_facts(self, at: FactContext, known: Facts) -> Facts:
        if not self.memory:
            return super().known_facts(at, known)
        for index in range(len(at.node.children)):
            at.child(index, known)
            known = at.after(index, known)
        return known

    def build(self, at: BuildContext) -> Behaviour:
        last_failure = LastFailure()
        children = [at.child(i, failure=last_failure) if i else at.child(i) for i in range(len(at.node.children))]
        return Fallback(at.name, self.memory, children, last_failure)

    def to_xml(self, at: XmlExport) -> object:
        return at.element(self.xml_tags[0])


class ReactiveFallbackType(FallbackType):
    """begins again with the first in every tick"""

    key, symbol = "reactive_fallback", "⁇"
    value = takes.Children("begins again with the first in every tick")
    xml_tags = ("ReactiveFallback",)
    memory = False
