"""Invert: success and failure change places."""

from __future__ import annotations

from py_trees.behaviour import Behaviour
from py_trees.common import Status

from pomona.executive.nodes import takes
from pomona.executive.nodes.behaviours import Wrapper
from pomona.executive.nodes.context import (
    BuildContext,
    FlowContext,
    NodeContext,
    OutcomeContext,
    Words,
    XmlExport,
    XmlImport,
)
from pomona.executive.nodes.ends import Ends, Names, Outcome
from pomona.executive.nodes.node_type import Modifier
from pomona.executive.ports import Port


class Invert(Wrapper):
    """Succeeds when its child fails, and fails when it succeeds."""

    def after(self, status: Status) -> Status:
        if status is Status.SUCCESS:
            return self.fails("INVERTED", f"{self.decorated.name} succeeded, which counts as a failure here")
        return status if status is Status.RUNNING else Status.SUCCESS


class InvertType(Modifier):
    """success and failure change places"""

    key, symbol = "invert", "!"
    value = takes.Value(Port(bool), known=True)
    xml_tags = ("Inverter",)

    def needed(self, at: NodeContext) -> bool:
        return at.literal(self.key) is not False

    def possible_outcome(self, at: OutcomeContext) -> Outcome:
        return Outcome(frozenset({"INVERTED"}), skips=at.inside().skips)

    def written_ports(self, at: FlowContext, before: Names) -> Ends:
        ends = at.inside(before)
        return Ends(ends.failure, ends.success, ends.skipped)

    def build(self, at: BuildContext) -> Behaviour:
        return Invert(at.name, at.inside())

    def to_xml(self, at: XmlExport) -> object:
        return at.element("Inverter")

    def from_xml(self, element: XmlImport) -> Words:
        (child,) = element.children()
        return element.wrap(child, self.key, True)
