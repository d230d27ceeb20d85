"""Nodes put in, taken out, wrapped, unwrapped and doubled, as changes of the text."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

from pomona.executive.nodes import takes
from pomona.executive.values.yaml_nodes import YamlList, YamlMapping, YamlNode, YamlScalar
from pomona.tools.editor.format import STEP
from pomona.tools.editor.patching import (
    LiftedNode,
    Snippet,
    TextPatch,
    in_braces,
    indented,
    lift,
    read_snippet,
)
from pomona.tools.editor.written_tree import EditError, WrittenNode, WrittenTree


@dataclass(frozen=True, slots=True)
class CarriedNode:
    """A node on its way into a place."""

    lifted: LiftedNode
    flow: Callable[[], str]  # on one line in braces; raises EditError


@dataclass(frozen=True, slots=True, eq=False)
class NodePlaceToFill:
    """A place for a node: an index of a list, or a word beside other words."""

    parent: str  # address of the node around it; of a root the prefix of its tree
    at: YamlMapping  # the mapping that holds the list or gets the word
    word: str  # before the list, or before the node
    index: int | None  # in the list; None without one
    cases: str = ""  # the word whose mapping of cases gets the word

    @property
    def items(self) -> YamlList | None:
        """The list, when it is written as one."""
        found = self.at.get(self.word)
        return found if isinstance(found, YamlList) else None


def place_to_fill(tree: WrittenTree, into: str, index: int, slot: str) -> NodePlaceToFill:
    """Return the place that an edit names. Raises EditError: no node can stand there."""
    if into == "" or into.endswith(":"):
        at = tree.subtrees().get(into[:-1]) if into else tree.top
        if at is None or f"{into}root" in tree.nodes:
            raise EditError(
                "there is a root already"
                if at is not None
                else f"there is no subtree '{into[:-1]}'",
                into,
            )
        return NodePlaceToFill(into, at, "root", None)
    node = tree.node(into)
    at = node.mapping
    kind = node.kind
    assert kind is not None
    word = node.type_key.text if kind.value.nodes else ""
    if isinstance(kind.value, takes.Children) and slot in ("", word):
        items = at.get(word)
        count = len(items.items) if isinstance(items, YamlList) else 0
        if not 0 <= index <= count:
            raise EditError(f"it has {count} children; {index} is no place among them", into)
        return NodePlaceToFill(into, at, word, index)
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
        return NodePlaceToFill(into, at, slot, None)
    if slot and cases:
        found = at.get(cases)
        if isinstance(found, YamlMapping) and slot in found.entries:
            raise EditError(f"the case '{slot}' holds a node already", into)
        return NodePlaceToFill(into, at, slot, None, cases)
    raise EditError(_no_place(node, cases, slot), into)


def _no_place(node: WrittenNode, cases: str, slot: str) -> str:
    label = node.type_key.text
    if slot:
        return f"{label} has no '{slot}' for a node"
    return (
        f"name the case, since '{cases}' holds nodes by word"
        if cases
        else f"{label} has no place for another node"
    )


def carried(patch: TextPatch, node: WrittenNode) -> CarriedNode:
    """Return a node of the tree, to be put elsewhere."""

    def flow() -> str:
        if lifted.comments or any(row in patch.tree.source.comments for row in rows):
            raise EditError("it has comments, for which braces on one line have no place", node.id)
        return braced(in_braces(patch.tree, node.at))

    lifted = lift(patch, node)
    rows = range(node.at.line, patch.tree.row(patch.tree.end(node.at)) + 2)
    rows = rows if not patch.tree.stands_in_flow(node) else range(0)
    return CarriedNode(lifted, flow)


def brought(snippet: Snippet) -> CarriedNode:
    """Return a node that comes from outside."""
    return CarriedNode(snippet.lifted(), lambda: braced(snippet.flow()))


def braced(text: str) -> str:
    """Return a node in braces."""
    return text if text.startswith("{") else f"{{{text}}}"


# ----------------------------------------------------------------------------------------------------- put in


def put(
    patch: TextPatch, place: NodePlaceToFill, node: CarriedNode, leaving: WrittenNode | None = None
) -> None:
    """Put a node into a place; `leaving` is the one that is taken out of the same text."""
    if place.index is None:
        _put_below_word(patch, place, node)
        return
    tree = patch.tree
    items = place.items
    if items is None or not items.items:
        _put_first(patch, place, node)
        return
    gone = next(
        (n for n, item in enumerate(items.items) if leaving is not None and item is leaving.at),
        None,
    )
    index = place.index + (gone is not None and place.index >= gone)
    if tree.is_flow(items):
        if index < len(items.items):
            at = tree.start(items.items[index])
            patch.replace(at, at, f"{node.flow()}, ")
        else:
            patch.add_in_flow(items, node.flow())
        return
    lines = node.lifted.indented(items.column + 1, "- ")
    if index < len(items.items):
        patch.insert_lines(patch.item_rows(items, index)[0], lines)
    else:
        patch.insert_lines(patch.item_rows(items, index - 1)[2] + 1, lines)


def _put_first(patch: TextPatch, place: NodePlaceToFill, node: CarriedNode) -> None:
    """Put the first node into a list that is empty or not written."""
    tree = patch.tree
    entry = place.at.entries.get(place.word)
    assert entry is not None
    key, value = entry
    if not (isinstance(value, YamlList) or (isinstance(value, YamlScalar) and value.is_null)):
        raise EditError(f"'{place.word}' holds no list; edit it as text", place.parent)
    if tree.is_flow(place.at) or id(place.at) in tree.pairs:
        patch.set_value(place.at, key, value, read_snippet(f"[{node.flow()}]", "the node", tree))
        return
    colon = patch.after_colon(key)
    if colon is None or tree.row(tree.end(value)) != key.line - 1:
        raise EditError(
            f"'{place.word}' holds an empty list on several lines; edit it as text", place.parent
        )
    patch.replace(colon, tree.end(value), "")
    patch.insert_lines(key.line, node.lifted.indented(key.column - 1 + 2 * STEP, "- "))


def _put_below_word(patch: TextPatch, place: NodePlaceToFill, node: CarriedNode) -> None:
    """Put a node below a word: `then`, `on_failure`, a case, `root`."""
    tree = patch.tree
    at = place.at
    word = quoted(place.word)
    if place.cases:
        found = at.get(place.cases)
        if not isinstance(found, YamlMapping) or not found.entries:
            if tree.is_flow(at):
                patch.set_entry(
                    at, place.cases, read_snippet(f"{{{word}: {node.flow()}}}", "the node", tree)
                )
            elif found is None:
                lines = [f"{place.cases}:", f"{' ' * STEP}{word}:", *node.lifted.indented(2 * STEP)]
                patch.add_entry(at, lines)
            else:
                key = at.entries[place.cases][0]
                text = "\n".join([f"{word}:", *node.lifted.indented(STEP)])
                patch.set_value(at, key, found, read_snippet(text, "the node", tree))
            return
        at = found
    if (
        tree.is_flow(at) and not at.entries and place.parent.endswith(":")
    ):  # a subtree without anything
        key = _subtree_key(tree, place.parent[:-1])
        patch.replace(patch.after_colon(key) or tree.end(key), tree.end(at), "")
        lines = [" " * STEP + f"{word}:", *node.lifted.indented(2 * STEP)]
        patch.insert_lines(key.line, indented(lines, key.column - 1))
        return
    if tree.is_flow(at):
        patch.add_in_flow(at, f"{word}: {node.flow()}")
        return
    if place.word in at.entries:  # `root:` without a node
        key = at.entries[place.word][0]
        patch.insert_lines(key.line, node.lifted.indented(key.column - 1 + STEP))
        return
    lines = [f"{word}:", *node.lifted.indented(STEP)]
    below = at.entries.get("subtrees") if at is tree.top else None
    if below is None:
        patch.add_entry(at, lines)
    else:
        lines = [*indented(lines, at.column - 1), ""]
        patch.insert_lines(patch.entry_rows(*below)[0], lines)


def _subtree_key(tree: WrittenTree, name: str) -> YamlScalar:
    found = tree.top.get("subtrees") if tree.top is not None else None
    assert isinstance(found, YamlMapping)
    return found.entries[name][0]


_PLAIN = re.compile(r"[A-Za-z_µ°/(][^:#,\[\]{}\"'\n\t]*")


def quoted(text: str) -> str:
    """Return a text as YAML, in quotes when it needs them."""
    plain = _PLAIN.fullmatch(text) and text == text.strip() and text not in ("null", "~")
    if plain:
        return text
    escaped = (
        text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n").replace("\t", "\\t")
    )
    return f'"{escaped}"'


# ----------------------------------------------------------------------------------------------------- take out


def take_out(patch: TextPatch, node: WrittenNode) -> None:
    """Take a node out, with its comments; a list without other nodes becomes `[]`.

    Raises EditError: its place may not be empty."""
    tree = patch.tree
    holder = node.holder
    if isinstance(holder, YamlMapping):
        word = str(node.path[-1])
        if node.parent and tree.node(node.parent).type_key.text == word:
            raise EditError("the condition belongs to its node; give it another one", node.id)
        if len(holder.entries) == 1:
            _empty(patch, holder, *holder.entries[word])
        else:
            patch.remove_entry(holder, word)
        return
    index = holder.items.index(node.at)
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
