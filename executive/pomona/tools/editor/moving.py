"""Nodes put in, taken out and carried, as changes of the text."""

from __future__ import annotations

import re
from dataclasses import dataclass

from pomona.executive.nodes import takes
from pomona.executive.values.yaml_nodes import YamlList, YamlMapping, YamlNode, YamlScalar
from pomona.tools.editor.meaning import content_of
from pomona.tools.editor.patching import TextPatch
from pomona.tools.editor.snippets import Snippet, braced, quoted, snippet_of
from pomona.tools.editor.written_tree import EditError, WrittenNode, WrittenTree


@dataclass(frozen=True, slots=True, eq=False)
class NodePlaceToFill:
    """A place for a node: an index of a list that has items, or a word of a mapping."""

    at: YamlMapping | YamlList
    word: str = ""
    index: int = 0
    lead: str = ""  # before the node in the new value of the word: the dash of a list, a word


def place_to_fill(tree: WrittenTree, into: str, index: int, slot: str) -> NodePlaceToFill:
    """Return the place that an edit names. Raises EditError: no node can stand there."""
    if into == "" or into.endswith(":"):
        return _root(tree, into)
    node = tree.node(into)
    at = node.mapping
    kind = node.kind
    assert kind is not None
    word = node.type_key.text if kind.value.nodes else ""
    if isinstance(kind.value, takes.Children) and slot in ("", word):
        return _of_list(node, at, index)
    beside = {
        **kind.fields,
        **{w: f for m in tree.types.modifiers if m.key in at.entries for w, f in m.fields.items()},
    }
    single = [
        w
        for w, taken in beside.items()
        if taken.nodes and not isinstance(taken, (takes.Cases, takes.Children))
    ]
    cases = next((w for w, taken in beside.items() if isinstance(taken, takes.Cases)), "")
    free = [w for w in single if w not in at.entries]
    if slot in single or (not slot and free and kind.role == "composite"):
        slot = slot or free[0]
        if slot not in free:
            raise EditError(f"'{slot}' holds a node already", into)
        return NodePlaceToFill(at, slot)
    if slot and cases:
        found = at.get(cases)
        if not isinstance(found, YamlMapping) or not found.entries:
            return NodePlaceToFill(at, cases, lead=f"{quoted(slot)}:")
        if slot in found.entries:
            raise EditError(f"the case '{slot}' holds a node already", into)
        return NodePlaceToFill(found, slot)
    raise EditError(_no_place(node, cases, slot), into)


def _root(tree: WrittenTree, into: str) -> NodePlaceToFill:
    """Return the place of the root of the file, or of one of its subtrees."""
    at = tree.subtrees().get(into[:-1]) if into else tree.top
    if at is None:
        raise EditError(f"there is no subtree '{into[:-1]}'", into)
    if f"{into}root" in tree.nodes:
        raise EditError("there is a root already", into)
    if into and tree.is_flow(at) and not at.entries:
        assert tree.top is not None
        subtrees = tree.top.get("subtrees")
        assert isinstance(subtrees, YamlMapping)
        return NodePlaceToFill(subtrees, into[:-1], lead="root:")
    return NodePlaceToFill(at, "root")


def _of_list(node: WrittenNode, at: YamlMapping, index: int) -> NodePlaceToFill:
    """Return a place among the children of a node."""
    word = node.type_key.text
    items = at.entries[word][1]
    count = len(items.items) if isinstance(items, YamlList) else 0
    if not 0 <= index <= count:
        message = f"it has {count} children; {index} is no place among them"
        raise EditError(message, node.id)
    if isinstance(items, YamlList) and count:
        return NodePlaceToFill(items, index=index)
    if isinstance(items, YamlMapping) or (isinstance(items, YamlScalar) and not items.is_null):
        raise EditError(f"'{word}' holds no list; edit it as text", node.id)
    return NodePlaceToFill(at, word, lead="- ")


def _no_place(node: WrittenNode, cases: str, slot: str) -> str:
    label = node.type_key.text
    if slot:
        return f"{label} has no '{slot}' for a node"
    return (
        f"name the case, since '{cases}' holds nodes by word"
        if cases
        else f"{label} has no place for another node"
    )


def lift(patch: TextPatch, node: WrittenNode, *, word: bool = True) -> Snippet:
    """Return a node with its comments, as it stands; those of the word before it only where the word goes, too."""
    tree = patch.tree
    at = node.at
    column = " " * (at.column - 1)
    if tree.stands_in_flow(node) or not (word or on_its_lines(tree, node)):
        raw = tree.raw(at)
        text = raw if isinstance(at, YamlScalar) else column + braced(raw)
        return snippet_of(re.split(r"\r\n|[\n\r]", text), tree)
    first, head, last = patch.rows_of(node, word=word)
    comments = [tree.line(row).strip() for row in range(first, head)]
    behind = [row for row in range(head, at.line - 1) if row + 1 in tree.source.comments]
    comments += [tree.text[tree.comment_start(row) : tree.line_end(row)].rstrip() for row in behind]
    lines = [
        column + tree.text[tree.start(at) : tree.line_end(at.line - 1)],
        *(tree.line(row) for row in range(at.line, last + 1)),
    ]
    return snippet_of([*comments, *lines], tree)


