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
    set_port       node, port, value: YAML or null; of a word without ports (check, wait …) the port is the word itself
    set_modifier   node, modifier (also name, description and fields such as retry_if), value: YAML or null
    comment        node, text: empty takes it away
    set_parameter  name, value: its default, or a whole declaration `{type: int, …}`; null takes it away
    replace        from, to (offsets in characters of the text, Unicode code points), text: nothing is checked

An empty `into` is the file, whose `root` is missing; `look:` is the subtree of that name.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

from pomona.tools.editor.making import EditedTree, TreeEdit
from pomona.tools.editor.meaning import TreeContent, content_of
from pomona.tools.editor.node_table import nodes
from pomona.tools.editor.patching import TextPatch
from pomona.tools.editor.written_tree import BOM, EditError, WrittenTree

__all__ = ["EditError", "TreeEdit", "apply", "edit_of", "nodes"]

_KEYS = {"in": "word", "port": "word", "modifier": "word", "from": "start", "to": "end"}
_SHAPES: dict[
    str, tuple[dict[str, type], dict[str, type]]
] = {  # needed and further keys of each kind
    "insert": ({"into": str, "node": str}, {"index": int, "slot": str}),
    "move": ({"node": str, "into": str}, {"index": int, "slot": str}),
    "wrap": ({"node": str, "in": str}, {"value": str}),
    "unwrap": ({"node": str}, {}),
    "delete": ({"node": str}, {}),
    "duplicate": ({"node": str}, {}),
    "rename": ({"node": str, "name": str}, {}),
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


def apply(text: str, edit: TreeEdit) -> str:
    """Return the text with an edit; it reads as the tree before with the edit made.

    Raises EditError: the edit cannot be made, or only with a change of something else.
    """
    if edit.do == "replace":
        if not 0 <= edit.start <= edit.end <= len(text):
            raise EditError(
                f"there are no characters {edit.start} to {edit.end} in a text of {len(text)}"
            )
        return text[: edit.start] + edit.text + text[edit.end :]
    mark = BOM if text.startswith(BOM) else ""
    tree = WrittenTree(text[len(mark) :])
    cut = tree.starts[-1] < len(
        tree.text
    )  # the last line has no line break: it has one during the edit
    tree = WrittenTree(tree.text + tree.eol) if cut else tree
    if tree.problems or tree.top is None:
        found = tree.problems[0] if tree.problems else None
        where = (
            f"line {found.line}: {found.message}; correct it in the text first"
            if found
            else "the text is no tree"
        )
        raise EditError(where)
    patch = TextPatch(tree)
    meant = TreeContent(tree)
    getattr(EditedTree(tree, patch, meant), edit.do)(edit)
    result = patch.result()
    _check(tree, patch, meant, result, edit)
    return mark + (result.removesuffix(tree.eol) if cut else result)


def _check(
    before: WrittenTree, patch: TextPatch, meant: TreeContent, result: str, edit: TreeEdit
) -> None:
    """Raise EditError when a text does not read as meant, or has lost a comment."""
    after = WrittenTree(result, before.types)
    at = edit.node if edit.do != "insert" else edit.into
    if after.problems:
        raise EditError(
            f"the text could not be read any more: {after.problems[0].message}; edit it as text", at
        )
    if content_of(after.top) != meant.top:
        raise EditError("the edit would change something else in the text; edit it as text", at)
    lost = (
        Counter(before.source.comments.values())
        - Counter(after.source.comments.values())
        - Counter(patch.dropped)
    )
    if lost:
        raise EditError(f"a comment would be lost: # {next(iter(lost))}; edit it as text", at)
    if edit.do == "comment":
        found = next(node["comment"] for node in nodes(result) if node["id"] == edit.node)
        if found != " ".join(edit.text.split()):
            raise EditError("a comment here is read as that of another node; edit it as text", at)
