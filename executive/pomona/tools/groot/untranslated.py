"""A placeholder for a foreign XML element without an equivalent word in the language."""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar

from py_trees.behaviour import Behaviour

from pomona.executive.nodes import takes
from pomona.executive.nodes.behaviours import Sequence
from pomona.executive.nodes.context import (
    BuildContext,
    CheckContext,
    FlowContext,
    NodeText,
    OutcomeContext,
)
from pomona.executive.nodes.facts import UNKNOWN, Ends, Names, Outcome
from pomona.executive.nodes.node_type import Composite, Field, NodeType, Reading, Schema, TreeNode
from pomona.executive.ports import Port
from pomona.executive.values.yaml_nodes import ShapeCheck, YamlList, YamlNode, YamlScalar


class PerhapsChildren(takes.Children):
    """A list of nodes that may be empty."""

    def take(
        self, reading: Reading, node: TreeNode, owner: NodeType, slot: str, written: YamlNode
    ) -> None:
        if not (isinstance(written, YamlList) and not written.items):
            super().take(reading, node, owner, slot, written)


class Attributes(Field):
    """Texts by name."""

    def take(
        self, reading: Reading, node: TreeNode, owner: NodeType, slot: str, written: YamlNode
    ) -> None:
        for _, value in ShapeCheck(reading.findings).entries(
            written, "attributes", "'name: text' for each"
        ):
            ShapeCheck(reading.findings).text(value)

    def schema(self, literal: Callable[[Port], Schema]) -> Schema:
        return {"type": "object"}


class UntranslatedType(Composite):
    """replaces an element for which `pomona import` has no equivalent node; refused, or run dry if `skills:` has it"""

    key, symbol, colour = "untranslated", "✂", "#a4262c"
    value = PerhapsChildren("the contents of the element")
    fields: ClassVar[takes.Fields] = {
        "element": takes.Value(Port(str), "the element's name", known=True, required=True),
        "attributes": Attributes("the element's attributes"),
    }

    @staticmethod
    def element(node: NodeText) -> str:
        """Return the element's name."""
        entry = node.modifiers.get("element")
        return entry[1].text if entry is not None and isinstance(entry[1], YamlScalar) else ""

    def check_layer(self, at: CheckContext) -> None:
        element = self.element(at.node)
        if not at.is_stand_in(element):
            message = f"<{element}> was imported without a translation"
            at.findings.error(
                at.node.key, "untranslated", message, "write its function with other nodes"
            )
        for index in range(len(at.node.children)):
            at.child(index, at.around)

    def possible_outcome(self, at: OutcomeContext) -> Outcome:
        return Outcome(frozenset({UNKNOWN}), skips=True)

    def written_ports(self, at: FlowContext, before: Names) -> Ends:
        success = before
        for index in range(len(at.node.children)):
            success = at.child(index, success).success
        return Ends(success, before, before)

    def build(self, at: BuildContext) -> Behaviour:
        """Build its children as a sequence: only a dry run gets here, since the element is not installed."""
        return Sequence(at.name, True, at.children())
