"""Recovery: something is done between two tries of the same."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

from py_trees.behaviour import Behaviour

from pomona.executive.nodes import takes
from pomona.executive.nodes.context import (
    Around,
    BuildContext,
    CheckContext,
    FlowContext,
    LastFailure,
    OutcomeContext,
    RetryCount,
)
from pomona.executive.nodes.facts import NO_CODES, Ends, Names, Outcome
from pomona.executive.nodes.node_type import Composite
from pomona.executive.nodes.retry import Retry


class RecoveryType(Composite):
    """runs A; when it fails, B and then A again; `attempts: 2` tries of A; B never follows the last"""

    key, symbol = "recovery", "↺"
    value = takes.Children(
        "the action, and the recovery between two tries",
        leads=("", "on failure: "),
        exactly="first the action, then the recovery after its failure",
    )
    fields: ClassVar[takes.Fields] = {
        "attempts": takes.count("tries of the first child, by default 2")
    }
    other_names = ("RecoveryNode",)

    def around(self, at: CheckContext, index: int) -> Around:
        around = replace(at.around, counters=at.around.counters | {"retry"})
        return replace(around, failure=at.outcomes.child(0).codes) if index else around

    def possible_outcome(self, at: OutcomeContext) -> Outcome:
        outcomes = at.children()
        if len(outcomes) != 2:
            return Outcome()
        first, second = outcomes
        return replace(first, codes=first.codes | second.codes if first.codes else NO_CODES)

    def written_ports(self, at: FlowContext, before: Names) -> Ends:
        if len(at.node.children) != 2:
            return Ends(before, before)
        first = at.child(0, before)
        second = at.child(1, first.failure)
        return Ends(first.success, first.failure & second.failure & second.skipped, first.skipped)

    def build(self, at: BuildContext) -> Behaviour:
        count, last_failure = RetryCount(), LastFailure()
        child = at.child(0, retry=count)
        recover = at.child(1, retry=count, failure=last_failure)
        total = at.value("attempts", 2)
        return Retry(
            at.name,
            child,
            at.now,
            total,
            count=count,
            on_failure=recover,
            between_only=True,
            last_failure=last_failure,
        )
