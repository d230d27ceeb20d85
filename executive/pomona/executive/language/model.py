"""A tree file as it is written: definitions and nodes, each with its place in the text."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from pomona.executive.nodes.catalogue import NodeTypes
from pomona.executive.nodes.context import Entry
from pomona.executive.nodes.node_type import TreeNode
from pomona.executive.values.findings import Finding, Source
from pomona.executive.values.yaml_nodes import YamlMapping, YamlNode, YamlScalar

__all__ = ["Declared", "Definition", "Document", "Entry", "TreeFile", "TreeNode"]


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
    """One file; `subtrees` holds those of other files too, under the names by which this file calls them.

    `declared_skills` are the names of inputs and outputs of skills that need not be installed: a tree with them can be
    checked, drawn, run dry and exported.

    `cell` is the name or path of the cell that it is for, `success` the word that says when its task is done.

    `unread` are names of subtrees whose files hold no tree that could be read, which is a finding of its own.
    """

    source: Source
    name: str = ""
    description: str = ""
    main: Definition | None = None
    cell: YamlScalar | None = None
    success: YamlScalar | None = None
    parameters: dict[str, Declared] = field(default_factory=dict)
    constants: dict[str, Declared] = field(default_factory=dict)
    skills: dict[str, YamlScalar] = field(default_factory=dict)
    declared_skills: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = field(
        default_factory=dict
    )
    subtrees: dict[str, Definition] = field(default_factory=dict)
    unread: set[str] = field(default_factory=set)
    top: YamlMapping | None = None


@dataclass(slots=True, eq=False)
class Document:
    """A tree file with every file that it calls, the words of its language, and the findings of reading."""

    path: str
    text: str
    main: TreeFile
    files: list[TreeFile]
    findings: list[Finding]
    types: NodeTypes

    def definitions(self) -> Iterator[Definition]:
        """Yield every definition once, whether it is called or not."""
        seen: set[int] = set()
        for file in self.files:
            for definition in (file.main, *file.subtrees.values()):
                if definition is not None and id(definition) not in seen:
                    seen.add(id(definition))
                    yield definition

    def called(self, node: TreeNode) -> Definition | None:
        """Return the subtree that a node calls."""
        return next(
            (f.subtrees.get(node.key.text) for f in self.files if f.source is node.at.source), None
        )
