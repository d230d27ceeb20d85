"""A YAML node as it is written, on one line."""

from __future__ import annotations

from pomona.executive.values.yaml_nodes import YamlList, YamlMapping, YamlNode, YamlScalar


def written(node: YamlNode) -> str:
    """`{a: 1, b: [x, y]}`; scalars without their quotes."""
    if isinstance(node, YamlScalar):
        return node.text
    if isinstance(node, YamlList):
        return f"[{', '.join(map(written, node.items))}]"
    assert isinstance(node, YamlMapping)
    return "{" + ", ".join(f"{key.text}: {written(value)}" for key, value in node.entries.values()) + "}"
