"""The nodes of a tree file in the form in which a page draws them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pomona.executive.language.model import TreeFile
from pomona.executive.language.read_node import NodeReader
from pomona.executive.nodes.node_type import TreeNode
from pomona.executive.values.findings import Findings
from pomona.executive.values.yaml_nodes import YamlMapping, YamlNode, YamlScalar
from pomona.tools.editor.written_tree import BOM, WrittenNode, WrittenTree


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
        return [
            {
                "id": "",
                "parent": "",
                "line": line,
                "column": found.column if found else 1,
                "error": error,
            }
        ]
    read = _read_nodes(tree)
    return [_drawn(tree, node, read) for node in tree.nodes.values()]


def _read_nodes(tree: WrittenTree) -> tuple[dict[int, TreeNode], dict[int, str]]:
    """Return the nodes as the language reads them, by their place, and the errors of reading by line."""
    findings = Findings()
    reader = NodeReader(findings, TreeFile(tree.source), tree.types)
    found: dict[int, TreeNode] = {}
    mappings = {id(node.at) for node in tree.nodes.values() if node.key is not None}
    for node in [n for n in tree.nodes.values() if not n.parent]:
        root = reader.node(node.at)
        for one in root.walk() if root is not None else ():
            found[id(one.at) if id(one.at) in mappings else id(one.value)] = (
                one  # a condition has no mapping
            )
    return found, {finding.line: finding.message for finding in reversed(findings.sorted())}


def _drawn(
    tree: WrittenTree, node: WrittenNode, read: tuple[dict[int, TreeNode], dict[int, str]]
) -> dict[str, Any]:
    found = read[0].get(id(node.at))
    at = node.at
    kind = node.kind
    entries: Mapping[str, tuple[YamlScalar, YamlNode]] = (
        at.entries if isinstance(at, YamlMapping) else {}
    )
    name, description = (_text(entries.get(key)) for key in ("name", "description"))
    word = found.key.text if found is not None else node.key.text if node.key is not None else ""
    apart = {"name", "description", node.key.text if node.key is not None else ""}
    beside = [entry for w, entry in entries.items() if w not in apart and not _holds_nodes(tree, w)]
    return {
        "id": node.id, "parent": node.parent, "index": node.index, "slot": node.slot,
        "tree": node.id.partition("root")[0].removesuffix(":") if ":" in node.id else "",
        "type": word,
        "kind": "" if kind is None else kind.key if kind.calls else kind.role,
        "name": name,
        "line": at.line, "column": at.column, "end_line": tree.row(tree.end(at)) + 1,
        "ports": _ports(tree, node, word) if found is not None else [],
        "modifiers": [_shown(tree, *entry) for entry in beside],
        "comment": found.comment if found is not None else "",
        "description": description,
        "error": "" if found is not None else read[1].get(at.line, "this node cannot be read"),
    }  # fmt: skip


def _holds_nodes(tree: WrittenTree, word: str) -> bool:
    return any(owner.fields[word].nodes for owner in tree.types.owners(word))


def _ports(tree: WrittenTree, node: WrittenNode, word: str) -> list[dict[str, Any]]:
    """Return the ports of a node; the value of a word without ports is a port of its name."""
    kind = node.kind
    value = node.value
    if kind is None or node.key is None or value is None:  # a condition
        return [{"name": word, "text": tree.raw(node.at), "line": node.at.line}]
    if kind.value.wires:
        entries = value.entries.values() if isinstance(value, YamlMapping) else ()
        return [_shown(tree, *entry) for entry in entries]
    return [] if kind.value.nodes else [_shown(tree, node.key, value)]


def _text(entry: tuple[YamlScalar, YamlNode] | None) -> str:
    return entry[1].text if entry is not None and isinstance(entry[1], YamlScalar) else ""


def _shown(tree: WrittenTree, key: YamlScalar, value: YamlNode) -> dict[str, Any]:
    return {"name": key.text, "text": tree.raw(value), "line": key.line}
