"""Parallel: all children at once."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations, islice
from typing import ClassVar

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from pomona.executive.nodes import takes
from pomona.executive.nodes.behaviours import Branch
from pomona.executive.nodes.context import (
    BuildContext,
    CheckContext,
    FlowContext,
    NodeText,
    OutcomeContext,
)
from pomona.executive.nodes.facts import ALL, Ends, Names, Outcome, codes_of
from pomona.executive.nodes.node_type import Composite
from pomona.executive.values.yaml_nodes import YamlList, YamlScalar


class Parallel(Branch):
    """Ticks its children in order, in each tick all that have not ended; ends with the first decisive child.

    Children after the decisive one are not ticked any more, and running children are interrupted. A skipped child is
    ticked again in the next tick.

    Args:
        needed: indices of the children that must succeed, or be skipped; or the number of children that must succeed.
    """

    def __init__(self, name: str, children: Sequence[Behaviour], needed: frozenset[int] | int) -> None:
        super().__init__(name, children)
        self._any = needed if isinstance(needed, int) else 0
        self._needed = [not isinstance(needed, int) and index in needed for index in range(len(children))]
        self._open = 0

    def tick(self) -> Iterator[Behaviour]:
        if self.status is not Status.RUNNING:
            self.reset()
            self._open = self._any or sum(self._needed)
        done, skipped, skipped_needed = Status.SUCCESS, 0, 0
        for child, needed in zip(self.children, self._needed, strict=True):
            if child.status is done:
                continue
            yield from child.tick()
            status = child.status
            if status is Status.RUNNING:
                continue
            failed = status is Status.FAILURE
            if status is Status.INVALID:
                skipped += 1
                skipped_needed += needed
            elif not failed:
                self._open -= needed or self._any > 0
            if failed or self._open <= skipped_needed:
                self.current_child = child
                self.stop(status if failed else Status.SUCCESS)
                yield self
                return
        if skipped == len(self.children):
            self.stop(Status.INVALID)
        else:
            self.current_child = self.children[-1]
            self.status = Status.RUNNING
        yield self


class ParallelType(Composite):
    """all at once, ticked in order; fails with the first failure, succeeds when all have succeeded or were skipped"""

    key, symbol = "parallel", "∥"
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
        names = [i.text for i in written.items if isinstance(i, YamlScalar)] if isinstance(written, YamlList) else None
        return frozenset(i for i, child in enumerate(node.children) if names is None or child.label in names)

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
                    message = f"{label} moves the {device}, and so does {other}, in parallel: one of them waits"
                    at.findings.warning(child.key, "one-device", message, "put both into a sequence")

    def possible_outcome(self, at: OutcomeContext) -> Outcome:
        outcomes = at.children()
        chosen = self.chosen(at.node)
        codes = codes_of(outcomes)
        if isinstance(chosen, int):
            times = sorted(outcome.least for outcome in outcomes if outcome.succeeds)
            skips = all(outcome.skips for outcome in outcomes)
            return Outcome(codes, len(times) >= chosen, skips, times[chosen - 1] if len(times) >= chosen else 0.0)
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
            return Ends(success, failure, before if all(end.skipped.reachable for end in ends) else ALL)
        success = before
        for index in chosen:
            success |= ends[index].success & ends[index].skipped
        return Ends(success, failure)

    def build(self, at: BuildContext) -> Behaviour:
        return Parallel(at.name, at.children(), self.chosen(at.node))
