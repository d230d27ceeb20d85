"""Modifiers of the end: force fixes it, invert turns it."""

from __future__ import annotations

from typing import Literal

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from pomona.executive.nodes import takes
from pomona.executive.nodes.behaviours import Wrapper
from pomona.executive.nodes.context import FlowContext, NodeContext, OutcomeContext
from pomona.executive.nodes.facts import ALL, NO_CODES, Ends, Names, Outcome
from pomona.executive.nodes.node_type import Modifier
from pomona.executive.ports import Port


class Force(Wrapper):
    """Ends with a fixed status, independent of its child's."""

    def __init__(self, name: str, child: Behaviour, end: Literal["success", "failure"]) -> None:
        super().__init__(name, child)
        self._end = end

    def after(self, status: Status) -> Status:
        if status is Status.RUNNING:
            return status
        if self._end == "success":
            return Status.SUCCESS
        if status is Status.SUCCESS:
            return self.fails(
                "FORCED", f"{self.decorated.name} succeeded, which counts as a failure here"
            )
        return Status.FAILURE


class ForceType(Modifier):
    """ends with a fixed status"""

    key = "force"
    symbol = "!"
    value = takes.Value(Port(str, choices=("success", "failure")), known=True)
    other_names = ("ForceSuccess", "ForceFailure")

    def possible_outcome(self, at: OutcomeContext) -> Outcome:
        inside = at.inside()
        end = at.literal(self.key)
        succeeds = end != "failure" and (inside.succeeds or bool(inside.codes))
        return Outcome(
            NO_CODES if end == "success" else inside.codes | {"FORCED"}, succeeds, inside.skips
        )

    def written_ports(self, at: FlowContext, before: Names) -> Ends:
        ends = at.inside(before)
        both = ends.success & ends.failure
        if at.literal(self.key) == "failure":
            return Ends(ALL, both, ends.skipped)
        return Ends(both, ALL, ends.skipped)

    makes = Force
    gives = ("literal",)


class Invert(Wrapper):
    """Succeeds when its child fails, and fails when it succeeds."""

    def after(self, status: Status) -> Status:
        if status is Status.SUCCESS:
            return self.fails(
                "INVERTED", f"{self.decorated.name} succeeded, which counts as a failure here"
            )
        return status if status is Status.RUNNING else Status.SUCCESS


class InvertType(Modifier):
    """success and failure change places"""

    key = "invert"
    symbol = "!"
    value = takes.Value(Port(bool), known=True)
    other_names = ("Inverter",)

    def needed(self, at: NodeContext) -> bool:
        return at.literal(self.key) is not False

    def possible_outcome(self, at: OutcomeContext) -> Outcome:
        return Outcome(frozenset({"INVERTED"}), skips=at.inside().skips)

    def written_ports(self, at: FlowContext, before: Names) -> Ends:
        ends = at.inside(before)
        return Ends(ends.failure, ends.success, ends.skipped)

    makes = Invert
