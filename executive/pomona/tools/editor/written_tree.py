"""A tree file's text with the place of every node in it, whether or not the tree means anything.

A node's address is a text: `root` is the first node of the file's tree, `root/0` its first child, `root/0/on_failure`
the node of a modifier. `look:root/1` stands in the subtree `look` of the file. Children count in the order of
`TreeNode`: of an `if` the condition is 0, `then` 1, `else` 2; of a `switch` the cases come first, `default` is last.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass, field

from pomona.executive.errors import PomonaError
from pomona.executive.nodes import takes
from pomona.executive.nodes.catalogue import NodeTypes
from pomona.executive.nodes.leaves import SKILL, SUBTREE
from pomona.executive.nodes.node_type import NodeType
from pomona.executive.values.findings import Finding, Findings, Source
from pomona.executive.values.yaml_nodes import (
    YamlList,
    YamlMapping,
    YamlNode,
    YamlScalar,
    read_yaml,
)

_BREAK = re.compile("\r\n|[\n\r\x85\u2028\u2029]")  # ends of lines in YAML
BOM = "\ufeff"
YamlPath = tuple[str | int, ...]


class EditError(PomonaError):
    """An edit that cannot be made: the reason, and the address of the node at fault."""

    def __init__(self, reason: str, node: str = "") -> None:
        self.reason = reason
        self.node = node
        super().__init__(f"{node}: {reason}" if node else reason)


def values_in(at: YamlNode) -> list[YamlNode]:
    """Return the items of a list, or the keys and values of a mapping."""
    if isinstance(at, YamlMapping):
        return [entry for pair in at.entries.values() for entry in pair]
    return at.items if isinstance(at, YamlList) else []


@dataclass(frozen=True, slots=True, eq=False)
class WrittenNode:
    """A node where it stands in the YAML."""

    id: str
    parent: str  # the address of the node around it; empty at a root
    index: int  # among the children of its parent's type; -1 of a modifier's part
    slot: str  # the word before it when it stands in no list: then, on_failure, a case; `root`
    at: YamlNode
    holder: YamlMapping | YamlList  # the mapping or list in which it stands
    path: YamlPath  # keys and indices from the top of the file
    kind: NodeType | None  # None when it has no type that could be read
    key: YamlScalar | None  # its type as written
    value: YamlNode | None  # the value of its type

    @property
    def mapping(self) -> YamlMapping:
        """Its mapping. Raises EditError: it has none, since it is a condition or cannot be read."""
        if not isinstance(self.at, YamlMapping) or self.key is None:
            raise EditError("this node is no mapping with a type, and is edited as text", self.id)
        return self.at

    @property
    def type_key(self) -> YamlScalar:
        """The key with its type. Raises EditError: it has none."""
        assert self.mapping is not None
        assert self.key is not None
        return self.key


@dataclass(slots=True, eq=False)
class WrittenTree:
    """A text, its YAML, and its nodes by address. Offsets count characters of `text`, without a byte order mark."""

    text: str
    types: NodeTypes = field(default_factory=NodeTypes.installed)
    source: Source = field(init=False)
    problems: list[Finding] = field(init=False)  # why it cannot be read as YAML
    root: YamlNode | None = field(init=False)
    top: YamlMapping | None = field(init=False)  # the root of a file
    nodes: dict[str, WrittenNode] = field(init=False, default_factory=dict)
    pairs: set[int] = field(
        init=False, default_factory=set
    )  # ids of mappings in brackets without braces: [Beep: {}]
    starts: list[int] = field(init=False)  # offsets of lines
    eol: str = field(init=False)
    _words: frozenset[str] = field(init=False)

    def __post_init__(self) -> None:
        breaks = list(_BREAK.finditer(self.text))
        self.starts = [0, *(found.end() for found in breaks)]
        self.eol = breaks[0][0] if breaks else "\n"
        self.source, findings = Source("", self.text), Findings()
        self.root = (
            read_yaml(self.source, findings, modifiers=self.types.beside)
            if self.text.strip()
            else None
        )
        self.problems = findings.sorted()
        self.top = self.root if isinstance(self.root, YamlMapping) else None
        self._words = frozenset({"name", "description", *self.types.beside, *self.types.fields})
        if self.top is not None:
            self._definition("", self.top, ())
            for name, at in self.subtrees().items():
                self._definition(f"{name}:", at, ("subtrees", name))

    def subtrees(self) -> dict[str, YamlMapping]:
        """Return the subtrees that are written in this file."""
        found = None if self.top is None else self.top.get("subtrees")
        entries = found.entries if isinstance(found, YamlMapping) else {}
        return {
            name: at
            for name, (_, at) in entries.items()
            if isinstance(at, YamlMapping) and "file" not in at.entries
        }

    def node(self, address: str) -> WrittenNode:
        """Return a node. Raises EditError: there is none at this address."""
        found = self.nodes.get(address)
        if found is None:
            raise EditError(f"there is no node at {address or 'an empty address'}", address)
        return found

    def below(self, address: str) -> Iterator[WrittenNode]:
        """Yield a node and all nodes below it."""
        for name, node in self.nodes.items():
            if name == address or name.startswith(f"{address}/"):
                yield node

    # ------------------------------------------------------------------------------------------------- nodes

    def _definition(self, prefix: str, at: YamlMapping, path: YamlPath) -> None:
        root = at.get("root")
        if root is not None and not (isinstance(root, YamlScalar) and root.is_null):
            self._node(f"{prefix}root", "", 0, "root", root, at, (*path, "root"))

    def _node(
        self,
        address: str,
        parent: str,
        index: int,
        slot: str,
        at: YamlNode,
        holder: YamlMapping | YamlList,
        path: YamlPath,
    ) -> None:
        entry = self.type_of(at)
        key, value = entry if entry is not None else (None, None)
        kind = self.kind_of(key.text) if key is not None else None
        self.nodes[address] = WrittenNode(
            address, parent, index, slot, at, holder, path, kind, key, value
        )
        if not isinstance(at, YamlMapping) or kind is None:
            return
        if isinstance(holder, YamlList) and self.is_flow(holder) and not self.is_flow(at):
            self.pairs.add(id(at))
        for modifier in self.types.modifiers if len(at.entries) > 1 else ():
            for word in modifier.fields if modifier.key in at.entries else ():
                part = at.get(word) if modifier.fields[word].nodes else None
                if part is not None:
                    self._node(f"{address}/{word}", address, -1, word, part, at, (*path, word))
        for index, (word, child, around, rest) in enumerate(self._children(at, kind, key)):
            self._node(f"{address}/{index}", address, index, word, child, around, (*path, *rest))

    def _children(
        self, at: YamlMapping, kind: NodeType, key: YamlScalar | None
    ) -> Iterator[tuple[str, YamlNode, YamlMapping | YamlList, YamlPath]]:
        for slot, taken in kind.slots.items():
            word = key.text if slot == kind.key and key is not None else slot
            value = at.get(word)
            if value is None or not taken.nodes:
                continue
            if isinstance(value, YamlList):
                yield from (
                    ("", item, value, (word, number)) for number, item in enumerate(value.items)
                )
            elif isinstance(taken, takes.Cases) and isinstance(value, YamlMapping):
                yield from (
                    (case, child, value, (word, case)) for case, (_, child) in value.entries.items()
                )
            elif not isinstance(taken, (takes.Children, takes.Cases)):
                yield word, value, at, (word,)

    def type_of(self, at: YamlNode) -> tuple[YamlScalar, YamlNode] | None:
        """Return the entry with a node's type; None when it has none."""
        if not isinstance(at, YamlMapping):
            return None
        candidates = [entry for name, entry in at.entries.items() if name not in self._words]
        known = [
            entry
            for entry in candidates
            if entry[0].text in self.types or entry[0].text[:1].isupper()
        ]
        return next(iter(known or candidates), None)

    def kind_of(self, word: str) -> NodeType:
        """Return the node type that a word stands for."""
        return self.types.get(word) or (SKILL if word[:1].isupper() else SUBTREE)

    # ------------------------------------------------------------------------------------------------- places

    def start(self, at: YamlNode) -> int:
        """Return the offset at which a value begins."""
        return self.starts[at.line - 1] + at.column - 1

    def end(self, at: YamlNode) -> int:
        """Return the offset behind the last character of a value, without comments and blank lines behind it."""
        beyond = at.end_line > len(self.starts)  # the last line has no line break
        marked = len(self.text) if beyond else self.starts[at.end_line - 1] + at.end_column - 1
        if isinstance(at, YamlScalar):
            first = self.text[self.start(at) : self.start(at) + 1]
            if at.plain or first not in ("|", ">"):
                return marked
            marked = marked if at.end_column > 1 or beyond else self.line_end(at.end_line - 2)
            header = self.text[self.start(at) : self.line_end(at.line - 1)].partition("#")[0]
            return marked if "+" in header else len(self.text[:marked].rstrip())
        if self.is_flow(at):
            return marked
        items = values_in(at)
        return max((self.end(item) for item in items[-2:]), default=marked)

    def is_flow(self, at: YamlNode) -> bool:
        """Return True if a list or a mapping stands in brackets or braces."""
        return not isinstance(at, YamlScalar) and self.text[
            self.start(at) : self.start(at) + 1
        ] in ("[", "{")

    def stands_in_flow(self, node: WrittenNode) -> bool:
        """Return True if brackets or braces stand around a node, its own apart."""
        return self.is_flow(node.holder) or id(node.holder) in self.pairs

    def row(self, offset: int) -> int:
        """Return the line of an offset, from 0."""
        return bisect_right(self.starts, offset) - 1

    def line_end(self, row: int) -> int:
        """Return the offset of the end of a line, before its line break."""
        if row + 1 >= len(self.starts):
            return len(self.text)
        line = self.text[self.starts[row] : self.starts[row + 1]]
        return self.starts[row] + len(_BREAK.sub("", line))

    def line(self, row: int) -> str:
        """Return a line without its line break; rows count from 0."""
        return self.text[self.starts[row] : self.line_end(row)]

    def raw(self, at: YamlNode) -> str:
        """Return a value as it is written."""
        return self.text[self.start(at) : self.end(at)]

    def is_comment(self, row: int) -> bool:
        """Return True if a line holds a comment only."""
        return row + 1 in self.source.comment_lines

    def comment_start(self, row: int) -> int:
        """Return the offset of the # of a line's comment; the line has one."""
        line = self.line(row)
        comment = self.source.comments[row + 1]
        marks = (found.start() for found in re.finditer("#", line))
        return self.starts[row] + next(at for at in marks if line[at + 1 :].strip() == comment)

    def indent(self, row: int) -> int:
        """Return the number of blanks before the first character of a line."""
        line = self.line(row)
        return len(line) - len(line.lstrip(" "))
