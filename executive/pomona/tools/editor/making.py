"""Kinds of edits: each changes the text and, apart from that, the content as which the new text must read."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from pomona.executive.language.literals import type_word
from pomona.executive.language.model import TreeFile
from pomona.executive.language.read_node import NodeReader
from pomona.executive.nodes import takes
from pomona.executive.nodes.node_type import Modifier
from pomona.executive.values.findings import Findings
from pomona.executive.values.yaml_nodes import YamlList, YamlMapping, YamlScalar
from pomona.tools.editor.format import STEP
from pomona.tools.editor.meaning import TreeContent, content_of
from pomona.tools.editor.moving import (
    NodePlaceToFill,
    brought,
    carried,
    place_to_fill,
    put,
    quoted,
    take_out,
)
from pomona.tools.editor.patching import TextPatch, read_snippet
from pomona.tools.editor.wrapping import (
    TRUE,
    default_value,
    duplicate,
    inner_word,
    new_names,
    unwrap,
    wrap,
)
from pomona.tools.editor.written_tree import EditError, WrittenNode, WrittenTree, YamlPath


@dataclass(frozen=True, slots=True)
class TreeEdit:
    """One edit; which fields it has depends on `do`."""

    do: str
    node: str = ""  # an address; of `insert` the YAML of a node
    into: str = ""
    index: int = 0
    slot: str = ""
    word: str = ""  # `in` of wrap, the port, the modifier
    name: str = ""
    value: str | None = None  # YAML
    text: str = ""
    start: int = 0
    end: int = 0


@dataclass(frozen=True, slots=True, eq=False)
class EditedTree:
    """One text while it is edited: changes of the text and, beside them, of the content.

    Each kind of edit is a method of its name.
    """

    tree: WrittenTree
    patch: TextPatch
    meant: TreeContent

    def insert(self, edit: TreeEdit) -> None:
        """Insert a node that is given as YAML. Raises EditError: it is no node, or may not be there."""
        snippet = read_snippet(edit.node, "the node", self.tree)
        if not isinstance(snippet.at, YamlMapping):
            raise EditError("a node is a mapping, such as 'Detect: {fruit: apple}'", edit.into)
        place = place_to_fill(self.tree, edit.into, edit.index, edit.slot)
        put(self.patch, place, brought(snippet))
        self.enter(place, content_of(snippet.at))

    def move(self, edit: TreeEdit) -> None:
        """Move a node. Raises EditError: it may not be there."""
        node = self.tree.node(edit.node)
        if edit.into == node.id or edit.into.startswith(f"{node.id}/"):
            raise EditError("a node cannot move into itself", node.id)
        if edit.into == node.parent and node.slot and node.index >= 0 and not edit.slot:
            return  # `then` has no other place in its parent
        place = place_to_fill(self.tree, edit.into, edit.index, edit.slot)
        items = place.items
        if items is not None and node.holder is items:
            if place.index == node.path[-1]:
                return
            if edit.index >= len(items.items):
                message = f"it has {len(items.items)} children; {edit.index} is no place among them"
                raise EditError(message, edit.into)
        put(self.patch, place, carried(self.patch, node), node)
        take_out(self.patch, node)
        self.patch.dropped.clear()  # the comments go with the node
        self.enter(place, self.meant.get(node.path), node)

    def enter(
        self, place: NodePlaceToFill, content: Any, leaving: WrittenNode | None = None
    ) -> None:
        """Make an insertion in the content; the leaving node is taken out."""
        meant = self.meant
        parent = place.parent
        path: YamlPath = ("subtrees", parent[:-1]) if parent else ()
        if parent in self.tree.nodes:
            path = self.tree.nodes[parent].path
        holder: Any
        if place.index is not None:
            holder = meant.filled((*path, place.word), [])
        elif place.cases:
            holder = meant.filled((*path, place.cases), {})
        else:
            holder = meant.get(path)
        if leaving is not None:
            meant.take(leaving.path)
        if place.index is not None:
            holder.insert(place.index, content)
        else:
            holder[place.word] = content

    def wrap(self, edit: TreeEdit) -> None:
        """Put a node into a word. Raises EditError: the word takes no children."""
        node = self.tree.node(edit.node)
        kind = self.tree.types.get(edit.word)
        word = edit.word
        wrap(self.patch, node, word, edit.value)
        assert kind is not None
        content = self.meant.get(node.path)
        if isinstance(kind, Modifier):
            value = self.content(edit.value or default_value(kind))
            if word not in content:
                content[word] = value
                return
            self.meant.set(node.path, {"sequence": [content], word: value})
        elif isinstance(kind.value, takes.Children):
            self.meant.set(node.path, {word: [content]})
        else:
            condition = self.content(edit.value or TRUE)
            self.meant.set(node.path, {word: condition, inner_word(kind): content})

    def unwrap(self, edit: TreeEdit) -> None:
        """Put a node's only child in its place. Raises EditError: it has none, or more."""
        node = self.tree.node(edit.node)
        unwrap(self.patch, node)
        children = self.meant.get(node.path)[node.type_key.text]
        if isinstance(node.holder, YamlList):
            index = int(node.path[-1])
            self.meant.get(node.path[:-1])[index : index + 1] = children
        else:
            self.meant.set(node.path, children[0])

    def delete(self, edit: TreeEdit) -> None:
        """Take a node out. Raises EditError: its place may not be empty."""
        node = self.tree.node(edit.node)
        take_out(self.patch, node)
        self.meant.take(node.path)

    def duplicate(self, edit: TreeEdit) -> None:
        """Put a copy behind a node. Raises EditError: it may not be there."""
        node = self.tree.node(edit.node)
        duplicate(self.patch, node)
        copy = content_of(node.at)
        for address, (scalar, name) in new_names(self.tree, node).items():
            found = copy
            path = self.tree.node(address).path[len(node.path) :]
            for step in path:
                found = found[step]
            found["name"] = (name, scalar.plain and quoted(name) == name)
        self.meant.get(node.path[:-1]).insert(int(node.path[-1]) + 1, copy)

    def rename(self, edit: TreeEdit) -> None:
        """Give a node, a subtree or the tree a name. Raises EditError: this is no name."""
        node = self.tree.node(edit.node)
        name = quoted(edit.name.strip())
        findings = Findings()
        if edit.name.strip():
            reader = NodeReader(findings, TreeFile(self.tree.source), self.tree.types)
            if reader.name(read_snippet(name, "the name", self.tree).at) is None:
                raise EditError(
                    f"{findings.sorted()[0].message}: {findings.sorted()[0].hint}", node.id
                )
        self.set_entry(node, "name", name if edit.name.strip() else None)

    def set_modifier(self, edit: TreeEdit) -> None:
        """Set or remove a modifier. Raises EditError: it is none, or has no such value."""
        node = self.tree.node(edit.node)
        word = edit.word
        own = node.kind.fields if node.mapping and node.kind is not None else {}
        if word not in ("name", "description", *self.tree.types.beside, *own):
            raise EditError(f"'{word}' is no modifier of {node.type_key.text}", node.id)
        self.set_entry(node, word, edit.value)

    def set_entry(self, node: WrittenNode, word: str, value: str | None) -> None:
        """Give a key beside a node's type a value, or take it away."""
        at = node.mapping
        if value is None:
            if word in at.entries:
                self.patch.remove_entry(at, word)
                self.meant.take((*node.path, word))
            return
        snippet = read_snippet(value, f"the value of '{word}'", self.tree)
        self.patch.set_entry(at, word, snippet)
        self.meant.set((*node.path, word), content_of(snippet.at))

    def set_port(self, edit: TreeEdit) -> None:
        """Set or remove a port. Raises EditError: it has no such value."""
        node = self.tree.node(edit.node)
        port = edit.word
        at = node.mapping
        key = node.type_key
        value = node.value
        kind = node.kind
        assert kind is not None
        if not kind.value.wires:
            if port != key.text or kind.value.nodes or edit.value is None:
                raise EditError(
                    f"{key.text} has no ports; its value is set as the port '{key.text}'", node.id
                )
            self.set_entry(node, port, edit.value)
            return
        wires = value if isinstance(value, YamlMapping) else None
        if (
            value is not None
            and wires is None
            and not (isinstance(value, YamlScalar) and value.is_null)
        ):
            raise EditError(f"the value of {key.text} holds no ports; edit it as text", node.id)
        if edit.value is None:
            if wires is not None and port in wires.entries:
                self.without_port(at, key, wires, port)
                self.meant.take((*node.path, key.text, port))
            return
        snippet = read_snippet(edit.value, f"the value of '{port}'", self.tree)
        if wires is None:
            first = read_snippet(
                f"{{{quoted(port)}: {snippet.flow()}}}", f"the value of '{port}'", self.tree
            )
            self.patch.set_entry(at, key.text, first)
        else:
            self.patch.set_entry(wires, port, snippet)
        self.meant.filled((*node.path, key.text), {})[port] = content_of(snippet.at)

    def without_port(self, at: YamlMapping, key: YamlScalar, wires: YamlMapping, port: str) -> None:
        """Take a port away; the last one leaves `{}`."""
        if len(wires.entries) > 1 or self.tree.is_flow(wires):
            self.patch.remove_entry(wires, port)
        else:
            self.patch.set_value(at, key, wires, read_snippet("{}", "no ports", self.tree))

    def comment(self, edit: TreeEdit) -> None:
        """Comment a node, on its line where it has a comment there and needs one line, else above it."""
        node = self.tree.node(edit.node)
        patch = self.patch
        tree = self.tree
        lines = [line.strip() for line in edit.text.splitlines() if line.strip()]
        row = self.commented_row(node)
        first = row
        while first > 0 and tree.is_comment(first - 1):
            first -= 1
        beside = row + 1 in tree.source.comments
        patch.drop_comments(first, row)
        if beside and (first < row or len(lines) != 1):
            end = tree.comment_start(row)
            patch.replace(
                tree.starts[row] + len(tree.line(row)[: end - tree.starts[row]].rstrip()),
                tree.line_end(row),
                "",
            )
        elif beside:
            patch.replace(tree.comment_start(row), tree.line_end(row), f"# {lines[0]}")
            return
        if first < row:
            patch.delete_lines(first, row - 1)
        patch.insert_lines(row, [f"{' ' * tree.indent(row)}# {line}" for line in lines])

    def commented_row(self, node: WrittenNode) -> int:
        """Return the line on which, or above which, the comment of a node stands."""
        row = node.at.line - 1
        comments = self.tree.source.comments
        if (
            row + 1 in comments
            or self.tree.is_comment(row - 1)
            or not isinstance(node.holder, YamlMapping)
        ):
            return row
        key = node.holder.entries[str(node.path[-1])][0]
        kind = self.tree.node(node.parent).kind if node.parent else None
        is_case = kind is not None and isinstance(kind.fields.get(str(node.path[-2])), takes.Cases)
        return key.line - 1 if (node.index < 0 or is_case) and key.line in comments else row

    def set_parameter(self, edit: TreeEdit) -> None:
        """Set or declare a parameter. Raises EditError: its type is missing."""
        top = self.tree.top
        name = edit.name
        assert top is not None
        written = top.get("parameters")
        declared = written if isinstance(written, YamlMapping) else None
        if edit.value is None:
            if declared is not None and name in declared.entries:
                last = len(declared.entries) == 1
                self.patch.remove_entry(*((top, "parameters") if last else (declared, name)))
                self.meant.take(("parameters",) if last else ("parameters", name))
            return
        value = read_snippet(edit.value, "the value", self.tree)
        old = None if declared is None else declared.get(name)
        if isinstance(value.at, YamlMapping) and "type" in value.at.entries:
            new = value
        elif isinstance(old, YamlMapping):
            self.patch.set_entry(old, "default", value)
            self.meant.set(("parameters", name, "default"), content_of(value.at))
            return
        else:
            kind = old.text if isinstance(old, YamlScalar) else type_word(value.at)
            if not kind:
                raise EditError(f"write the type of '{name}': {{type: …, default: …}}")
            new = read_snippet(f"{{type: {kind}, default: {value.flow()}}}", "the value", self.tree)
        if declared is not None:
            self.patch.set_entry(declared, name, new)
        else:
            self.first_parameter(top, f"{quoted(name)}: {new.flow()}")
        self.meant.filled(("parameters",), {})[name] = content_of(new.at)

    def first_parameter(self, top: YamlMapping, line: str) -> None:
        """Declare a parameter in a file without any. Raises EditError: the file stands in braces."""
        if "parameters" in top.entries:
            self.patch.set_value(
                top, *top.entries["parameters"], read_snippet(line, "the parameter", self.tree)
            )
            return
        lines = ["parameters:", f"{' ' * STEP}{line}", ""]
        follower = next(
            (top.entries[word] for word in ("root", "subtrees") if word in top.entries), None
        )
        if self.tree.is_flow(top):
            raise EditError("the file stands in braces; edit it as text")
        if follower is None:
            self.patch.add_entry(top, lines[:2])
        else:
            self.patch.insert_lines(self.patch.entry_rows(*follower)[0], lines)

    def content(self, value: str) -> Any:
        """Return the content of a value that is given as YAML. Raises EditError: it is none."""
        return content_of(read_snippet(value, "the value", self.tree).at)
