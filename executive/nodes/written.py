"""A tree file's nodes as they are written, and what may stand behind a word."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from enum import IntEnum
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

from executive.ports import Port
from executive.values.findings import Findings
from executive.values.yaml_nodes import YamlMapping, YamlNode, YamlScalar

if TYPE_CHECKING:
    from executive.nodes.asking import Checking
    from executive.nodes.node_type import Modifier, NodeType

Entry = tuple[YamlScalar, YamlNode]
Schema = dict[str, Any]
Words = dict[str, Any]
"""A node of a tree file as plain values, ready to be written."""


class Stage(IntEnum):
    """In which order the names that nodes write become known: types that are declared, computed ones, unknown ones."""

    DECLARED = 0
    COMPUTED = 1
    UNKNOWN = 2


@dataclass(slots=True, eq=False)
class TreeNode:
    """One node of a tree file with its modifiers.

    Attributes:
        type: what it is.
        key: its type as written.
        value: what stands behind the type.
        at: the whole mapping.
        children: nodes that belong to its type, in order.
        leads: what stands before each child in a drawing.
        parts: nodes that belong to a modifier, by the modifier's field: `on_failure`.
        ports: of a skill, a subtree, `set` or `fail`: by port, the key and what is wired to it.
        modifiers: all that stands beside the type but name and description, by name.
        wrapping: its modifiers, from the inside to the outside.
        layers: its modifiers from the outside to the inside, then its type.
    """

    type: NodeType
    key: YamlScalar
    value: YamlNode
    at: YamlMapping
    name: YamlScalar | None = None
    description: str = ""
    comment: str = ""
    children: list[TreeNode] = field(default_factory=list)
    leads: list[str] = field(default_factory=list)
    parts: dict[str, TreeNode] = field(default_factory=dict)
    ports: dict[str, Entry] = field(default_factory=dict)
    modifiers: dict[str, Entry] = field(default_factory=dict)
    wrapping: tuple[Modifier, ...] = ()
    layers: tuple[NodeType, ...] = ()

    def __post_init__(self) -> None:
        self.layers = (*reversed(self.wrapping), self.type)

    def wrap(self, modifiers: tuple[Modifier, ...]) -> None:
        """Set its modifiers, from the inside to the outside."""
        self.wrapping = modifiers
        self.layers = (*reversed(modifiers), self.type)

    @property
    def kind(self) -> str:
        """Its type's word: sequence, check …; `skill` or `subtree` for what is called by a name."""
        return self.type.key

    @property
    def label(self) -> str:
        """What people call it."""
        return self.name.text if self.name is not None else self.key.text

    @property
    def decorators(self) -> list[str]:
        """Its modifiers' words, from the inside to the outside."""
        return [modifier.key for modifier in self.wrapping]

    @property
    def on_failure(self) -> TreeNode | None:
        """What follows a failed try."""
        return self.parts.get("on_failure")

    def entry(self, layer: NodeType, slot: str) -> Entry | None:
        """What is written for one of its layers, with the word before it: the layer's own word, or a field's."""
        if layer is self.type and slot == layer.key:
            return self.key, self.value
        return self.modifiers.get(slot)

    def below(self) -> list[TreeNode]:
        """Nodes directly below, its modifiers' after its own."""
        return [*self.children, *self.parts.values()]

    def walk(self) -> Iterator[TreeNode]:
        """This node and all below, in the order of a drawing."""
        yield self
        for child in self.below():
            yield from child.walk()


class Reading(Protocol):
    """A tree file's nodes being read."""

    @property
    def findings(self) -> Findings:
        """Where findings are reported."""
        ...

    def node(self, written: YamlNode) -> TreeNode | None:
        """Read a node; None when it cannot be one, which is reported."""
        ...

    def comment(self, line: int) -> str:
        """The comment on a line and the lines of comment above it, each given once."""
        ...


class Field(ABC):
    """What may stand behind a word: its shape, its check, its JSON Schema. Concrete ones are in `takes`.

    Attributes:
        help: one line for editors.
        required: whether a node of the type must have it.
        nodes: whether nodes stand in it.
        wires: whether ports stand in it.
    """

    nodes: ClassVar[bool] = False
    wires: ClassVar[bool] = False

    def __init__(self, help: str = "", *, required: bool = False) -> None:
        self.help, self.required = help, required

    def take(self, reading: Reading, node: TreeNode, owner: NodeType, slot: str, written: YamlNode) -> None:
        """Read nodes and ports that stand in it, and report a wrong shape; called without any skills."""
        return

    def declare(self, at: Checking, slot: str, stage: Stage) -> None:
        """Say which names it writes; called for every field of a type, also for those that are not written."""
        return

    def check(self, at: Checking, slot: str, written: YamlNode) -> None:
        """Check its values and keep them under the slot."""
        return

    @abstractmethod
    def schema(self, literal: Callable[[Port], Schema]) -> Schema:
        """JSON Schema; `literal` gives that of a port's value or wire."""

    def described(self, literal: Callable[[Port], Schema]) -> Schema:
        """The schema with its help."""
        found = self.schema(literal)
        return {**found, "description": self.help} if self.help else found
