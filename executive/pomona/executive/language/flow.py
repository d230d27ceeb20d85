"""Data flow: is a port written on every path before it is read?

For each node the analysis finds the names that are certainly written when the node succeeds, fails or is skipped. The
node's type computes them from its children.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from pomona.executive.language.layer_at import LayerAt
from pomona.executive.language.model import TreeNode
from pomona.executive.language.outcomes import Outcomes
from pomona.executive.language.scope import ComputedValue, Read, Resolved
from pomona.executive.nodes.ends import Ends, Names


@dataclass(slots=True, eq=False)
class Flow:
    """Follows one definition; `unset(node, read)` is called for each read of a name that may not be written."""

    resolved: Mapping[tuple[int, str], Resolved]
    outcomes: Outcomes
    unset: Callable[[TreeNode, Read], None]

    def node(self, node: TreeNode, before: Names) -> Ends:
        """Follow a node with its modifiers."""
        return self.layer(node, 0, before)

    def layer(self, node: TreeNode, index: int, before: Names) -> Ends:
        """Follow a node without its outer modifiers."""
        layer = node.layers[index]
        found = self.resolved.get((id(node), layer.key))
        if found is None:
            return Ends(before, before)
        at = LayerFlow(self, node, index, layer, found)
        if not layer.needed(at):
            return at.inside(before)
        for read in found.reads:
            if read.slot not in layer.late:
                self.check(node, read, before)
        return layer.written_ports(at, before)

    def check(self, node: TreeNode, read: Read, written: Names) -> None:
        if read.required and read.name not in written:
            self.unset(node, read)


@dataclass(slots=True, eq=False)
class LayerFlow(LayerAt[Flow]):
    """One layer of a node whose data flow is followed (a `FlowContext`)."""

    @property
    def outputs(self) -> tuple[str, ...]:
        return tuple(self.found.outputs.values())

    @property
    def computes(self) -> bool:
        return any(isinstance(v, ComputedValue) for v in (*self.found.inputs.values(), *self.found.settings.values()))

    def require(self, slot: str, names: Names) -> None:
        for read in self.found.reads:
            if read.slot == slot:
                self.whole.check(self.node, read, names)

    def inside(self, before: Names) -> Ends:
        return self.whole.layer(self.node, self.index + 1, before)

    def child(self, index: int, before: Names) -> Ends:
        """Return the names written after one child, given those before it."""
        return self.whole.node(self.node.children[index], before)

    def part(self, slot: str, before: Names) -> Ends | None:
        part = self.node.parts.get(slot)
        return None if part is None else self.whole.node(part, before)
