"""With which codes a node can fail; a node without any cannot fail."""

from __future__ import annotations

from collections.abc import Mapping

from executive.language.model import Definition, TreeNode
from executive.registry import Registry
from executive.values.yaml_nodes import YamlScalar

Codes = frozenset[str]
NONE: Codes = frozenset()
UNKNOWN = "?"
"""Stands for the codes of a skill or subtree that cannot be looked up: it may fail with any."""


class Failures:
    """Codes of nodes, looked up once each."""

    def __init__(self, skills: Registry, called: Mapping[int, Definition]) -> None:
        """`called` maps the id of each subtree node to the definition that it calls."""
        self.skills, self.called = skills, called
        self._nodes: dict[int, Codes] = {}
        self._bare: dict[int, Codes] = {}
        self._open: set[int] = set()

    def of(self, node: TreeNode, parent: str = "") -> Codes:
        """Codes of a node with its modifiers. `parent` is the kind of node that it stands in."""
        known = self._nodes.get(id(node))
        if known is None:
            known = self._nodes[id(node)] = self._decorated(node)
        if "when" in node.modifiers and parent in ("fallback", "reactive_fallback"):
            return known | {"SKIPPED"}
        return known

    def of_definition(self, definition: Definition) -> Codes:
        """Codes of a subtree; a subtree that calls itself adds none."""
        if definition.root is None or id(definition) in self._open:
            return NONE
        self._open.add(id(definition))
        codes = self.of(definition.root)
        self._open.discard(id(definition))
        return codes

    def before_retry(self, node: TreeNode) -> Codes:
        """Codes with which one try of a retried node fails."""
        codes = self.bare(node)
        for name in ("timeout", "invert", "force"):
            if name in node.modifiers:
                codes = self._wrapped(node, name, codes)
        return codes

    def _decorated(self, node: TreeNode) -> Codes:
        codes = self.bare(node)
        for name in node.decorators:
            codes = self._wrapped(node, name, codes)
        return codes

    def _wrapped(self, node: TreeNode, name: str, codes: Codes) -> Codes:
        if name == "timeout":
            return codes | {"TIMEOUT"}
        if name == "invert":
            return frozenset({"INVERTED"})
        if name == "force":
            value = node.modifiers[name][1]
            return codes | {"FORCED"} if isinstance(value, YamlScalar) and value.text == "failure" else NONE
        if name == "guard":
            return codes | {"CONDITION_FALSE"}
        if name == "retry" and codes and node.on_failure is not None:
            return codes | self.of(node.on_failure)
        return codes

    def bare(self, node: TreeNode) -> Codes:
        """Codes of the node without its modifiers."""
        known = self._bare.get(id(node))
        if known is None:
            known = self._bare[id(node)] = self._compute(node)
        return known

    def _compute(self, node: TreeNode) -> Codes:
        children = [self.of(child, node.kind) for child in node.children]
        match node.kind:
            case "sequence" | "reactive_sequence" | "parallel":
                return NONE.union(*children)
            case "fallback" | "reactive_fallback":
                return NONE.union(*children) if all(children) else NONE
            case "recovery":
                return NONE.union(*children) if children and children[0] else NONE
            case "check":
                return frozenset({"CONDITION_FALSE"})
            case "fail":
                code = node.ports.get("code")
                return frozenset({code[1].text if code and isinstance(code[1], YamlScalar) else "FAILED"})
            case "skill":
                skill = self.skills.get(node.key.text)
                return frozenset({UNKNOWN} if skill is None else skill.failures)
            case "subtree":
                called = self.called.get(id(node))
                return frozenset({UNKNOWN}) if called is None else self.of_definition(called)
            case _:
                return NONE
