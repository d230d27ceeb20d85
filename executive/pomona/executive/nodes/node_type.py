"""Base of the words of the tree language: one class defines a composite, a modifier or a leaf completely.

The reader, the checker, the builder, the JSON Schema, drawings and the documentation use it; none of them
knows a word by its name. A package adds words of its own by entry point (group `pomona.nodes`, name → class):

    class Paced(Modifier):
        \"\"\"limits the rate at which its child starts\"\"\"

        key, symbol = "paced", "♩"
        value = takes.Value(Port(RATE, min="0.001 Hz"))

        def build(self, at: BuildContext) -> Behaviour:
            return Pace(at.name, at.inside(), at.value("paced"), at.now)

A `Modifier` has the ends and outputs of the node inside, unless it overrides `possible_outcome` and `written_ports`.
Composites and leaves must define both.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from enum import IntEnum
from functools import cached_property
from typing import Any, ClassVar, Literal, Protocol

from py_trees.behaviour import Behaviour

from pomona.executive.nodes.context import (
    Around,
    BuildContext,
    CheckContext,
    Entry,
    FactContext,
    FlowContext,
    NodeContext,
    OutcomeContext,
)
from pomona.executive.nodes.facts import ALL, Ends, Facts, Names, Outcome
from pomona.executive.ports import Port
from pomona.executive.values.findings import Findings
from pomona.executive.values.yaml_nodes import YamlMapping, YamlNode, YamlScalar

Schema = dict[str, Any]
Role = Literal["composite", "leaf", "modifier"]  # where a type may stand


class Stage(IntEnum):
    """In which order the names that nodes write become known: types that are declared, computed ones, unknown ones."""

    DECLARED = 0
    COMPUTED = 1
    UNKNOWN = 2


@dataclass(slots=True, eq=False)
class TreeNode:
    """One node of a tree file with its modifiers."""

    type: NodeType  # its node type
    key: YamlScalar  # its type as written
    value: YamlNode  # the value of the type's key
    at: YamlMapping  # the whole mapping
    name: YamlScalar | None = None
    description: str = ""
    comment: str = ""
    children: list[TreeNode] = field(
        default_factory=list
    )  # nodes that belong to its type, in order
    leads: list[str] = field(default_factory=list)  # labels before each child in a drawing
    # nodes that belong to a modifier, by the modifier's field: `on_failure`
    parts: dict[str, TreeNode] = field(default_factory=dict)
    # of a skill, a subtree, `set` or `fail`: by port, the key and its wiring
    ports: dict[str, Entry] = field(default_factory=dict)
    # the keys beside the type except name and description, by name
    modifiers: dict[str, Entry] = field(default_factory=dict)
    wrapping: tuple[Modifier, ...] = field(
        default=(), init=False
    )  # its modifiers, from the inside to the outside
    # its modifiers from the outside to the inside, then its type
    layers: tuple[NodeType, ...] = field(default=(), init=False)

    def __post_init__(self) -> None:
        self.layers = (self.type,)

    def wrap(self, modifiers: tuple[Modifier, ...]) -> None:
        """Set its modifiers, from the inside to the outside."""
        self.wrapping = modifiers
        self.layers = (*reversed(modifiers), self.type)

    @property
    def kind(self) -> str:
        """Its type's word: sequence, check …; `skill` or `subtree` for a call by name."""
        return self.type.key

    @property
    def label(self) -> str:
        """Display name."""
        return self.name.text if self.name is not None else self.key.text

    @property
    def decorators(self) -> list[str]:
        """Its modifiers' words, from the inside to the outside."""
        return [modifier.key for modifier in self.wrapping]

    @property
    def on_failure(self) -> TreeNode | None:
        """The steps after a failed try."""
        return self.parts.get("on_failure")

    def entry(self, layer: NodeType, slot: str) -> Entry | None:
        """Return the entry for one of its layers, with the word before it: the layer's own word, or a field's."""
        if layer is self.type and slot == layer.key:
            return self.key, self.value
        return self.modifiers.get(slot)

    def below(self) -> list[TreeNode]:
        """Return nodes directly below, its modifiers' after its own."""
        return [*self.children, *self.parts.values()]

    def walk(self) -> Iterator[TreeNode]:
        """This node and all below, in the order of a drawing."""
        stack = [self]
        while stack:
            node = stack.pop()
            yield node
            if node.children or node.parts:
                stack.extend(reversed(node.below()))


