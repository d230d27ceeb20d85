"""Kinds of edits beside those that wrap: each is a change of the text by `TextPatch`."""

from __future__ import annotations

from pomona.executive.language.literals import type_word
from pomona.executive.language.model import TreeFile
from pomona.executive.language.read_node import NodeReader
from pomona.executive.nodes import takes
from pomona.executive.nodes.check import CheckType
from pomona.executive.values.findings import Findings
from pomona.executive.values.yaml_nodes import YamlList, YamlMapping, YamlScalar
from pomona.tools.editor.moving import lift, place_to_fill, put, take_out
from pomona.tools.editor.patching import TextPatch
from pomona.tools.editor.snippets import quoted, read_snippet
from pomona.tools.editor.tree_edit import TreeEdit
from pomona.tools.editor.written_tree import EditError, WrittenNode, WrittenTree


def insert(patch: TextPatch, edit: TreeEdit) -> None:
    """Insert a node that is given as YAML. Raises EditError: it is no node, or may not be there."""
    snippet = read_snippet(edit.node, "the node", patch.tree)
    if not isinstance(snippet.at, YamlMapping):
        raise EditError("a node is a mapping, such as 'Detect: {fruit: apple}'", edit.into)
    put(patch, place_to_fill(patch.tree, edit.into, edit.index, edit.slot), snippet)


def move(patch: TextPatch, edit: TreeEdit) -> None:
    """Move a node. Raises EditError: it may not be there."""
    node = patch.tree.node(edit.node)
    if edit.into == node.id or edit.into.startswith(f"{node.id}/"):
        raise EditError("a node cannot move into itself", node.id)
    if edit.into == node.parent and node.slot and node.index >= 0 and not edit.slot:
        return  # `then` has no other place in its parent
    place = place_to_fill(patch.tree, edit.into, edit.index, edit.slot)
    if place.at is node.holder and isinstance(place.at, YamlList):
        if place.index == node.path[-1]:
            return
        count = len(place.at.items)
        if place.index >= count:
            message = f"it has {count} children; {place.index} is no place among them"
            raise EditError(message, edit.into)
    put(patch, place, lift(patch, node), node)
    take_out(patch, node)
    patch.dropped.clear()  # the comments go with the node


def delete(patch: TextPatch, edit: TreeEdit) -> None:
    """Take a node out. Raises EditError: its place may not be empty."""
    take_out(patch, patch.tree.node(edit.node))


def rename(patch: TextPatch, edit: TreeEdit) -> None:
    """Give a node, a subtree or the tree a name. Raises EditError: this is no name."""
    node = patch.tree.node(edit.node)
    name = quoted(edit.name.strip()) if edit.name.strip() else None
    if name is not None:
        findings = Findings()
        reader = NodeReader(findings, TreeFile(patch.tree.source), patch.tree.types)
        if reader.name(read_snippet(name, "the name", patch.tree).at) is None:
            found = findings.sorted()[0]
            raise EditError(f"{found.message}: {found.hint}", node.id)
    set_entry(patch, node.mapping, "name", name)


def set_modifier(patch: TextPatch, edit: TreeEdit) -> None:
    """Set or remove a modifier. Raises EditError: it is none, or has no such value."""
    node = patch.tree.node(edit.node)
    word = edit.word
    own = node.kind.fields if node.mapping and node.kind is not None else {}
    if word not in ("name", "description", *patch.tree.types.beside, *own):
        raise EditError(f"'{word}' is no modifier of {node.type_key.text}", node.id)
    set_entry(patch, node.mapping, word, edit.value)


def set_entry(patch: TextPatch, at: YamlMapping, word: str, value: str | None) -> None:
    """Give a key of a mapping a value, or take it away."""
    if value is not None:
        snippet = read_snippet(value, f"the value of '{word}'", patch.tree)
        patch.set_entry(at, word, snippet)
    elif word in at.entries:
        patch.remove_entry(at, word)


def set_port(patch: TextPatch, edit: TreeEdit) -> None:
    """Set or remove a port. Raises EditError: it has no such value."""
    node = patch.tree.node(edit.node)
    port = edit.word
    is_condition = node.key is None and port == CheckType.key
    if is_condition and isinstance(node.holder, YamlMapping) and edit.value is not None:
        set_entry(patch, node.holder, str(node.path[-1]), edit.value)  # a condition
        return
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
        set_entry(patch, at, port, edit.value)
    elif isinstance(value, YamlMapping):
        is_last = len(value.entries) == 1 and port in value.entries
        if edit.value is None and is_last and not patch.tree.is_flow(value):
            set_entry(patch, at, key.text, "{}")
        else:
            set_entry(patch, value, port, edit.value)
    elif not (isinstance(value, YamlScalar) and value.is_null):
        raise EditError(f"the value of {key.text} holds no ports; edit it as text", node.id)
    elif edit.value is not None:
        snippet = read_snippet(edit.value, f"the value of '{port}'", patch.tree)
        set_entry(patch, at, key.text, f"{{{quoted(port)}: {snippet.flow()}}}")


def comment(patch: TextPatch, edit: TreeEdit) -> None:
    """Comment a node, on its line where it has a comment there and needs one line, else above it."""
    node = patch.tree.node(edit.node)
    tree = patch.tree
    lines = [line.strip() for line in edit.text.splitlines() if line.strip()]
    row = commented_row(tree, node)
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


def commented_row(tree: WrittenTree, node: WrittenNode) -> int:
    """Return the line on which, or above which, the comment of a node stands."""
    row = node.at.line - 1
    comments = tree.source.comments
    if row + 1 in comments or tree.is_comment(row - 1) or not isinstance(node.holder, YamlMapping):
        return row
    key = node.holder.entries[str(node.path[-1])][0]
    kind = tree.node(node.parent).kind if node.parent else None
    is_case = kind is not None and isinstance(kind.fields.get(str(node.path[-2])), takes.Cases)
    return key.line - 1 if (node.index < 0 or is_case) and key.line in comments else row


def set_parameter(patch: TextPatch, edit: TreeEdit) -> None:
    """Set or declare a parameter. Raises EditError: its type is missing."""
    top = patch.tree.top
    name = edit.name
    assert top is not None
    written = top.get("parameters")
    declared = written if isinstance(written, YamlMapping) else None
    old = None if declared is None else declared.get(name)
    if edit.value is None:
        if declared is not None and old is not None:
            last = len(declared.entries) == 1
            patch.remove_entry(*((top, "parameters") if last else (declared, name)))
        return
    value = read_snippet(edit.value, "the value", patch.tree)
    if not isinstance(value.at, YamlMapping) or "type" not in value.at.entries:
        if isinstance(old, YamlMapping):
            patch.set_entry(old, "default", value)
            return
        kind = old.text if isinstance(old, YamlScalar) else type_word(value.at)
        if not kind:
            raise EditError(f"write the type of '{name}': {{type: …, default: …}}")
        text = f"{{type: {kind}, default: {value.flow()}}}"
        value = read_snippet(text, "the value", patch.tree)
    if declared is not None:
        patch.set_entry(declared, name, value)
    else:
        line = f"{quoted(name)}: {value.flow()}"
        set_entry(patch, top, "parameters", line)
