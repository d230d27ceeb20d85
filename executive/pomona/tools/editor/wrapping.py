"""Nodes wrapped, unwrapped and doubled, as changes of the text."""

from __future__ import annotations

from collections.abc import Iterator

from pomona.executive.nodes import takes
from pomona.executive.nodes.node_type import Modifier, NodeType
from pomona.executive.ports import RATE, RATIO, TIME
from pomona.executive.values.yaml_nodes import YamlList, YamlMapping, YamlScalar
from pomona.tools.editor.format import STEP
from pomona.tools.editor.moving import (
    NodePlaceToFill,
    lift,
    on_its_lines,
    put,
    put_in_place_of,
)
from pomona.tools.editor.patching import TextPatch
from pomona.tools.editor.snippets import braced, quoted, read_snippet, shifted, snippet_of
from pomona.tools.editor.tree_edit import TreeEdit
from pomona.tools.editor.written_tree import EditError, WrittenNode, WrittenTree

TRUE = '"true"'
_FIRST_VALUES: dict[object, str] = {
    bool: "true",
    int: "3",
    TIME.name: "5 s",
    RATIO.name: "50 %",
    RATE.name: "1 Hz",
}
"""Values of a modifier that has just been added, by the type of its port."""


def wrap(patch: TextPatch, edit: TreeEdit) -> None:
    """Put a node into a new one, or give it a modifier. Raises EditError: the word takes no node."""
    tree = patch.tree
    node = tree.node(edit.node)
    at = node.mapping
    word = edit.word
    value = edit.value
    kind = tree.types.get(word)
    if kind is None or kind.role == "leaf":
        raise EditError(f"'{word}' is no word that takes a node", node.id)
    beside = []
    if isinstance(kind, Modifier):
        value = value or _first_value(kind)
        if word not in at.entries:
            patch.set_entry(at, word, read_snippet(value, f"the value of '{word}'", tree))
            return
        beside = [f"{word}: {value}"]
        kind = tree.types["sequence"]
    before, lead = _opening(kind, value, node)
    lines = lift(patch, node, word=False).indented(STEP + len(lead), lead)
    put_in_place_of(patch, node, snippet_of([*before, *lines, *beside], tree))


def _opening(kind: NodeType, value: str | None, node: WrittenNode) -> tuple[list[str], str]:
    """Return the lines before a node that is wrapped in a word, and the characters directly before it."""
    if isinstance(kind.value, takes.Children):
        return [f"{kind.key}:"], "- "
    for inner, taken in kind.fields.items():
        if isinstance(taken, takes.Child) and taken.required:
            return [f"{kind.key}: {value or TRUE}", f"{inner}:"], ""
    message = f"'{kind.key}' takes its nodes by word; insert it and move the node into it"
    raise EditError(message, node.id)


def _first_value(kind: NodeType) -> str:
    """Return a first value for a modifier, as YAML. Raises EditError: it has none."""
    taken = kind.value
    if isinstance(taken, takes.Condition):
        return TRUE
    port = taken.port if isinstance(taken, takes.Value) else None
    first = None if port is None else _FIRST_VALUES.get(getattr(port.type, "name", port.type))
    if first is not None:
        return first
    if port is not None and port.choices:
        return quoted(next(iter(port.choices)))
    raise EditError(f"'{kind.key}' needs a value")


def unwrap(patch: TextPatch, edit: TreeEdit) -> None:
    """Put the children of a node in its place. Raises EditError: they do not fit there."""
    tree = patch.tree
    node = tree.node(edit.node)
    at = node.mapping
    kind = node.kind
    items = node.value
    if (
        kind is None
        or not isinstance(kind.value, takes.Children)
        or not isinstance(items, YamlList)
        or not items.items
    ):
        raise EditError("only a node with a list of children can be unwrapped", node.id)
    if len(at.entries) > 1:
        others = ", ".join(word for word in at.entries if word != node.type_key.text)
        raise EditError(f"its modifiers would be lost: {others}; remove them first", node.id)
    if len(items.items) > 1 and not isinstance(node.holder, YamlList):
        raise EditError(
            "only one node has its place here, and this one has several children", node.id
        )
    children = patch.content[id(items)]
    beside = patch.content[id(node.holder)]
    step = node.path[-1]
    if isinstance(node.holder, YamlList):
        beside[int(step) : int(step) + 1] = children
    else:
        beside[step] = children[0]
    if tree.is_flow(items):
        _unwrap_flow(patch, node, items)
    elif on_its_lines(tree, node):
        _unwrap_lines(patch, node, items)
    else:
        raise EditError("this node stands in brackets on several lines; edit it as text", node.id)


