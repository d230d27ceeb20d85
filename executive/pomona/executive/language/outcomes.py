"""How nodes can end: with which codes they fail, whether they can succeed or be skipped."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pomona.executive.language.literals import LiteralError, literal
from pomona.executive.language.model import Definition, TreeNode
from pomona.executive.nodes.ends import UNKNOWN, Outcome
from pomona.executive.nodes.node_type import NodeType
from pomona.executive.nodes.takes import Value
from pomona.executive.registry import Registry
from pomona.executive.values.yaml_nodes import YamlNode, YamlScalar

_ANYHOW = Outcome(frozenset({UNKNOWN}))


class Outcomes:
    """Outcomes of nodes, looked up once each."""

    def __init__(self, skills: Registry, called: Mapping[int, Definition]) -> None:
        """`called` maps the id of each subtree node to the definition that it calls."""
        self.called = called
        self._known: dict[tuple[int, int], Outcome] = {}
        self._open: set[int] = set()
        self._skills = {name: Outcome(frozenset(skill.failures)) for name, skill in skills.items()}

    def of(self, node: TreeNode) -> Outcome:
        """Of a node with its modifiers."""
        return self.layer(node, 0)

    def layer(self, node: TreeNode, index: int) -> Outcome:
        """Of a node without its outer modifiers."""
        key = (id(node), index)
        known = self._known.get(key)
        if known is None:
            at, layer = LayerOutcome(self, node, index), node.layers[index]
            known = self._known[key] = layer.possible_outcome(at) if layer.needed(at) else at.inside()
        return known

    def of_skill(self, name: str) -> Outcome:
        """Of a skill, if there is one of this name."""
        return self._skills.get(name, _ANYHOW)

    def of_definition(self, definition: Definition) -> Outcome:
        """Of a subtree; a subtree that calls itself adds no codes."""
        if definition.root is None or id(definition) in self._open:
            return Outcome()
        self._open.add(id(definition))
        outcome = self.of(definition.root)
        self._open.discard(id(definition))
        return outcome


@dataclass(slots=True, eq=False)
class LayerOutcome:
    """One layer of a node, asked how it can end (an `OutcomeContext`)."""

    outcomes: Outcomes
    node: TreeNode
    index: int

    @property
    def layer(self) -> NodeType:
        """The node type of this layer."""
        return self.node.layers[self.index]

    def written(self, slot: str) -> YamlNode | None:
        entry = self.node.entry(self.layer, slot)
        return None if entry is None else entry[1]

    def literal(self, slot: str) -> Any:
        taken, written = self.layer.slots.get(slot), self.written(slot)
        if not isinstance(taken, Value) or not isinstance(written, YamlScalar) or "{" in written.text:
            return None
        try:
            return literal(written, taken.port.type, taken.port.choices)
        except LiteralError:
            return None

    def inside(self) -> Outcome:
        return self.outcomes.layer(self.node, self.index + 1)

    def child(self, index: int) -> Outcome:
        """How one child can end."""
        return self.outcomes.of(self.node.children[index])

    def children(self) -> list[Outcome]:
        """How each child can end."""
        return [self.outcomes.of(child) for child in self.node.children]

    def part(self, slot: str) -> Outcome | None:
        part = self.node.parts.get(slot)
        return None if part is None else self.outcomes.of(part)

    def skill(self) -> Outcome:
        return self.outcomes.of_skill(self.node.key.text)

    def subtree(self) -> Outcome:
        called = self.outcomes.called.get(id(self.node))
        return _ANYHOW if called is None else self.outcomes.of_definition(called)
