"""Modifiers for working at a tree: nodes that are switched off, breakpoints that stand in the file."""

from __future__ import annotations

from typing import Literal

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from pomona.executive.nodes import takes
from pomona.executive.nodes.behaviours import Wrapper
from pomona.executive.nodes.context import (
    BuildContext,
    FactContext,
    FlowContext,
    NodeContext,
    OutcomeContext,
)
from pomona.executive.nodes.facts import ALL, Ends, Facts, Names, Outcome
from pomona.executive.nodes.node_type import Modifier
from pomona.executive.ports import Port


class Disabled(Wrapper):
    """Is always skipped."""

    def begin(self) -> Status | None:
        self.feedback_message = "skipped: it is disabled"
        return Status.INVALID


class DisabledType(Modifier):
    """switches the node off: it is skipped, and still checked"""

    key = "disabled"
    symbol = "⊘"
    value = takes.Value(Port(bool), known=True)

    def needed(self, at: NodeContext) -> bool:
        return at.literal(self.key) is True

    def possible_outcome(self, at: OutcomeContext) -> Outcome:
        return Outcome(succeeds=False, skips=True)

    def written_ports(self, at: FlowContext, before: Names) -> Ends:
        at.inside(before)
        return Ends(ALL, ALL, before)

    def known_facts(self, at: FactContext, known: Facts) -> Facts:
        at.inside(known)
        return known

    makes = Disabled


class BreakpointType(Modifier):
    """pauses the run `before` the node starts or `after` it has ended, if an operator can resume it"""

    key = "breakpoint"
    symbol = "◉"
    value = takes.Value(Port(str, choices=("before", "after")), known=True)

    def needed(self, at: NodeContext) -> bool:
        return False

    def pauses(self, at: NodeContext) -> Literal["before", "after"] | None:
        return "after" if at.literal(self.key) == "after" else "before"

    def build(self, at: BuildContext) -> Behaviour:
        return at.inside()