class OfLayer:
    """One layer of a node, asked for what is written in it."""

    __slots__ = ()
    node: TreeNode
    layer: NodeType
    found: Any

    def written(self, slot: str) -> YamlNode | None:
        """Return the node behind one of its words."""
        entry = self.node.entry(self.layer, slot)
        return None if entry is None else entry[1]

    def literal(self, slot: str) -> Any:
        """Return its value where it is known before the run."""
        return self.found.setting(slot, None)


class Reading(Protocol):
    """A tree file's nodes being read."""

    @property
    def findings(self) -> Findings:
        """Where findings are reported."""

    def node(self, written: YamlNode) -> TreeNode | None:
        """Read a node; None when it cannot be one, which is reported."""

    def comment(self, line: int) -> str:
        """Return the comment on a line and the lines of comment above it, each given once."""


class Field(ABC):
    """The value of a word: its shape, its check, its JSON Schema. Concrete ones are in `takes`.

    Attributes:
        help: description in one line, for editors.
        required: whether a node of the type must have it.
        nodes: whether nodes stand in it.
        wires: whether ports stand in it.
    """

    nodes: ClassVar[bool] = False
    wires: ClassVar[bool] = False

    def __init__(self, help: str = "", *, required: bool = False) -> None:
        self.help = help
        self.required = required

    def take(
        self, reading: Reading, node: TreeNode, owner: NodeType, slot: str, written: YamlNode
    ) -> None:
        """Read nodes and ports that stand in it, and report a wrong shape; called without any skills."""
        return

    def declare(self, at: CheckContext, slot: str, stage: Stage) -> None:
        """Declare the names that it writes; called for every field of a type, also for absent ones."""
        return

    def check_value(self, at: CheckContext, slot: str, written: YamlNode) -> None:
        """Check its values and keep them under the slot."""
        return

    @abstractmethod
    def schema(self, literal: Callable[[Port], Schema]) -> Schema:
        """JSON Schema; `literal` gives that of a port's value or wire."""

    def described(self, literal: Callable[[Port], Schema]) -> Schema:
        """Return the schema with its help."""
        found = self.schema(literal)
        return {**found, "description": self.help} if self.help else found


