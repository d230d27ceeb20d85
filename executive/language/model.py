"""A tree file as it is written: definitions and nodes, each with its place in the text."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from executive.values.findings import Finding, Source
from executive.values.yaml_nodes import YamlMapping, YamlNode, YamlScalar

BRANCHES = ("sequence", "reactive_sequence", "fallback", "reactive_fallback", "parallel", "recovery")
"""Types whose value is a list of nodes."""

LEAVES = ("check", "wait_until", "wait", "set", "succeed", "fail")
"""Types that the language has without any skill."""

DECORATORS = ("timeout", "invert", "force", "retry", "repeat", "for_each", "guard", "when")
"""Modifiers that wrap a node, from the inside to the outside."""

MODIFIERS = ("name", "description", *DECORATORS, "on_failure", "retry_if", "as")
SPECIFIC: dict[str, tuple[str, ...]] = {"parallel": ("success_on",), "recovery": ("attempts",)}
"""Modifiers of one type only."""

Entry = tuple[YamlScalar, YamlNode]


@dataclass(slots=True, eq=False)
class TreeNode:
    """One node with its modifiers.

    Attributes:
        kind: one of BRANCHES or LEAVES, or `skill` or `subtree`.
        key: its type as written.
        value: what stands behind the type.
        at: the whole mapping.
        ports: of a skill, a subtree or `set`: by port, the key and what is wired to it.
        modifiers: all but name, description and on_failure, by name.
    """

    kind: str
    key: YamlScalar
    value: YamlNode
    at: YamlMapping
    name: YamlScalar | None = None
    description: str = ""
    comment: str = ""
    children: list[TreeNode] = field(default_factory=list)
    ports: dict[str, Entry] = field(default_factory=dict)
    modifiers: dict[str, Entry] = field(default_factory=dict)
    on_failure: TreeNode | None = None

    @property
    def label(self) -> str:
        """What people call it."""
        return self.name.text if self.name is not None else self.key.text

    @property
    def decorators(self) -> list[str]:
        """Its wrapping modifiers, from the inside to the outside."""
        return [name for name in DECORATORS if name in self.modifiers]

    def walk(self) -> Iterator[TreeNode]:
        """This node and all below, in the order of the text."""
        yield self
        for child in self.children:
            yield from child.walk()
        if self.on_failure is not None:
            yield from self.on_failure.walk()


@dataclass(slots=True, eq=False)
class Declared:
    """A parameter, a constant or a port of a subtree's interface, as written."""

    key: YamlScalar
    type: YamlScalar | None = None
    default: YamlNode | None = None
    min: YamlNode | None = None
    max: YamlNode | None = None
    choices: list[YamlScalar] = field(default_factory=list)
    help: str = ""


@dataclass(slots=True, eq=False)
class Definition:
    """A tree with an interface: the file's main tree, or a subtree."""

    name: str
    at: YamlNode
    file: TreeFile
    inputs: dict[str, Declared] = field(default_factory=dict)
    outputs: dict[str, Declared] = field(default_factory=dict)
    root: TreeNode | None = None
    description: str = ""
    main: bool = False


@dataclass(slots=True, eq=False)
class TreeFile:
    """One file; `subtrees` holds those of other files too, under the names by which this file calls them."""

    source: Source
    name: str = ""
    description: str = ""
    main: Definition | None = None
    parameters: dict[str, Declared] = field(default_factory=dict)
    constants: dict[str, Declared] = field(default_factory=dict)
    subtrees: dict[str, Definition] = field(default_factory=dict)


@dataclass(slots=True, eq=False)
class Document:
    """A tree file with every file that it calls, and what reading them found."""

    path: str
    text: str
    main: TreeFile
    files: list[TreeFile]
    findings: list[Finding]

    def definitions(self) -> Iterator[Definition]:
        """Every definition once, whether it is called or not."""
        seen: set[int] = set()
        for file in self.files:
            for definition in (file.main, *file.subtrees.values()):
                if definition is not None and id(definition) not in seen:
                    seen.add(id(definition))
                    yield definition
