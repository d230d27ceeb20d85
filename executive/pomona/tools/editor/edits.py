"""Edits of a tree file, each a patch of its text: everything that an edit does not name stays byte for byte.

apply(text, edit_of({"do": "wrap", "node": "root/1", "in": "fallback"}))    the new text, or EditError
nodes(text)                                                                  what a page draws

`tree_edit` has the messages.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping

from pomona.tools.editor.making import (
    comment,
    delete,
    insert,
    move,
    rename,
    set_modifier,
    set_parameter,
    set_port,
)
from pomona.tools.editor.meaning import content_of
from pomona.tools.editor.node_table import nodes
from pomona.tools.editor.patching import TextPatch
from pomona.tools.editor.tree_edit import TreeEdit, edit_of
from pomona.tools.editor.wrapping import duplicate, unwrap, wrap
from pomona.tools.editor.written_tree import BOM, EditError, WrittenTree

__all__ = ["EditError", "TreeEdit", "apply", "edit_of", "nodes"]

_EDITS: Mapping[str, Callable[[TextPatch, TreeEdit], None]] = {
    "insert": insert,
    "move": move,
    "wrap": wrap,
    "unwrap": unwrap,
    "delete": delete,
    "duplicate": duplicate,
    "rename": rename,
    "set_port": set_port,
    "set_modifier": set_modifier,
    "comment": comment,
    "set_parameter": set_parameter,
}


def apply(text: str, edit: TreeEdit) -> str:
    """Return the text with an edit; it reads as the tree before with the edit made.

    Raises EditError: the edit cannot be made, or only with a change of something else.
    """
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
    _EDITS[edit.do](patch, edit)
    result = patch.result()
    _check(patch, result, edit)
    return mark + (result.removesuffix(tree.eol) if cut else result)


def _check(patch: TextPatch, result: str, edit: TreeEdit) -> None:
    """Raise EditError when a text does not read as meant, or has lost a comment."""
    before = patch.tree
    after = WrittenTree(result, before.types)
    at = edit.node if edit.do != "insert" else edit.into
    if after.problems:
        raise EditError(
            f"the text could not be read any more: {after.problems[0].message}; edit it as text", at
        )
    if content_of(after.top) != patch.meant:
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
