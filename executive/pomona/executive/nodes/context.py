"""The context of a node type: one layer of a node during one analysis, while it is built, or in XML.

A layer is the node's type or one of its modifiers. Each method of `NodeType` gets the context of its analysis, so its
answer depends on nothing else. All contexts are a `NodeContext`. The analyses that walk through a node pass a state to
`inside`, `child` and `part`: what surrounds the inner node, the written names or the known facts. language/README.md
follows one node through them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol, TypeVar

from py_trees.behaviour import Behaviour

from pomona.executive.nodes.facts import Condition, Ends, Facts, Names, Outcome
from pomona.executive.ports import Port
from pomona.executive.reasons import Reason
from pomona.executive.values.findings import Findings
from pomona.executive.values.yaml_nodes import YamlNode, YamlScalar


@dataclass(frozen=True, slots=True)
class Around:
    """The context of a node in the file."""

    counters: frozenset[str] = frozenset()  # which of `retry`, `repeat` and `for_each` count here
    failure: frozenset[str] | None = None  # codes of the last failure; None when there is none
    items: frozenset[str] = frozenset()  # names of the items of all for_each around
    failed: str = ""  # label of the node that has failed, for messages


@dataclass(slots=True)
class LastFailure:
    """The failure that led here: of the sibling before in a fallback, or of the try that `on_failure` follows."""

    code: str = ""
    message: str = ""
    node: str = ""
    codes: tuple[str, ...] = ()
    data: Mapping[str, Any] = field(default_factory=dict)

    def see(self, reason: Reason) -> None:
        """Replace it: code, message and data are the failed leaf's."""
        leaf = reason
        while leaf.causes:
            leaf = leaf.causes[-1]
        self.code = reason.code
        self.message = reason.message
        self.data = leaf.data
        self.node = leaf.node_path
        self.codes = tuple(sorted(reason.codes()))


@dataclass(slots=True)
class RetryCount:
    """The nearest retry around: number of this attempt, from 1, and how many there are."""

    attempt: int = 1
    of: int = 1


@dataclass(slots=True)
class RepeatCount:
    """The nearest repeat around: number of this round, from 1."""

    round: int = 1


@dataclass(slots=True)
class ForEachCount:
    """The nearest for_each around: number of this item, from 1, and how many there are."""

    index: int = 1
    of: int = 1


COUNTERS: Mapping[str, type[Any]] = {
    "retry": RetryCount,
    "repeat": RepeatCount,
    "for_each": ForEachCount,
}
"""Types of the counters, by the name in expressions."""


Entry = tuple[YamlScalar, YamlNode]

Before = TypeVar("Before", contravariant=True)
After = TypeVar("After", covariant=True)


class NodeText(Protocol):
    """A node as it stands in a tree file (`node_type.TreeNode`)."""

    @property
    def key(self) -> YamlScalar:
        """Its type as written."""

    @property
    def kind(self) -> str:
        """Its type's name."""

    @property
    def label(self) -> str: ...

    @property
    def children(self) -> Sequence[NodeText]:
        """Nodes that belong to its type, in order."""

    @property
    def leads(self) -> Sequence[str]:
        """Text before each child in a drawing."""

    @property
    def parts(self) -> Mapping[str, NodeText]:
        """Nodes that belong to a modifier, by the modifier's field."""

    @property
    def ports(self) -> Mapping[str, Entry]:
        """Wires of its ports."""

    @property
    def modifiers(self) -> Mapping[str, Entry]:
        """Entries beside the type except name and description, by name."""


class NodeContext(Protocol):
    """One layer of a node."""

    @property
    def node(self) -> NodeText: ...

    def written(self, slot: str) -> YamlNode | None:
        """Return the text behind the layer's own word or one of its fields."""

    def literal(self, slot: str) -> Any:
        """Return a value that is known before the run, else None."""


class OutcomeContext(NodeContext, Protocol):
    """The layer while its possible outcomes are determined."""

    def inside(self) -> Outcome:
        """Return the outcome of the node that a modifier wraps."""

    def child(self, index: int) -> Outcome:
        """Return the outcome of one child."""

    def children(self) -> list[Outcome]:
        """Return the outcome of each child."""

    def part(self, slot: str) -> Outcome | None:
        """Return the outcome of the node in a modifier's field, if it is written."""

    def skill(self) -> Outcome: ...

    def subtree(self) -> Outcome:
        """Return the outcome of the called subtree."""


class WalkContext(NodeContext, Protocol[Before, After]):
    """The layer in an analysis that walks through it with a state."""

    @property
    def outcomes(self) -> OutcomeContext:
        """Possible outcomes of this layer and the nodes in it."""

    def inside(self, before: Before, /) -> After:
        """Walk through the node that a modifier wraps."""

    def child(self, index: int, before: Before, /) -> After:
        """Walk through one child."""

    def part(self, slot: str, before: Before, /) -> After | None:
        """Walk through the node in a modifier's field, if it is written."""


