"""Sequences and parallels: several nodes, one after the other or all at once."""

from __future__ import annotations

from itertools import combinations, islice
from typing import ClassVar

from py_trees.behaviour import Behaviour

from pomona.executive.nodes import takes
from pomona.executive.nodes.behaviours import Parallel, Sequence
from pomona.executive.nodes.context import (
    BuildContext,
    CheckContext,
    FactContext,
    FlowContext,
    NodeText,
    OutcomeContext,
)
from pomona.executive.nodes.facts import ALL, NO_CODES, Ends, Facts, Names, Outcome, codes_of
from pomona.executive.nodes.node_type import Composite
from pomona.executive.values.yaml_nodes import YamlList, YamlScalar


class SequenceType(Composite):
    """one after the other while they succeed; goes on where it was"""

    key = "sequence"
    symbol = "→"
    value = takes.Children("one after the other while they succeed")
    other_names: ClassVar[tuple[str, ...]] = ("Sequence", "AsyncSequence")
    memory: ClassVar[bool] = True
    keeps: ClassVar[bool] = False

    def check_layer(self, at: CheckContext) -> None:
        super().check_layer(at)
        outcomes = at.outcomes.children()
        for before, outcome, child in zip(
            at.node.children, outcomes, at.node.children[1:], strict=False
        ):
            if not (outcome.succeeds or outcome.skips):
                at.findings.warning(
                    child.key,
                    "unreachable",
                    f"{child.label} is never reached: {before.label} cannot succeed",
                )
                break

    def possible_outcome(self, at: OutcomeContext) -> Outcome:
        codes = NO_CODES
        least = 0.0
        succeeds = False
        skips = True
        for outcome in at.children():
            codes |= outcome.codes
            if not (outcome.succeeds or outcome.skips):
                return Outcome(codes, False)
            least += 0.0 if outcome.skips else outcome.least
            succeeds = succeeds or outcome.succeeds
            skips = skips and outcome.skips
        return Outcome(codes, succeeds, skips, least)

    def written_ports(self, at: FlowContext, before: Names) -> Ends:
        success = ALL
        skipped = before
        failure = ALL
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

    key = "reactive_sequence"
    symbol = "⇉"
    value = takes.Children("begins again with the first in every tick")
    other_names = ("ReactiveSequence",)
    memory = False


class SequenceWithMemoryType(SequenceType):
    """a sequence that goes on with the child that failed when it is started again"""

    key = "sequence_with_memory"
    symbol = "⇥"
    value = takes.Children("goes on with the child that failed when it is started again")
    other_names = ("SequenceWithMemory", "SequenceStar")
    keeps = True


class ParallelType(Composite):
    """all at once, ticked in order; fails with the first failure, succeeds when all have succeeded or were skipped"""

    key = "parallel"
    symbol = "∥"
    value = takes.Children("all at once; fails with the first failure")
    fields: ClassVar[takes.Fields] = {
        "success_on": takes.ChildNames("'all', 'one', a number, or a list of children by name")
    }
    other_names = ("Parallel", "ParallelAll")

    @staticmethod
    def chosen(node: NodeText) -> frozenset[int] | int:
        """Return indices of the children that must succeed, or how many of any."""
        written = node.modifiers["success_on"][1] if "success_on" in node.modifiers else None
        if isinstance(written, YamlScalar) and (written.text == "one" or written.text.isdecimal()):
            return 1 if written.text == "one" else int(written.text)
        names = (
            [i.text for i in written.items if isinstance(i, YamlScalar)]
            if isinstance(written, YamlList)
            else None
        )
        return frozenset(
            i for i, child in enumerate(node.children) if names is None or child.label in names
        )

    def check_layer(self, at: CheckContext) -> None:
        super().check_layer(at)
        chosen = self.chosen(at.node)
        if not isinstance(chosen, int) and len(chosen) < len(at.node.children):
            for index in chosen:
                if at.outcomes.child(index).skips:
                    child = at.node.children[index]
                    message = f"when {child.label} is skipped, this parallel no longer waits for it"
                    hint = "put it into a sequence behind a 'check', or let the parallel succeed on all"
                    at.findings.warning(child.key, "skipped-success", message, hint)
        self.one_device_each(at)

    @staticmethod
    def one_device_each(at: CheckContext) -> None:
        """Warn of devices that two children move: the second waits until the first releases it."""
        users: dict[str, tuple[int, str]] = {}
        for index, child in enumerate(at.node.children):
            for device, label in at.devices(index).items():
                first, other = users.setdefault(device, (index, label))
                if first != index:
                    at.findings.warning(
                        child.key,
                        "one-device",
                        f"{label} moves the {device}, and so does {other}, in parallel: one of them waits",
                        "put both into a sequence",
                    )

    def possible_outcome(self, at: OutcomeContext) -> Outcome:
        outcomes = at.children()
        chosen = self.chosen(at.node)
        codes = codes_of(outcomes)
        if isinstance(chosen, int):
            times = sorted(outcome.least for outcome in outcomes if outcome.succeeds)
            skips = all(outcome.skips for outcome in outcomes)
            return Outcome(
                codes,
                len(times) >= chosen,
                skips,
                times[chosen - 1] if len(times) >= chosen else 0.0,
            )
        needed = [outcomes[index] for index in chosen]
        least = max((outcome.least for outcome in needed if not outcome.skips), default=0.0)
        succeeds = all(outcome.succeeds or outcome.skips for outcome in needed)
        return Outcome(codes, succeeds, False, least)

    def written_ports(self, at: FlowContext, before: Names) -> Ends:
        """Children of a parallel start together: no child may read the outputs of another one."""
        ends = [at.child(index, before) for index in range(len(at.node.children))]
        failure = before if any(end.failure.reachable for end in ends) else ALL
        chosen = self.chosen(at.node)
        if isinstance(chosen, int):
            success = ALL
            # choices of children that the check follows; of more, the first stand for all
            for some in islice(combinations(ends, min(chosen, len(ends))), 1_000):
                written = before
                for end in some:
                    written |= end.success
                success &= written
            return Ends(
                success, failure, before if all(end.skipped.reachable for end in ends) else ALL
            )
        success = before
        for index in chosen:
            success |= ends[index].success & ends[index].skipped
        return Ends(success, failure)

    def build(self, at: BuildContext) -> Behaviour:
        return Parallel(at.name, at.children(), self.chosen(at.node))
