"""The nodes of a record as a tree: checked once, where they are read, so that each walk up or down in them ends."""

from __future__ import annotations

from typing import Any

MOST_NODES = 20_000
"""Largest tree that is read [nodes]; one of twice the size that `pomona check` allows."""

DEEPEST_NODE = 1_000
"""Deepest tree that is read [levels]: py_trees ticks with Python's recursion, whose limit is 1 000 calls."""


def tree_of(value: Any) -> list[dict[str, Any]]:
    """Return the nodes of a tree in drawing order: one root, then each node below an earlier one.

    Raises TypeError, ValueError: these are no nodes, or they form no tree; the text names the node.
    """
    if not isinstance(value, list) or len(value) > MOST_NODES:
        what = f"{len(value)} nodes" if isinstance(value, list) else f"{str(value)[:40]!r}"
        raise ValueError(f"{what} stand where a tree of at most {MOST_NODES} nodes is expected")
    levels: dict[str, int] = {}
    for node in value:
        path = _path_of(node)
        parent = node.get("parent")
        if path in levels:
            raise ValueError(f"the tree has two nodes '{path[:100]}'")
        if levels and not (isinstance(parent, str) and parent in levels):
            raise ValueError(f"node '{path[:100]}' has no parent before it: the nodes form no tree")
        if not levels and parent is not None:
            raise ValueError(f"the first node '{path[:100]}' has a parent: the nodes form no tree")
        levels[path] = levels[parent] + 1 if parent is not None else 0
        if levels[path] > DEEPEST_NODE:
            raise ValueError(f"node '{path[:100]}' is more than {DEEPEST_NODE} levels deep")
        node.setdefault("name", path)
    return value


def _path_of(node: Any) -> str:
    """Return a node's path. Raises TypeError: this is no node, or one of its texts is none."""
    if not isinstance(node, dict) or not isinstance(node.get("path"), str):
        raise TypeError(f"{str(node)[:40]!r} stands where a node with a path is expected")
    path: str = node["path"]
    line = node.get("line", 0)
    if not all(isinstance(node.get(key, ""), str) for key in ("name", "type", "kind")):
        raise TypeError(f"name, type and kind of node '{path[:100]}' are no texts")
    if not isinstance(line, int) or isinstance(line, bool):
        raise TypeError(f"the line of node '{path[:100]}' is no number")
    return path
