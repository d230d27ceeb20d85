"""The content of a tree file as plain values, and the result of an edit: the measure of an edit of the text."""

from __future__ import annotations

import re
from typing import Any

from pomona.executive.values.yaml_nodes import YamlList, YamlNode, YamlScalar
from pomona.tools.editor.written_tree import WrittenTree, YamlPath

_QUOTED = re.compile(r"[,\[\]{}\n]")  # a plain text with these is written in quotes inside braces
Content = Any


def content_of(at: YamlNode | None) -> Content:
    """Return a value without its places: a mapping, a list, a text with True when it stands without quotes, or None."""
    if at is None:
        return None
    if isinstance(at, YamlScalar):
        return None if at.is_null else (at.text, at.plain and not _QUOTED.search(at.text))
    if isinstance(at, YamlList):
        return [content_of(item) for item in at.items]
    return {word: content_of(value) for word, (_, value) in at.entries.items()}  # type: ignore[attr-defined]


class TreeContent:
    """The content of a file, to be changed by paths of keys and indices."""

    def __init__(self, tree: WrittenTree) -> None:
        self.top = content_of(tree.top)

    def get(self, path: YamlPath) -> Content:
        """Return the value at a path; None when there is none."""
        found = self.top
        for step in path:
            found = found.get(step) if isinstance(found, dict) else found[step]
        return found

    def set(self, path: YamlPath, value: Content) -> None:
        """Put a value at a path."""
        self.get(path[:-1])[path[-1]] = value

    def take(self, path: YamlPath) -> Content:
        """Take a value out."""
        return self.get(path[:-1]).pop(path[-1])

    def filled(self, path: YamlPath, empty: Content) -> Content:
        """Return the list or mapping at a path; where it has no entries, the given one is put there."""
        if not self.get(path):
            self.set(path, empty)
        return self.get(path)