class NodeType(ABC):
    """A composite, a leaf or a modifier. The docstring's first line is its description in the documentation."""

    key: ClassVar[str]  # its word in tree files
    symbol: ClassVar[str]  # one character for drawings
    role: ClassVar[Role]  # where it may stand
    value: ClassVar[Field]  # the kind of its value
    fields: ClassVar[Mapping[str, Field]] = {}  # words that may stand beside it
    # slots whose reads the type itself follows in `written_ports`, since they happen after its child has ended
    late: ClassVar[frozenset[str]] = frozenset()
    calls: ClassVar[bool] = False  # whether the node is called by the name of a skill or a subtree
    # whether it ends in the tick in which it starts, without other nodes acting
    instant: ClassVar[bool] = False
    named: ClassVar[bool] = True  # whether the behaviour of a modifier shows its word
    makes: ClassVar[
        Callable[..., Behaviour]
    ]  # class of its behaviour, without a `build` of its own
    gives: ClassVar[tuple[str, ...]] = ()  # what it needs besides: condition, value, now
    codes: ClassVar[tuple[str, ...]] = ()  # with which the word itself may fail
    skips: ClassVar[bool] = False  # whether a modifier may skip its node
    faithful: ClassVar[bool] = False  # whether a success is that of one start of its node
    ends: ClassVar[
        tuple[str, ...]
    ] = ()  # ends that a test should see: success, failure, skipped, not skipped
    colour: ClassVar[str] = "#444444"  # in pictures
    other_names: ClassVar[
        tuple[str, ...]
    ] = ()  # names of the same word in BehaviorTree.CPP and others

    @property
    def summary(self) -> str:
        """Description in one line."""
        return (type(self).__doc__ or "").strip().split("\n")[0]

    @cached_property
    def slots(self) -> dict[str, Field]:
        """Its own word and its fields."""
        return {self.key: self.value, **self.fields}

    @cached_property
    def declares(self) -> bool:
        """Whether it may write names."""
        own = type(self).declare is not NodeType.declare
        return own or any(type(taken).declare is not Field.declare for taken in self.slots.values())

    # ---------------------------------------------------------------------------------------- before the run

    def declare(self, at: CheckContext, stage: Stage) -> None:
        """Declare the names that it writes."""
        for slot, taken in self.slots.items():
            taken.declare(at, slot, stage)

    def check_values(self, at: CheckContext) -> None:
        """Check the values of the type's own words."""
        for slot, taken in self.slots.items():
            written = at.written(slot)
            if written is not None and slot not in self.late:
                taken.check_value(at, slot, written)

    def check_layer(self, at: CheckContext) -> None:
        """Check the values, then everything inside."""
        self.check_values(at)
        for index in range(len(at.node.children)):
            at.child(index, self.around(at, index))

    def around(self, at: CheckContext, index: int) -> Around:
        """Return the names that a child finds around it."""
        return at.around

    @abstractmethod
    def possible_outcome(self, at: OutcomeContext) -> Outcome:
        """How it can end."""

    @abstractmethod
    def written_ports(self, at: FlowContext, before: Names) -> Ends:
        """Return the names written at each of its ends, given those written before it."""

    def known_facts(self, at: FactContext, known: Facts) -> Facts:
        """Return the facts after its success. By default its children may run in any order and repeatedly."""
        if at.node.children:
            inside = at.share(known)
            for index in range(len(at.node.children)):
                at.child(index, inside)
        return at.forget(known)

    def needed(self, at: NodeContext) -> bool:
        """Return True if it does anything as it is written (`invert: false` does not)."""
        return True

    # ---------------------------------------------------------------------------------------- at the run

    def pauses(self, at: NodeContext) -> Literal["before", "after"] | None:
        """On which side of the node the run pauses, if it does."""
        return None

    def build(self, at: BuildContext) -> Behaviour:
        """Return its behaviour, with everything inside. A behaviour should explain its failure (`explain`)."""
        given = [at.now if word == "now" else getattr(at, word)(self.key) for word in self.gives]
        inside = [at.inside()] if self.role == "modifier" else []
        return type(self).makes(at.name, *inside, *given)

    def choices(self, node: TreeNode) -> tuple[str, ...]:
        """Return the answers of a type that asks the operator; none for any other."""
        return ()


class Composite(NodeType):
    """A type with children."""

    role = "composite"


class Leaf(NodeType):
    """A type without children."""

    role = "leaf"
    symbol = "●"

    def possible_outcome(self, at: OutcomeContext) -> Outcome:
        return Outcome(frozenset(self.codes))

    def written_ports(self, at: FlowContext, before: Names) -> Ends:
        """Its outputs are written when it succeeds; nothing when it fails."""
        outcome = self.possible_outcome(at.outcomes)
        fails = bool(outcome.codes) or at.computes
        success = before.plus(*at.outputs) if outcome.succeeds else ALL
        return Ends(success, before if fails else ALL, before if outcome.skips else ALL)


class Modifier(NodeType):
    """A type that stands beside another and wraps it."""

    role = "modifier"
    outside_of: ClassVar[str] = ""  # the modifier that it wraps directly; by default it wraps all

    def check_layer(self, at: CheckContext) -> None:
        super_around = self.around(at, 0)
        self.check_values(at)
        for slot in at.node.parts:
            if slot in self.fields:
                at.part(slot, self.around(at, 1))
        at.inside(super_around)

    def possible_outcome(self, at: OutcomeContext) -> Outcome:
        inside = at.inside().plus(*self.codes)
        return replace(inside, skips=inside.skips or self.skips)

    def written_ports(self, at: FlowContext, before: Names) -> Ends:
        success, failure, skipped = at.inside(before)
        failure = failure & before if self.codes else failure
        return Ends(success, failure, skipped & before if self.skips else skipped)

    def known_facts(self, at: FactContext, known: Facts) -> Facts:
        """Return the facts after its success; unless `faithful` it may restart its child, and succeed without it."""
        if self.faithful:
            return at.inside(known)
        for slot in at.node.parts:
            if slot in self.fields:
                at.part(slot, at.forget(known))
        at.inside(at.forget(known))
        return at.forget(known)
