"""Context of a node type's methods: one Protocol for each purpose, over one layer of a node.

A layer is the node's type or one of its modifiers. The language checks, follows data and facts, builds and writes XML.
For each purpose it passes itself to the type, which sees only the data that its answer may depend on.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

from py_trees.behaviour import Behaviour

from pomona.executive.nodes.conditions import Condition
from pomona.executive.nodes.ends import Ends, Names, Outcome
from pomona.executive.nodes.facts import Facts
from pomona.executive.nodes.surroundings import Around
from pomona.executive.ports import Port
from pomona.executive.values.findings import Findings
from pomona.executive.values.yaml_nodes import YamlNode, YamlScalar

Entry = tuple[YamlScalar, YamlNode]
Words = dict[str, Any]
"""A node of a tree file as plain values, ready to be written."""


class Written(Protocol):
    """A node as it stands in a tree file (`node_type.TreeNode`)."""

    @property
    def key(self) -> YamlScalar:
        """Its type as written."""
        ...

    @property
    def kind(self) -> str:
        """Its type's word."""
        ...

    @property
    def label(self) -> str:
        """Display name."""
        ...

    @property
    def children(self) -> Sequence[Written]:
        """Nodes that belong to its type, in order."""
        ...

    @property
    def leads(self) -> Sequence[str]:
        """Labels before each child in a drawing."""
        ...

    @property
    def parts(self) -> Mapping[str, Written]:
        """Nodes that belong to a modifier, by the modifier's field."""
        ...

    @property
    def ports(self) -> Mapping[str, Entry]:
        """Wiring of its ports."""
        ...

    @property
    def modifiers(self) -> Mapping[str, Entry]:
        """All that stands beside the type but name and description, by name."""
        ...


class Asking(Protocol):
    """A layer of a node: the node's type, or one of its modifiers."""

    @property
    def node(self) -> Written: ...

    def written(self, slot: str) -> YamlNode | None:
        """Return the node behind the layer's own word or one of its fields."""
        ...

    def literal(self, slot: str) -> Any:
        """Return a value that is known before the run; None when there is none or it is not known yet."""
        ...


class Ending(Asking, Protocol):
    """A layer whose possible ends are computed."""

    def inside(self) -> Outcome:
        """Return the possible ends of the node inside a modifier."""
        ...

    def child(self, index: int) -> Outcome:
        """How one child can end."""
        ...

    def children(self) -> list[Outcome]:
        """How each child can end."""
        ...

    def part(self, slot: str) -> Outcome | None:
        """Return the node in a modifier's field, if it is written."""
        ...

    def skill(self) -> Outcome:
        """Of the skill that the node calls."""
        ...

    def subtree(self) -> Outcome:
        """Of the subtree that the node calls."""
        ...


class Checking(Asking, Protocol):
    """A layer being checked."""

    @property
    def around(self) -> Around:
        """Names around the node: counters, the last failure, names of items."""
        ...

    @property
    def findings(self) -> Findings:
        """Where findings are reported."""
        ...

    @property
    def outcomes(self) -> Ending:
        """How this node's children can end."""
        ...

    def condition(self, slot: str, written: YamlNode, around: Around | None = None) -> None:
        """Check an expression that must be true or false, and keep it."""
        ...

    def value(self, slot: str, written: YamlNode, port: Port, who: str = "", *, known: bool = False) -> None:
        """Check the value of a port, and keep it; with `known` it must be known before the run."""
        ...

    def elements(self, slot: str, written: YamlNode) -> None:
        """Check a list, and keep it."""
        ...

    def keep(self, slot: str, value: object, written: YamlNode) -> None:
        """Keep a value that is known before the run."""
        ...

    def wires(self, inputs: Mapping[str, Port], outputs: Mapping[str, Port]) -> None:
        """Check the wiring of the node's ports."""
        ...

    def writes(self, slot: str, target: YamlScalar, written: YamlNode, element: bool) -> None:
        """Declare that a name is written with the value of an expression, or with its elements."""
        ...

    def item(self) -> str:
        """Return the name that this layer writes; empty when there is none."""
        ...

    def inside(self, around: Around) -> None:
        """Check the node inside a modifier."""
        ...

    def child(self, index: int, around: Around) -> None:
        """Check one child in its context."""
        ...

    def part(self, slot: str, around: Around) -> None: ...

    def look_up_skill(self) -> None:
        """Find the skill that the node calls, and declare its outputs."""
        ...

    def look_up_subtree(self) -> None:
        """Find the subtree that the node calls, or report that there is none."""
        ...

    def perhaps_writes(self) -> None:
        """Mark the outputs of an unknown skill as possibly written, so that one mistake gives one finding."""
        ...

    def call(self) -> None:
        """Check the wiring of the skill or the subtree that was found."""
        ...

    def devices(self, index: int) -> Mapping[str, str]:
        """Return devices that a child and all below it move, each with the first node that does."""
        ...


