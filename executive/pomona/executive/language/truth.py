"""Constant-condition analysis: conditions that never hold, and conditions that contradict earlier ones.

A node type returns the facts that hold after the node (`NodeType.known_facts`). This module turns conditions into
facts and reports contradictions.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Any

from pomona.executive.language.cases import always_same, fact_of
from pomona.executive.language.expression import references
from pomona.executive.language.layer_at import LayerAt
from pomona.executive.language.model import TreeNode
from pomona.executive.language.outcomes import Outcomes
from pomona.executive.language.scope import ComputedValue, Given, Named, Resolved, Scope
from pomona.executive.language.value_types import SI_NUMBER, ValueType
from pomona.executive.nodes.facts import Fact, Facts, Plain, Possible
from pomona.executive.nodes.node_type import NodeType
from pomona.executive.ports import Quantity
from pomona.executive.values.findings import Findings

NOTHING = Facts()


@dataclass(slots=True, eq=False)
class Truth:
    """Follows one definition with all names resolved."""

    findings: Findings
    scope: Scope
    resolved: Mapping[tuple[int, str], Resolved]
    outcomes: Outcomes
    written: dict[int, frozenset[str]] = field(default_factory=dict)
    known: dict[str, Any] = field(init=False)  # values that are the same for the whole run

    def __post_init__(self) -> None:
        fixed = ("constant", "parameter")
        names = self.scope.names.items()
        self.known = {name: found.value for name, found in names if found.origin in fixed and found.value is not None}

    def definition(self) -> None:
        """Follow it."""
        if self.scope.definition.root is not None:
            self.node(self.scope.definition.root, NOTHING)

    def node(self, node: TreeNode, known: Facts) -> Facts:
        """Return the facts after a node's success, given the facts before it."""
        return self.layer(node, 0, known)

    def layer(self, node: TreeNode, index: int, known: Facts) -> Facts:
        """Return the same of a node without its outer modifiers."""
        layer = node.layers[index]
        if not known.known and not node.children and type(layer).known_facts is NodeType.known_facts:
            return known  # nearly every leaf: it neither adds nor removes facts
        found = self.resolved.get((id(node), layer.key))
        if found is None:
            return NOTHING
        at = LayerTruth(self, node, index, layer, found)
        return layer.known_facts(at, known) if layer.needed(at) else at.inside(known)

    def writes(self, node: TreeNode) -> frozenset[str]:
        """Return all names that a node and everything below it writes."""
        if id(node) not in self.written:
            own = [self.resolved.get((id(node), layer.key)) for layer in node.layers]
            names = frozenset(name for found in own if found is not None for name in found.outputs.values())
            self.written[id(node)] = names.union(*(self.writes(below) for below in node.below()))
        return self.written[id(node)]


@dataclass(slots=True, eq=False)
class LayerTruth(LayerAt[Truth]):
    """One layer of a node (a `FactContext`)."""

    def must(self, slot: str, known: Facts) -> Facts:
        condition = self.found.settings.get(slot)
        if not isinstance(condition, ComputedValue):
            return known
        fixed = self.whole.known
        fact = fact_of(condition.expression, fixed, condition.where, condition.text)
        if fact is None or fact.names <= fixed.keys():
            return known
        if any(self.whole.scope.names[name].origin == "input" for name in fact.names & self.whole.scope.names.keys()):
            fact = replace(fact, lasts=False)  # its caller may write it meanwhile
        against = known.against(fact)
        if against is fact:
            message = f"'{fact.text}' can never hold"
            self.whole.findings.warning(condition.where, "never-holds", message)
        elif against is not None:
            message = f"'{fact.text}' cannot hold here: '{against.text}' holds (line {against.where.line})"
            self.whole.findings.warning(condition.where, "contradiction", message)
        return known.plus(fact)

    def awaits(self, slot: str, known: Facts) -> Facts:
        condition = self.found.settings.get(slot)
        if not isinstance(condition, ComputedValue):
            return known
        names, fixed = {r.name for r in references(condition.expression)}, self.whole.known
        known = known.without((), passing=True)
        if always_same(condition.expression, fixed) is False:
            message = f"'{condition.text}' can never hold: this waits for ever"
            self.whole.findings.warning(condition.where, "never-holds", message)
            return known
        if names and all(self.stands_still(name, known) for name in names):
            message = f"nothing writes {', '.join(sorted(names))} while this waits: it ends at once or never"
            hint = "write it in another child of a parallel around this, or use 'check'"
            self.whole.findings.warning(condition.where, "never-changes", message, hint)
        return self.must(slot, known)

    def stands_still(self, name: str, known: Facts) -> bool:
        """Return True if a name keeps its value while only this node runs."""
        named: Named | None = self.whole.scope.names.get(name)
        if named is None or name in known.shared or named.origin == "input":
            return False
        return named.origin in ("constant", "parameter") or _never_changes(named.type)

    def assign(self, known: Facts) -> Facts:
        known = self.forget(known)
        for name, value in self.found.inputs.items():
            if isinstance(value, Given) and isinstance(value.value, Plain):
                cases = ({name: Possible(among=frozenset({value.value}))},)
                text = f"set: {{{name}: {_shown(value)}}}"
                if not isinstance(value.value, str):
                    known = known.plus(Fact(cases, frozenset({name}), True, text, value.where))
        return known

    def forget(self, known: Facts) -> Facts:
        if not known.known:
            return known
        return known.without(self.whole.writes(self.node), passing=not self.layer.instant)

    def share(self, known: Facts) -> Facts:
        return known.sharing(self.whole.writes(self.node))

    def inside(self, known: Facts) -> Facts:
        return self.whole.layer(self.node, self.index + 1, known)

    def child(self, index: int, known: Facts) -> Facts:
        """Return the facts after one child's success."""
        return self.whole.node(self.node.children[index], known)

    def after(self, index: int, known: Facts) -> Facts:
        if not known.known:
            return known
        return known.without(self.whole.writes(self.node.children[index]), passing=True)

    def part(self, slot: str, known: Facts) -> Facts:
        return self.whole.node(self.node.parts[slot], known)


def _never_changes(value_type: ValueType) -> bool:
    """Return True if a value of the type does not change until the next write."""
    if isinstance(value_type, Quantity) or value_type is SI_NUMBER:
        return True
    return isinstance(value_type, type) and (value_type in (bool, int, float, str) or issubclass(value_type, Enum))


def _shown(value: Given) -> str:
    return getattr(value.where, "text", str(value.value))
