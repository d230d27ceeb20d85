"""Checks of a YAML node's shape; each reports the missing or wrong part."""

from __future__ import annotations

from collections.abc import Iterable

from pomona.executive.values.findings import Findings, did_you_mean
from pomona.executive.values.yaml_nodes import YamlList, YamlMapping, YamlNode, YamlScalar


class ShapeCheck:
    """Asks a node to be of one shape; reports and answers None when it is not."""

    def __init__(self, findings: Findings) -> None:
        self.findings = findings

    def mapping(self, node: YamlNode, what: str) -> YamlMapping | None:
        """Return the node as a mapping; anything else is reported, and gives None."""
        if isinstance(node, YamlMapping):
            return node
        self.findings.error(node, "shape", f"{what} is a mapping ('key: value'), this is {shape_of(node)}")
        return None

    def entries(self, node: YamlNode | None, what: str, how: str) -> list[tuple[YamlScalar, YamlNode]]:
        """Entries of a mapping that may be left out or empty."""
        if node is None or (isinstance(node, YamlScalar) and node.is_null):
            return []
        if isinstance(node, YamlMapping):
            return list(node.entries.values())
        self.findings.error(node, "shape", f"{what} are a mapping, this is {shape_of(node)}", f"write {how}")
        return []

    def text(self, node: YamlNode | None) -> YamlScalar | None:
        """Return a scalar; None when it is left out."""
        if node is None or (isinstance(node, YamlScalar) and not node.is_null):
            return node
        self.findings.error(node, "shape", f"a word is expected here, this is {shape_of(node)}")
        return None

    def known_keys(self, node: YamlMapping, known: Iterable[str], what: str) -> None:
        """Report unknown keys, each with the most similar known key."""
        names = tuple(known)
        for key, _ in node.entries.values():
            if key.text not in names:
                hint = did_you_mean(key.text, names) or f"{what} has {', '.join(names)}"
                self.findings.error(key, "unknown-key", f"{what} has no '{key.text}'", hint)


def shape_of(node: YamlNode) -> str:
    """Name the node's shape in messages."""
    if isinstance(node, YamlMapping):
        return "a mapping"
    if isinstance(node, YamlList):
        return "a list"
    return "empty" if isinstance(node, YamlScalar) and node.is_null else "a single value"
