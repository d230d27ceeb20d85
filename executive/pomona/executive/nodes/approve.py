"""Approve: the operator checks the plan before a node starts."""

from __future__ import annotations

from collections.abc import Iterator

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from pomona.executive.nodes import takes
from pomona.executive.nodes.behaviours import Wrapper
from pomona.executive.nodes.context import BuildContext, FactContext, FlowContext, NodeContext, OutcomeContext
from pomona.executive.nodes.ends import Ends, Names, Outcome
from pomona.executive.nodes.facts import Facts
from pomona.executive.nodes.node_type import Modifier, TreeNode
from pomona.executive.nodes.question import Question
from pomona.executive.ports import Port

APPROVE, REFUSE = "approve", "refuse"


class Approve(Question, Wrapper):
    """Waits at each start for the operator's approval; fails after a refusal, or in a run without an operator."""

    choices = (APPROVE, REFUSE)

    def tick(self) -> Iterator[Behaviour]:
        if self.status is not Status.RUNNING:
            self.ask()
            self.why = None
        if self.given == APPROVE:
            yield from super().tick()
            return
        if self.given is None and self.attended:
            self.status = Status.RUNNING
            self.feedback_message = f"May {self.decorated.name} start? The plan is shown."
        elif self.given is None:
            self.stop(self.fails("NOBODY_TO_ASK", f"no operator can approve {self.decorated.name}"))
        else:
            self.stop(self.fails("NOT_APPROVED", f"{self.decorated.name} was not approved"))
        yield self


class ApproveType(Modifier):
    """asks the operator before each start; fails with `NOT_APPROVED`, or with `NOBODY_TO_ASK` without an operator"""

    key, symbol = "approve", "✋"
    value = takes.Value(Port(bool), known=True)
    outside_of = "timeout"

    def needed(self, at: NodeContext) -> bool:
        return at.literal(self.key) is True

    def choices(self, node: TreeNode) -> tuple[str, ...]:
        return Approve.choices

    def possible_outcome(self, at: OutcomeContext) -> Outcome:
        return at.inside().plus("NOT_APPROVED", "NOBODY_TO_ASK")

    def written_ports(self, at: FlowContext, before: Names) -> Ends:
        ends = at.inside(before)
        return Ends(ends.success, ends.failure & before, ends.skipped)

    def known_facts(self, at: FactContext, known: Facts) -> Facts:
        return at.inside(known)

    def build(self, at: BuildContext) -> Behaviour:
        return Approve(at.name, at.inside())