class Flowing(Asking, Protocol):
    """A layer whose data flow is computed."""

    @property
    def outcomes(self) -> Ending:
        """How this node's children can end."""
        ...

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names that the layer itself writes."""
        ...

    @property
    def computes(self) -> bool:
        """Whether the layer computes a value, which may be missing at the run."""
        ...

    def require(self, slot: str, names: Names) -> None:
        """Report names that a slot reads and that are not certainly written. A type handles its `late` slots itself."""
        ...

    def inside(self, before: Names) -> Ends: ...

    def child(self, index: int, before: Names) -> Ends:
        """Return the names written after one child, given those before it."""
        ...

    def part(self, slot: str, before: Names) -> Ends | None: ...


class Knowing(Asking, Protocol):
    """A layer whose constant conditions are computed."""

    @property
    def outcomes(self) -> Ending:
        """How this node's children can end."""
        ...

    def must(self, slot: str, known: Facts) -> Facts:
        """The condition in a slot holds from here on; one that cannot is reported."""
        ...

    def awaits(self, slot: str, known: Facts) -> Facts:
        """Return the same of a condition for which the node waits."""
        ...

    def assign(self, known: Facts) -> Facts:
        """The node's names have the values that are written for them."""
        ...

    def forget(self, known: Facts) -> Facts:
        """Return the facts that remain after any end of the node."""
        ...

    def share(self, known: Facts) -> Facts:
        """Return the facts that hold throughout the node's run, in whatever order its children run."""
        ...

    def inside(self, known: Facts) -> Facts:
        """Return the facts after a success of the node inside a modifier."""
        ...

    def child(self, index: int, known: Facts) -> Facts: ...

    def after(self, index: int, known: Facts) -> Facts:
        """Return the facts that remain after any end of one child."""
        ...

    def part(self, slot: str, known: Facts) -> Facts: ...


class Building(Asking, Protocol):
    """A layer being built. Its contents are built with the names of the scope; `names` replaces some of them."""

    @property
    def name(self) -> str:
        """Display name of the layer's behaviour."""
        ...

    @property
    def now(self) -> Callable[[], float]:
        """Seconds of the run's clock."""
        ...

    def given(self, slot: str) -> bool:
        """Return True if a value is written for a slot."""
        ...

    def value(self, slot: str, default: Any = None, **names: object) -> Callable[[], Any]:
        """Reads a value when it is called; raises `NoValue` when it is not there."""
        ...

    def condition(self, slot: str, **names: object) -> Condition: ...

    def inputs(self) -> Mapping[str, Callable[[], Any]]:
        """Getters of the node's inputs, by port."""
        ...

    def writer(self, name: str) -> Callable[[Any], None]:
        """Writes one of the names that the layer declared."""
        ...

    def skill(self) -> Behaviour:
        """Return the skill that the node calls, or its mock."""
        ...

    def subtree(self) -> Behaviour: ...

    def inside(self, **names: object) -> Behaviour: ...

    def child(self, index: int, **names: object) -> Behaviour:
        """Return the behaviour of one child, with further names in its scope."""
        ...

    def children(self, **names: object) -> list[Behaviour]:
        """Return the behaviours of all children, in their order."""
        ...

    def part(self, slot: str, **names: object) -> Behaviour | None: ...


class XmlOut(Asking, Protocol):
    """A layer being written as XML."""

    def text(self, slot: str) -> str:
        """Return the text behind a word as an attribute, or an empty text."""
        ...

    def plain(self, slot: str) -> bool:
        """Return True if BehaviorTree.CPP can read it: a number or a wire."""
        ...

    def milliseconds(self, slot: str) -> str:
        """Return a literal duration in whole milliseconds, else an empty text."""
        ...

    def ports(self) -> dict[str, str]: ...

    def element(self, tag: str, attributes: Mapping[str, str] | None = None) -> Any:
        """Return an element of BehaviorTree.CPP's own with everything that is inside the layer."""
        ...

    def own(self, attributes: Mapping[str, str]) -> Any:
        """Return an element of Pomona, whose model the file then holds."""
        ...

    def skill(self) -> Any:
        """Return the element of the skill that the node calls."""
        ...

    def subtree(self) -> Any: ...


class XmlIn(Protocol):
    """An element of XML being read."""

    @property
    def tag(self) -> str:
        """The XML element's tag."""
        ...

    @property
    def attributes(self) -> Mapping[str, str]:
        """All attributes of the XML element."""
        ...

    def get(self, name: str) -> str:
        """Return an attribute's text; empty when it is missing."""
        ...

    def value(self, name: str) -> object:
        """Return an attribute as it is written in tree files."""
        ...

    def duration(self, name: str) -> str:
        """Return an attribute in milliseconds as a duration."""
        ...

    def children(self) -> list[Words]:
        """Return the element's children, translated."""
        ...

    def ports(self) -> Words:
        """Return all attributes that are ports."""
        ...

    def refuse(self, message: str) -> Words:
        """Return a placeholder with the children, for an element without an equivalent node."""
        ...

    def wrap(self, child: Words, word: str, value: object, more: Words | None = None) -> Words:
        """Return a node with one more modifier around it."""
        ...
