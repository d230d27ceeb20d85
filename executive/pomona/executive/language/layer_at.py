"""One layer of a node whose names are resolved: the common base of every walk over a definition."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

from pomona.executive.language.model import TreeNode
from pomona.executive.language.outcomes import LayerOutcome, Outcomes
from pomona.executive.language.scope import Resolved
from pomona.executive.nodes.node_type import NodeType
from pomona.executive.values.yaml_nodes import YamlNode


class Walk(Protocol):
    """A walk over one definition."""

    outcomes: Outcomes


W = TypeVar("W", bound=Walk)


@dataclass(slots=True, eq=False)
class LayerAt(Generic[W]):
    """One layer of a node, on a walk."""

    whole: W
    node: TreeNode
    index: int
    layer: NodeType
    found: Resolved

    @property
    def outcomes(self) -> LayerOutcome:
        """Return the possible ends of the layer, of its children and of their contents."""
        return LayerOutcome(self.whole.outcomes, self.node, self.index)

    def written(self, slot: str) -> YamlNode | None:
        """Return the node behind one of its words."""
        entry = self.node.entry(self.layer, slot)
        return None if entry is None else entry[1]

    def literal(self, slot: str) -> Any:
        """Return its value where it is known before the run."""
        return self.found.setting(slot, None)
