"""Names of the skills of a document: by skill, by the node's own name, by path."""

from __future__ import annotations

from collections.abc import Iterator

from pomona.executive.language.model import Definition, Document, TreeNode
from pomona.executive.nodes.calls import SKILL, SUBTREE

MAX_PATHS = 10_000


class UniquePaths:
    """Path ids: a path that is taken gets a number, `Plan`, `Plan#2` …"""

    def __init__(self) -> None:
        self.taken: set[str] = set()

    def take(self, base: str) -> str:
        """Return a path that no other node has: the given one, or with a number."""
        path, number = base, 1
        while path in self.taken:
            number += 1
            path = f"{base}#{number}"
        self.taken.add(path)
        return path


def skills_by_node(document: Document) -> dict[str, str]:
    """Skill by all that a node may be called: the skill's name, its own, its path (with and without the root)."""
    found: dict[str, str] = {}
    for definition in document.definitions():
        for node in definition.root.walk() if definition.root is not None else ():
            if node.type is SKILL:
                found.setdefault(node.key.text, node.key.text)
                found.setdefault(node.label, node.key.text)
    for path, skill in _paths(document):
        found.setdefault(path, skill)
        found.setdefault(path.partition("/")[2], skill)
    found.pop("", None)
    return found


def _paths(document: Document) -> Iterator[tuple[str, str]]:
    """Path ids of all skills, as `build` gives them."""
    paths = UniquePaths()

    def walk(node: TreeNode, path: str, definition: Definition, depth: int) -> Iterator[tuple[str, str]]:
        if node.type is SKILL:
            yield path, node.key.text
        for child in node.children:
            yield from walk(child, paths.take(f"{path}/{child.label}"), definition, depth)
        called = definition.file.subtrees.get(node.key.text) if node.type is SUBTREE else None
        if called is not None and called.root is not None and depth < 50 and len(paths.taken) < MAX_PATHS:
            yield from walk(called.root, paths.take(f"{path}/{called.root.label}"), called, depth + 1)
        for slot, part in node.parts.items():
            yield from walk(part, f"{path}:{slot}", definition, depth)

    main = document.main.main
    if main is not None and main.root is not None:
        yield from walk(main.root, paths.take(document.main.name), main, 0)