def on_its_lines(tree: WrittenTree, node: WrittenNode) -> bool:
    """Return True if a node stands on lines of its own, in no braces and behind no key."""
    if tree.stands_in_flow(node):
        return False
    if isinstance(node.holder, YamlList):
        return True
    return node.at.line > node.holder.entries[str(node.path[-1])][0].line


def put(
    patch: TextPatch, place: NodePlaceToFill, node: Snippet, leaving: WrittenNode | None = None
) -> None:
    """Put a node into a place; `leaving` is the one that is taken out of the same text."""
    if isinstance(place.at, YamlMapping):
        patch.set_entry(place.at, place.word, node.inside(place.lead) if place.lead else node)
        return
    tree = patch.tree
    items = place.at.items
    index = place.index
    if leaving is not None and leaving.at in items[: index + 1]:
        index += 1
    patch.content[id(place.at)].insert(index, content_of(node.at))
    if tree.is_flow(place.at):
        if index < len(items):
            at = tree.start(items[index])
            patch.replace(at, at, f"{braced(node.flow())}, ")
        else:
            patch.add_in_flow(place.at, braced(node.flow()))
        return
    lines = node.indented(place.at.column + 1, "- ")
    if index < len(items):
        patch.insert_lines(patch.item_rows(place.at, index)[0], lines)
    else:
        patch.insert_lines(patch.item_rows(place.at, index - 1)[2] + 1, lines)


def put_in_place_of(patch: TextPatch, node: WrittenNode, new: Snippet) -> None:
    """Put another node in the place of a node, whose comments are in the new one."""
    tree = patch.tree
    patch.content[id(node.holder)][node.path[-1]] = content_of(new.at)
    if not on_its_lines(tree, node):
        patch.replace(tree.start(node.at), tree.end(node.at), braced(new.flow()))
        return
    first, _, last = patch.rows_of(node, word=False)
    if isinstance(node.holder, YamlList):
        patch.insert_lines(first, new.indented(node.holder.column + 1, "- "))
    else:
        patch.insert_lines(first, new.indented(node.at.column - 1))
    patch.delete_lines(first, last)


def take_out(patch: TextPatch, node: WrittenNode) -> None:
    """Take a node out, with its comments; a list without other nodes becomes `[]`.

    Raises EditError: its place may not be empty."""
    tree = patch.tree
    holder = node.holder
    beside = patch.content[id(holder)]
    if isinstance(holder, YamlMapping):
        word = str(node.path[-1])
        if node.parent and tree.node(node.parent).type_key.text == word:
            raise EditError("the condition belongs to its node; give it another one", node.id)
        if len(holder.entries) > 1:
            patch.remove_entry(holder, word)
        else:
            beside.clear()
            _empty(patch, holder, *holder.entries[word])
        return
    index = holder.items.index(node.at)
    gone = patch.content[id(node.at)]
    del beside[[part is gone for part in beside].index(True)]
    if tree.is_flow(holder):
        spans = [(tree.start(item), tree.end(item)) for item in holder.items]
        patch.remove_in_flow(holder, spans, index)
        return
    first, _, last = patch.item_rows(holder, index)
    patch.drop_comments(first, last)
    if len(holder.items) == 1:
        parent = tree.node(node.parent)
        colon = patch.after_colon(parent.type_key)
        if colon is None:
            raise EditError("its list cannot be emptied; edit it as text", node.id)
        patch.replace(colon, colon, " []")
    patch.delete_lines(first, last)


def _empty(patch: TextPatch, holder: YamlMapping, key: YamlScalar, value: YamlNode) -> None:
    """Leave `{}` of a mapping with one entry."""
    tree = patch.tree
    if tree.is_flow(holder):
        patch.replace(tree.start(holder) + 1, tree.end(holder) - 1, "")
        return
    first, row, last = patch.entry_rows(key, value)
    if tree.indent(row) != key.column - 1:
        raise EditError(f"'{key.text}' does not stand on a line of its own; edit it as text")
    patch.drop_comments(first, last)
    above = first - 1
    while above >= 0 and (tree.is_comment(above) or not tree.line(above).strip()):
        above -= 1
    end = tree.comment_start(above) if above + 1 in tree.source.comments else tree.line_end(above)
    end = tree.starts[above] + len(tree.text[tree.starts[above] : end].rstrip())
    patch.replace(end, end, " {}")
    patch.delete_lines(first, last)
