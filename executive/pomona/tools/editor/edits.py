"""Edits of a tree file, each a patch of its text: everything that an edit does not name stays byte for byte.

    apply(text, edit_of({"do": "wrap", "node": "root/1", "in": "fallback"}))    the new text, or EditError
    nodes(text)                                                                  what a page draws

Addresses of nodes stand in `written_tree`. Messages, as JSON:

    insert         into, index, node (YAML of one node); slot: a word that takes one node (then, on_failure, a case)
    move           node, into, index, slot: the node becomes child `index` of `into`, counted without the node itself;
                   `into` is its address before the move
    wrap           node, in (a word that takes nodes, or a modifier), value: of a modifier or a condition
    unwrap, delete, duplicate    node
    rename         node, name: empty takes the name away
    extract        node, name: the node becomes the subtree `name`, and calls it
    set_port       node, port, value: YAML or null; of a word without ports (check, wait …) the port is the word itself
    set_modifier   node, modifier (also name, description and fields such as retry_if), value: YAML or null
    comment        node, text: empty takes it away
    set_parameter  name, value: its default, or a whole declaration `{type: int, …}`; null takes it away
    replace        from, to (offsets in characters of the text, Unicode code points), text: nothing is checked

An empty `into` is the file, whose `root` is missing; `look:` is the subtree of that name.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from pomona.executive.language.model import TreeFile
from pomona.executive.language.read_node import NodeReader
from pomona.executive.nodes import takes
from pomona.executive.nodes.node_type import Modifier, TreeNode
from pomona.executive.registry import Registry
from pomona.executive.values.findings import Findings
from pomona.executive.values.yaml_nodes import YamlList, YamlMapping, YamlNode, YamlScalar
from pomona.tools.editor.meaning import TreeContent, content_of
from pomona.tools.editor.moving import (
    TRUE,
    brought,
    carried,
    default_value,
    duplicate,
    new_names,
    place_to_fill,
    put,
    quoted,
    take_out,
    unwrap,
    wrap,
)
from pomona.tools.editor.patching import TextPatch, read_snippet
from pomona.tools.editor.written_tree import BOM, EditError, WrittenNode, WrittenTree

__all__ = ["EditError", "TreeEdit", "apply", "edit_of", "nodes"]


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


_KEYS = {"in": "word", "port": "word", "modifier": "word", "from": "start", "to": "end"}
_SHAPES: dict[str, tuple[dict[str, type], dict[str, type]]] = {  # needed and further keys of each kind
    "insert": ({"into": str, "node": str}, {"index": int, "slot": str}),
    "move": ({"node": str, "into": str}, {"index": int, "slot": str}),
    "wrap": ({"node": str, "in": str}, {"value": str}),
    "unwrap": ({"node": str}, {}),
    "delete": ({"node": str}, {}),
    "duplicate": ({"node": str}, {}),
    "rename": ({"node": str, "name": str}, {}),
    "extract": ({"node": str, "name": str}, {}),
    "set_port": ({"node": str, "port": str}, {"value": str}),
    "set_modifier": ({"node": str, "modifier": str}, {"value": str}),
    "comment": ({"node": str, "text": str}, {}),
    "set_parameter": ({"name": str}, {"value": str}),
    "replace": ({"from": int, "to": int, "text": str}, {}),
}


def edit_of(message: Mapping[str, object]) -> TreeEdit:
    """Return the edit that a message describes. Raises EditError: it describes none."""
    kind = message.get("do")
    if not isinstance(kind, str) or kind not in _SHAPES:
        raise EditError(f"no edit is named {kind!r}; there are {', '.join(_SHAPES)}")
    needed, further = _SHAPES[kind]
    known = {**needed, **further}
    found: dict[str, Any] = {"do": kind}
    for key, value in message.items():
        if key == "do" or (key == "value" and value is None and "value" in further):
            continue
        if key not in known:
            raise EditError(f"'{kind}' has no '{key}'; it has {', '.join(known)}")
        if type(value) is not known[key]:
            raise EditError(f"'{key}' of '{kind}' is a {'number' if known[key] is int else 'text'}")
        found[_KEYS.get(key, key)] = value
    missing = [key for key in needed if key not in message]
    if missing:
        raise EditError(f"'{kind}' lacks {', '.join(missing)}")
    return TreeEdit(**found)


def apply(text: str, edit: TreeEdit, registry: Registry | None = None) -> str:
    """Return the text with an edit; it reads as the tree before with the edit made.

    Args:
        registry: skills for `extract`, whose wiring depends on their ports; the installed ones when left out.

    Raises EditError: the edit cannot be made, or only with a change of something else.
    """
    if edit.do == "replace":
        if not 0 <= edit.start <= edit.end <= len(text):
            raise EditError(f"there are no characters {edit.start} to {edit.end} in a text of {len(text)}")
        return text[: edit.start] + edit.text + text[edit.end :]
    mark = BOM if text.startswith(BOM) else ""
    tree = WrittenTree(text[len(mark) :])
    if tree.problems or tree.top is None:
        found = tree.problems[0] if tree.problems else None
        where = f"line {found.line}: {found.message}; correct it in the text first" if found else "the text is no tree"
        raise EditError(where)
    patch, meant = TextPatch(tree), TreeContent(tree)
    _DO[edit.do](_Edited(tree, patch, meant, registry), edit)
    result = patch.result()
    _check(tree, patch, meant, result, edit)
    return mark + result


def _check(before: WrittenTree, patch: TextPatch, meant: TreeContent, result: str, edit: TreeEdit) -> None:
    """Raise EditError when a text does not read as meant, or has lost a comment."""
    after = WrittenTree(result, before.types)
    at = edit.node if edit.do != "insert" else edit.into
    if after.problems:
        raise EditError(f"the text could not be read any more: {after.problems[0].message}; edit it as text", at)
    if content_of(after.top) != meant.top:
        raise EditError("the edit would change something else in the text; edit it as text", at)
    lost = Counter(before.source.comments.values()) - Counter(after.source.comments.values()) - Counter(patch.dropped)
    if lost:
        raise EditError(f"a comment would be lost: # {next(iter(lost))}; edit it as text", at)


# ----------------------------------------------------------------------------------------------------- kinds


@dataclass(frozen=True, slots=True, eq=False)
class _Edited:
    """One text while it is edited: changes of the text and, beside them, of the content."""

    tree: WrittenTree
    patch: TextPatch
    meant: TreeContent
    registry: Registry | None

    def insert(self, edit: TreeEdit) -> None:
        snippet = read_snippet(edit.node, "the node", self.tree)
        if not isinstance(snippet.at, YamlMapping):
            raise EditError("a node is a mapping, such as 'Detect: {fruit: apple}'", edit.into)
        put(self.patch, self.place(edit), brought(snippet))
        self.enter(edit, content_of(snippet.at))

    def move(self, edit: TreeEdit) -> None:
        node = self.tree.node(edit.node)
        if edit.into == node.id or edit.into.startswith(f"{node.id}/"):
            raise EditError("a node cannot move into itself", node.id)
        place = self.place(edit, node)
        if place is None:
            return
        if isinstance(node.holder, YamlList) and node.holder is place.items and place.index == node.path[-1]:
            return
        put(self.patch, place, carried(self.patch, node), node)
        take_out(self.patch, node)
        self.patch.dropped.clear()  # the comments go with the node
        self.enter(edit, self.meant.get(node.path), node)

    def place(self, edit: TreeEdit, leaving: WrittenNode | None = None) -> Any:
        """Return the place that an edit names; its index counts without the node that leaves."""
        if (
            leaving is not None
            and edit.into == leaving.parent
            and not edit.slot
            and leaving.slot
            and leaving.index >= 0
        ):
            return None
        place = place_to_fill(self.tree, edit.into, edit.index, edit.slot)
        items = place.items
        if leaving is not None and items is not None and leaving.holder is items and edit.index >= len(items.items):
            raise EditError(f"it has {len(items.items)} children; {edit.index} is no place among them", edit.into)
        return place

    def enter(self, edit: TreeEdit, content: Any, leaving: WrittenNode | None = None) -> None:
        """Make an insertion in the content; the leaving node is taken out."""
        meant = self.meant
        place = place_to_fill(self.tree, edit.into, edit.index, edit.slot)
        path = self.tree.node(edit.into).path if edit.into in self.tree.nodes else self.prefix(edit.into)
        holder: Any
        if place.index is not None:
            holder = meant.items((*path, place.word))
        elif place.cases:
            holder = meant.mapping((*path, place.cases))
        else:
            holder = meant.get(path)
        if leaving is not None:
            meant.take(leaving.path)
        if place.index is not None:
            holder.insert(place.index, content)
        else:
            holder[place.word] = content

    def prefix(self, into: str) -> tuple[str, ...]:
        return ("subtrees", into[:-1]) if into else ()

    def wrap(self, edit: TreeEdit) -> None:
        node, kind, word = self.tree.node(edit.node), self.tree.types.get(edit.word), edit.word
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
            inner = next(w for w, taken in kind.fields.items() if isinstance(taken, takes.Child) and taken.required)
            self.meant.set(node.path, {word: self.content(edit.value or TRUE), inner: content})

    def unwrap(self, edit: TreeEdit) -> None:
        node = self.tree.node(edit.node)
        unwrap(self.patch, node)
        children = self.meant.get(node.path)[node.type_key.text]
        if isinstance(node.holder, YamlList):
            index = int(node.path[-1])
            self.meant.get(node.path[:-1])[index : index + 1] = children
        else:
            self.meant.set(node.path, children[0])

    def delete(self, edit: TreeEdit) -> None:
        node = self.tree.node(edit.node)
        take_out(self.patch, node)
        self.meant.take(node.path)

    def duplicate(self, edit: TreeEdit) -> None:
        node = self.tree.node(edit.node)
        duplicate(self.patch, node)
        copy = content_of(node.at)
        for address, (scalar, name) in new_names(self.tree, node).items():
            found, path = copy, self.tree.node(address).path[len(node.path) :]
            for step in path:
                found = found[step]
            found["name"] = (name, scalar.plain and quoted(name) == name)
        self.meant.get(node.path[:-1]).insert(int(node.path[-1]) + 1, copy)

    def rename(self, edit: TreeEdit) -> None:
        node = self.tree.node(edit.node)
        self.set_entry(node, "name", quoted(edit.name.strip()) if edit.name.strip() else None)

    def set_modifier(self, edit: TreeEdit) -> None:
        node, word = self.tree.node(edit.node), edit.word
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
        node, port = self.tree.node(edit.node), edit.word
        at, key, value, kind = node.mapping, node.type_key, node.value, node.kind
        assert kind is not None
        if not kind.value.wires:
            if port != key.text or kind.value.nodes or edit.value is None:
                raise EditError(f"{key.text} has no ports; its value is set as the port '{key.text}'", node.id)
            self.set_entry(node, port, edit.value)
            return
        wires = value if isinstance(value, YamlMapping) else None
        if value is not None and wires is None and not (isinstance(value, YamlScalar) and value.is_null):
            raise EditError(f"the value of {key.text} holds no ports; edit it as text", node.id)
        if edit.value is None:
            if wires is not None and port in wires.entries:
                self.without_port(at, key, wires, port)
                self.meant.take((*node.path, key.text, port))
            return
        snippet = read_snippet(edit.value, f"the value of '{port}'", self.tree)
        if wires is None:
            first = read_snippet(f"{{{quoted(port)}: {snippet.flow()}}}", f"the value of '{port}'", self.tree)
            self.patch.set_entry(at, key.text, first)
        else:
            self.patch.set_entry(wires, port, snippet)
        self.meant.mapping((*node.path, key.text))[port] = content_of(snippet.at)

    def without_port(self, at: YamlMapping, key: YamlScalar, wires: YamlMapping, port: str) -> None:
        """Take a port away; the last one leaves `{}`."""
        if len(wires.entries) > 1 or self.tree.is_flow(wires):
            self.patch.remove_entry(wires, port)
        else:
            self.patch.set_value(at, key, wires, read_snippet("{}", "no ports", self.tree))

    def comment(self, edit: TreeEdit) -> None:
        raise EditError("not yet")

    def set_parameter(self, edit: TreeEdit) -> None:
        raise EditError("not yet")

    def extract(self, edit: TreeEdit) -> None:
        raise EditError("not yet")

    def content(self, value: str) -> Any:
        return content_of(read_snippet(value, "the value", self.tree).at)


_DO: dict[str, Callable[[_Edited, TreeEdit], None]] = {
    kind: getattr(_Edited, kind) for kind in _SHAPES if kind != "replace"
}


# ----------------------------------------------------------------------------------------------------- nodes


def nodes(text: str) -> list[dict[str, Any]]:
    """Return every node of a text for a drawing: parents before children, the main tree first.

    A text that is no YAML gives one entry without an address, with the error. Each node has `id`, `parent`, `index`,
    `slot`, `tree` (the subtree's name; empty for the main tree), `type`, `kind` (composite, leaf, skill, subtree),
    `name`, `line`, `column`, `end_line`, `ports`, `modifiers`, `comment`, `description`, `error`.
    """
    tree = WrittenTree(text.removeprefix(BOM))
    if tree.problems or tree.top is None:
        found = tree.problems[0] if tree.problems else None
        line, error = (found.line, found.message) if found else (1, "the text is no tree")
        return [{"id": "", "parent": "", "line": line, "column": found.column if found else 1, "error": error}]
    read = _read_nodes(tree)
    return [_drawn(tree, node, read) for node in tree.nodes.values()]


def _read_nodes(tree: WrittenTree) -> tuple[dict[int, TreeNode], dict[int, str]]:
    """Return the nodes as the language reads them, by their place, and the errors of reading by line."""
    findings = Findings()
    reader = NodeReader(findings, TreeFile(tree.source), tree.types)
    found: dict[int, TreeNode] = {}
    for node in [n for n in tree.nodes.values() if not n.parent]:
        root = reader.node(node.at)
        for one in root.walk() if root is not None else ():
            found[id(one.at)] = one
            found.setdefault(id(one.value), one)
    return found, {finding.line: finding.message for finding in reversed(findings.sorted())}


def _drawn(tree: WrittenTree, node: WrittenNode, read: tuple[dict[int, TreeNode], dict[int, str]]) -> dict[str, Any]:
    found = read[0].get(id(node.at))
    at, kind = node.at, node.kind
    entries: Mapping[str, tuple[YamlScalar, YamlNode]] = at.entries if isinstance(at, YamlMapping) else {}
    name, description = (_text(entries.get(key)) for key in ("name", "description"))
    word = found.key.text if found is not None else node.key.text if node.key is not None else ""
    ports: list[dict[str, Any]] = []
    if kind is not None and kind.value.wires and isinstance(node.value, YamlMapping):
        ports = [_shown(tree, *entry) for entry in node.value.entries.values()]
    elif (
        kind is not None
        and not kind.value.nodes
        and not kind.value.wires
        and node.key is not None
        and node.value is not None
    ):
        ports = [_shown(tree, node.key, node.value)]
    elif kind is None and found is not None:
        ports = [{"name": word, "text": tree.raw(at), "line": at.line}]
    taken = {"name", "description", node.key.text if node.key is not None else ""}
    slots = {n.slot for n in tree.nodes.values() if n.parent == node.id} if len(entries) > 1 else set()
    beside = [(k, v) for w, (k, v) in entries.items() if w not in taken and w not in slots and w != "cases"]
    return {
        "id": node.id, "parent": node.parent, "index": node.index, "slot": node.slot,
        "tree": node.id.partition("root")[0].removesuffix(":") if ":" in node.id else "",
        "type": word,
        "kind": "" if kind is None else kind.key if kind.calls else kind.role,
        "name": name,
        "line": at.line, "column": at.column, "end_line": tree.row(tree.end(at)) + 1,
        "ports": ports, "modifiers": [_shown(tree, k, v) for k, v in beside],
        "comment": found.comment if found is not None else "",
        "description": description,
        "error": "" if found is not None else read[1].get(at.line, "this node cannot be read"),
    }  # fmt: skip


def _text(entry: tuple[YamlScalar, YamlNode] | None) -> str:
    return entry[1].text if entry is not None and isinstance(entry[1], YamlScalar) else ""


def _shown(tree: WrittenTree, key: YamlScalar, value: YamlNode) -> dict[str, Any]:
    return {"name": key.text, "text": tree.raw(value), "line": key.line}
