"""One edit of a tree file, as a message describes it.

Addresses of nodes stand in `written_tree`. Messages, as JSON:

    insert         into, index, node (YAML of one node); slot: a word that takes one node (then, on_failure, a case)
    move           node, into, index, slot: the node becomes child `index` of `into`, counted without the node itself;
                   `into` is its address before the move
    wrap           node, in (a word that takes nodes, or a modifier), value: of a modifier or a condition
    unwrap, delete, duplicate    node
    rename         node, name: empty takes the name away
    set_port       node, port, value: YAML or null; of a word without ports (check, wait …) the port is the word itself,
                   of the condition of an `if` it is `check`
    set_modifier   node, modifier (also name, description and fields such as retry_if), value: YAML or null
    comment        node, text: empty takes it away
    set_parameter  name, value: its default, or a whole declaration `{type: int, …}`; null takes it away

An empty `into` is the file, whose `root` is missing; `look:` is the subtree of that name.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from pomona.tools.editor.written_tree import EditError

_KEYS = {"in": "word", "port": "word", "modifier": "word"}
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