class CheckContext(WalkContext[Around, None], Protocol):
    """The layer while its values and ports are checked."""

    @property
    def around(self) -> Around:
        """The node's surroundings: counters, the last failure, names of items."""

    @property
    def findings(self) -> Findings: ...

    def condition(self, slot: str, written: YamlNode, around: Around | None = None) -> None:
        """Check a Boolean expression, and keep it."""

    def value(
        self, slot: str, written: YamlNode, port: Port, who: str = "", *, known: bool = False
    ) -> None:
        """Check the value of a port, and keep it; `known` requires a value that is known before the run."""

    def elements(self, slot: str, written: YamlNode) -> None:
        """Check a list, and keep it."""

    def choice(self, slot: str, written: YamlNode) -> None:
        """Check a value that is compared with words, and keep it; a quantity is refused."""

    def keep(self, slot: str, value: object, written: YamlNode) -> None:
        """Keep a value that is known before the run."""

    def check_ports(self, inputs: Mapping[str, Port], outputs: Mapping[str, Port]) -> None:
        """Check the wires of the node's ports."""

    def declare_output(
        self, slot: str, target: YamlScalar, written: YamlNode, element: bool
    ) -> None:
        """Declare a name that the layer writes: the value of an expression, or its elements."""

    def item(self) -> str:
        """Return the name that this layer writes; empty without one."""

    def look_up_skill(self) -> None:
        """Find the skill that the node calls, and declare its outputs."""

    def look_up_subtree(self) -> None:
        """Find the subtree that the node calls, or report that there is none."""

    def mark_outputs_unknown(self) -> None:
        """Mark the names wired to a missing skill or subtree as perhaps written: one mistake, one finding."""

    def check_call(self) -> None:
        """Check the wires of the skill or the subtree."""

    def devices(self, index: int) -> Mapping[str, str]:
        """Return the devices that a child and all nodes in it move, each with the first such node."""


class FlowContext(WalkContext[Names, Ends], Protocol):
    """The layer while its data flow is followed: a state holds the names that are certainly written."""

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names that the layer itself writes."""

    @property
    def computes(self) -> bool:
        """True if the layer computes a value, which may be missing during the run."""

    def require(self, slot: str, names: Names) -> None:
        """Report the reads of a slot listed in `NodeType.late` that are not certainly written."""


class FactContext(WalkContext[Facts, Facts], Protocol):
    """The layer while conditions are followed: a state holds the facts that are certainly true."""

    def must(self, slot: str, known: Facts) -> Facts:
        """Add the condition of a slot; report one that cannot be true."""

    def awaits(self, slot: str, known: Facts) -> Facts:
        """Add a condition for which the node waits; report one that cannot become true."""

    def assign(self, known: Facts) -> Facts:
        """Add the values that the node writes."""

    def forget(self, known: Facts) -> Facts:
        """Return the facts that remain after any end of the node."""

    def share(self, known: Facts) -> Facts:
        """Return the facts that hold at every moment while the node runs, in any order of its children."""

    def after(self, index: int, known: Facts) -> Facts:
        """Return the facts that remain after any end of a child."""


class BuildContext(NodeContext, Protocol):
    """The layer while its behaviour is built; `names` replace names of the scope for the inner nodes."""

    @property
    def name(self) -> str:
        """Name of the layer's behaviour."""

    @property
    def now(self) -> Callable[[], float]:
        """Time on the run's clock [s]."""

    def given(self, slot: str) -> bool:
        """Return True if a value is written for a slot."""

    def value(self, slot: str, default: Any = None, **names: object) -> Callable[[], Any]:
        """Return a getter of a value; it raises `NoValue` if there is none."""

    def condition(self, slot: str, **names: object) -> Condition: ...

    def inputs(self) -> Mapping[str, Callable[[], Any]]:
        """Return a getter for each wired port."""

    def writer(self, name: str) -> Callable[[Any], None]:
        """Return a setter of a name that the layer declared."""

    def skill(self) -> Behaviour:
        """Return the skill that the node calls, or its mock."""

    def subtree(self) -> Behaviour:
        """Return the behaviour of the called subtree."""

    def inside(self, **names: object) -> Behaviour: ...

    def child(self, index: int, **names: object) -> Behaviour:
        """Return the behaviour of one child."""

    def children(self, **names: object) -> list[Behaviour]:
        """Return the behaviours of all children."""

    def part(self, slot: str, **names: object) -> Behaviour | None: ...
