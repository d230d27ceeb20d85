"""Flow through a definition: the ends of nodes, the names that are written and the conditions that hold at each place.

A node type returns the facts that hold after the node (`NodeType.known_facts`). This module turns conditions into
facts and reports contradictions.

For each node the analysis finds the names that are certainly written when the node succeeds, fails or is skipped. The
node's type computes them from its children.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Any, Generic, Protocol, TypeVar

from pomona.executive.language.expression import comparisons_of_words, references
from pomona.executive.language.expression_run import always_same, fact_of
from pomona.executive.language.literals import LiteralError, literal
from pomona.executive.language.model import Definition, TreeNode
from pomona.executive.language.scope import ComputedValue, Given, Named, Read, Resolved, Scope
from pomona.executive.language.value_types import SI_NUMBER, ValueType
from pomona.executive.nodes.facts import UNKNOWN, Ends, Fact, Facts, Names, Outcome, Plain, Possible
from pomona.executive.nodes.node_type import NodeType, OfLayer
from pomona.executive.nodes.takes import Value
from pomona.executive.ports import Quantity
from pomona.executive.registry import Registry
from pomona.executive.values.findings import Findings
from pomona.executive.values.yaml_nodes import YamlScalar

_ANYHOW = Outcome(frozenset({UNKNOWN}))


class Outcomes:
    """Outcomes of nodes, looked up once each."""

    def __init__(self, skills: Registry, called: Mapping[int, Definition]) -> None:
        """`called` maps the id of each subtree node to the definition that it calls."""
        self.called = called
        self._known: dict[tuple[int, int], Outcome] = {}
        self._open: set[int] = set()
        self._skills = skills

    def of(self, node: TreeNode) -> Outcome:
        """Of a node with its modifiers."""
        return self.layer(node, 0)

    def layer(self, node: TreeNode, index: int) -> Outcome:
        """Of a node without its outer modifiers."""
        key = (id(node), index)
        known = self._known.get(key)
        if known is None:
            at = LayerOutcome(self, node, index)
            layer = node.layers[index]
            known = self._known[key] = (
                layer.possible_outcome(at) if layer.needed(at) else at.inside()
            )
        return known

    def of_skill(self, name: str) -> Outcome:
        """Of a skill, if there is one of this name."""
        skill = self._skills.get(name)
        return _ANYHOW if skill is None else Outcome(frozenset(skill.failures))

    def of_definition(self, definition: Definition) -> Outcome:
        """Of a subtree; a subtree that calls itself adds no codes."""
        if definition.root is None or id(definition) in self._open:
            return Outcome()
        self._open.add(id(definition))
        outcome = self.of(definition.root)
        self._open.discard(id(definition))
        return outcome


@dataclass(slots=True, eq=False)
class LayerOutcome(OfLayer):
    """One layer of a node, asked how it can end (an `OutcomeContext`)."""

    outcomes: Outcomes
    node: TreeNode
    index: int

    @property
    def layer(self) -> NodeType:  # type: ignore[override]
        """The node type of this layer."""
        return self.node.layers[self.index]

    def literal(self, slot: str) -> Any:
        taken = self.layer.slots.get(slot)
        written = self.written(slot)
        if (
            not isinstance(taken, Value)
            or not isinstance(written, YamlScalar)
            or "{" in written.text
        ):
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


class Walk(Protocol):
    """A walk over one definition."""

    outcomes: Outcomes


W = TypeVar("W", bound=Walk)


@dataclass(slots=True, eq=False)
class LayerAt(OfLayer, Generic[W]):
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
        self.known = {
            name: found.value
            for name, found in names
            if found.origin in fixed and found.value is not None
        }

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
        if (
            not known.known
            and not node.children
            and type(layer).known_facts is NodeType.known_facts
        ):
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
            names = frozenset(
                name for found in own if found is not None for name in found.outputs.values()
            )
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
        for words in comparisons_of_words(condition.expression):
            always = "always holds" if always_same(words, fixed) else "can never hold"
            message = (
                f"'{condition.text[words.offset : words.end]}' compares two words and {always}"
            )
            self.whole.findings.warning(
                condition.where, "words-alone", message, "a value stands in braces: '{name}'"
            )
        fact = fact_of(condition.expression, fixed, condition.where, condition.text)
        if fact is None or fact.names <= fixed.keys():
            return known
        if any(
            self.whole.scope.names[name].origin == "input"
            for name in fact.names & self.whole.scope.names.keys()
        ):
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
        names = {r.name for r in references(condition.expression)}
        fixed = self.whole.known
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
    return isinstance(value_type, type) and (
        value_type in (bool, int, float, str) or issubclass(value_type, Enum)
    )


def _shown(value: Given) -> str:
    return getattr(value.where, "text", str(value.value))


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
        return any(
            isinstance(v, ComputedValue)
            for v in (*self.found.inputs.values(), *self.found.settings.values())
        )

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
