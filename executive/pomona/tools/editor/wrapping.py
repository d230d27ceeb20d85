"""Nodes wrapped, unwrapped and doubled, as changes of the text."""

from __future__ import annotations

import re

from pomona.executive.nodes import takes
from pomona.executive.nodes.node_type import Modifier, NodeType
from pomona.executive.ports import RATE, RATIO, TIME
from pomona.executive.values.yaml_nodes import YamlList, YamlMapping, YamlScalar
from pomona.tools.editor.format import STEP
from pomona.tools.editor.moving import braced, quoted
from pomona.tools.editor.patching import LiftedNode, TextPatch, lift, read_snippet, shifted
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


def rewrite(patch: TextPatch, node: WrittenNode, new: LiftedNode) -> None:
    """Put other lines in the place of a node that stands on lines of its own; its comments are in the new ones."""
    at = node.at
    first, _, last = patch.rows_of(node)
    if isinstance(node.holder, YamlList):
        lines = new.indented(node.holder.column + 1, "- ")
    else:
        first = patch.leading(at.line - 1, at.column - 1)
        lines = new.indented(at.column - 1)
    patch.insert_lines(first, lines)
    patch.delete_lines(first, last)


def on_its_lines(tree: WrittenTree, node: WrittenNode) -> bool:
    """Return True if a node stands on lines of its own, in no braces and behind no key."""
    if tree.stands_in_flow(node):
        return False
    if isinstance(node.holder, YamlList):
        return True
    return node.at.line > node.holder.entries[str(node.path[-1])][0].line


def wrap(patch: TextPatch, node: WrittenNode, word: str, value: str | None) -> None:
    """Put a node into a new one, or give it a modifier. Raises EditError: the word takes no node."""
    tree = patch.tree
    at = node.mapping
    kind = tree.types.get(word)
    if kind is None or kind.role == "leaf":
        raise EditError(f"'{word}' is no word that takes a node", node.id)
    if isinstance(kind, Modifier) and word not in at.entries:
        patch.set_entry(
            at, word, read_snippet(value or default_value(kind), f"the value of '{word}'", tree)
        )
        return
    outer, beside = (
        ("sequence", f"{word}: {value or default_value(kind)}")
        if isinstance(kind, Modifier)
        else (word, "")
    )
    before, lead = _opening(tree, outer, value, node.id)
    if not on_its_lines(tree, node):
        opened, closed = ("[", "]") if lead else ("", "")
        inner = tree.raw(at) if lead else braced(tree.raw(at))
        text = f"{', '.join([*before[:-1], f'{before[-1]} {opened}{inner}{closed}', *filter(None, [beside])])}"
        patch.replace(tree.start(at), tree.end(at), f"{{{text}}}")
        return
    lifted = _with_comments(patch, node)
    lines = [*before, *lifted.indented(STEP + len(lead), lead), *filter(None, [beside])]
    rewrite(patch, node, LiftedNode((), tuple(lines), 0))


def _opening(tree: WrittenTree, word: str, value: str | None, node: str) -> tuple[list[str], str]:
    """Return the lines before a node that is wrapped in a word, and the characters directly before it."""
    kind = tree.types[word]
    if isinstance(kind.value, takes.Children):
        return [f"{word}:"], "- "
    inner = inner_word(kind)
    if not inner:
        raise EditError(
            f"'{word}' takes its nodes by word; insert it and move the node into it", node
        )
    return [f"{word}: {value or TRUE}", f"{inner}:"], ""


def inner_word(kind: NodeType) -> str:
    """Return the word before the one node that a word needs beside it, `then`; empty when it needs none."""
    for word, taken in kind.fields.items():
        if isinstance(taken, takes.Child) and taken.required:
            return word
    return ""


def default_value(kind: NodeType) -> str:
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


def _with_comments(patch: TextPatch, node: WrittenNode) -> LiftedNode:
    """Return a node on lines of its own with the comments that stand directly above it."""
    if isinstance(node.holder, YamlList):
        return lift(patch, node)
    tree = patch.tree
    at = node.at
    first = patch.leading(at.line - 1, at.column - 1)
    last = patch.rows_of(node)[2]
    comments = tuple(tree.line(row).strip() for row in range(first, at.line - 1))
    lines = [
        tree.line(at.line - 1)[at.column - 1 :],
        *(tree.line(row) for row in range(at.line, last + 1)),
    ]
    return LiftedNode(comments, tuple(lines), at.column - 1)


def unwrap(patch: TextPatch, node: WrittenNode) -> None:
    """Put the children of a node in its place. Raises EditError: they do not fit there."""
    tree = patch.tree
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


def duplicate(patch: TextPatch, node: WrittenNode) -> None:
    """Put a copy of a node behind it, with names of its own.

    Raises EditError: it may not be there.
    """
    tree = patch.tree
    at = node.mapping
    if not isinstance(node.holder, YamlList):
        raise EditError("only one node has its place here", node.id)
    names = new_names(tree, node)
    if tree.is_flow(node.holder):
        start = tree.start(at)
        end = tree.end(at)
        patch.replace(end, end, ", " + _renamed(tree, names, start, end))
        return
    first, _, last = patch.rows_of(node)
    text = _renamed(tree, names, tree.starts[first], tree.line_end(last))
    patch.insert_lines(last + 1, re.split(r"\r\n|[\n\r]", text))


def new_names(tree: WrittenTree, node: WrittenNode) -> dict[str, tuple[YamlScalar, str]]:
    """Return the names below a node, each with its scalar and the name of a copy, by address."""
    prefix = node.id.partition("root")[0]
    written = {
        n.id: n.at.get("name")
        for n in tree.nodes.values()
        if n.id.startswith(f"{prefix}root") and isinstance(n.at, YamlMapping)
    }
    taken = {name.text for name in written.values() if isinstance(name, YamlScalar)}
    found: dict[str, tuple[YamlScalar, str]] = {}
    for below in tree.below(node.id):
        name = written.get(below.id)
        if not isinstance(name, YamlScalar) or name.is_null:
            continue
        number = 2
        while f"{name.text} {number}" in taken:
            number += 1
        taken.add(f"{name.text} {number}")
        found[below.id] = name, f"{name.text} {number}"
    return found


def _renamed(
    tree: WrittenTree, names: dict[str, tuple[YamlScalar, str]], start: int, end: int
) -> str:
    out = []
    at = start
    for scalar, name in sorted(names.values(), key=lambda pair: tree.start(pair[0])):
        text = quoted(name) if scalar.plain else tree.raw(scalar)[:1] + name + tree.raw(scalar)[:1]
        out += [tree.text[at : tree.start(scalar)], text]
        at = tree.end(scalar)
    return "".join([*out, tree.text[at:end]])