def _unwrap_flow(patch: TextPatch, node: WrittenNode, items: YamlList) -> None:
    tree = patch.tree
    at = node.mapping
    if not on_its_lines(tree, node) or not isinstance(node.holder, YamlList):
        inner = tree.text[tree.start(items.items[0]) : tree.end(items.items[-1])]
        text = inner if isinstance(node.holder, YamlList) else braced(inner)
        patch.replace(tree.start(at), tree.end(at), text)
        return
    head = patch.rows_of(node)[1]
    behind = tree.text[tree.end(at) : tree.line_end(tree.row(tree.end(at)))].strip()
    if head != at.line - 1 or items.line != at.line or tree.row(tree.end(at)) != head:
        raise EditError("this node stands in brackets on several lines; edit it as text", node.id)
    column = node.holder.column - 1
    lines = [f"{' ' * column}- {tree.raw(item)}" for item in items.items]
    patch.replace(
        tree.starts[head],
        tree.line_end(head),
        tree.eol.join([*([" " * column + behind] if behind else []), *lines]),
    )


def _unwrap_lines(patch: TextPatch, node: WrittenNode, items: YamlList) -> None:
    tree = patch.tree
    at = node.mapping
    inner = items.column - 1
    _, head, last = patch.rows_of(node)
    outer = node.holder.column - 1
    if not isinstance(node.holder, YamlList):
        head = at.line - 1
        outer = at.column - 1
    dash = patch.item_rows(items, 0)[1]
    dashed = items.items[0].line - 1 == dash or isinstance(node.holder, YamlList)
    if at.line - 1 != head or dash <= head or not dashed:
        raise EditError("its dash stands on a line of its own; edit it as text", node.id)
    lines = []
    if at.line in tree.source.comments:
        lines.append(
            " " * outer + tree.text[tree.comment_start(head) : tree.line_end(head)].rstrip()
        )
    for row in range(head + 1, last + 1):
        text = tree.line(row)
        column = inner
        if not isinstance(node.holder, YamlList) and row >= dash:
            column = items.items[0].column - 1
            if row == dash:
                text = " " * column + text[column:]
        lines.append(shifted(text, outer - column))
    patch.insert_lines(head, lines)
    patch.delete_lines(head, last)


def duplicate(patch: TextPatch, edit: TreeEdit) -> None:
    """Put a copy of a node behind it, with names of its own. Raises EditError: it may not be there."""
    tree = patch.tree
    node = tree.node(edit.node)
    if not isinstance(node.holder, YamlList):
        raise EditError("only one node has its place here", node.id)
    renaming = TextPatch(tree)
    for scalar, name in _new_names(tree, node):
        mark = tree.raw(scalar)[:1]
        text = quoted(name) if scalar.plain else mark + name + mark
        renaming.replace(tree.start(scalar), tree.end(scalar), text)
    renamed = TextPatch(WrittenTree(renaming.result(), tree.types))
    copy = lift(renamed, renamed.tree.node(node.id))
    put(patch, NodePlaceToFill(node.holder, index=int(node.path[-1]) + 1), copy)


def _new_names(tree: WrittenTree, node: WrittenNode) -> Iterator[tuple[YamlScalar, str]]:
    """Yield the names below a node, each with the name of a copy."""
    prefix = node.id.partition("root")[0]
    written = {
        n.id: n.at.get("name")
        for n in tree.nodes.values()
        if n.id.startswith(f"{prefix}root") and isinstance(n.at, YamlMapping)
    }
    taken = {name.text for name in written.values() if isinstance(name, YamlScalar)}
    for below in tree.below(node.id):
        name = written.get(below.id)
        if isinstance(name, YamlScalar) and not name.is_null:
            number = 2
            while f"{name.text} {number}" in taken:
                number += 1
            taken.add(f"{name.text} {number}")
            yield name, f"{name.text} {number}"
