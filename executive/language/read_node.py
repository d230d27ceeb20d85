"""One node: a mapping with exactly one type key, and modifiers beside it."""

from __future__ import annotations

import re

from executive.language.model import BRANCHES, LEAVES, MODIFIERS, SPECIFIC, Entry, TreeFile, TreeNode
from executive.values.findings import Findings, did_you_mean
from executive.values.shape import Shape, shape_of
from executive.values.yaml_nodes import YamlList, YamlMapping, YamlNode, YamlScalar

_SKILL = re.compile(r"[A-Z][A-Za-z0-9_]*")
_BAD_IN_NAMES = re.compile(r"[/:#{}\x00-\x1f]")
_ALL_SPECIFIC = {name: kind for kind, names in SPECIFIC.items() for name in names}


class NodeReader:
    """Reads the nodes of one file."""

    def __init__(self, findings: Findings, file: TreeFile) -> None:
        self.findings, self.file = findings, file
        self.shape = Shape(findings)
        self.commented: set[int] = set()

    def node(self, written: YamlNode) -> TreeNode | None:
        """The node, or None when it has no type that could be guessed."""
        if not isinstance(written, YamlMapping):
            hint = ""
            if isinstance(written, YamlScalar) and not written.is_null:
                hint = f"write '{written.text}: {{}}'" if _SKILL.fullmatch(written.text) else "write 'Skill: {port: …}'"
            self.findings.error(written, "shape", f"a node is a mapping, this is {shape_of(written)}", hint)
            return None
        entry = self.type_of(written)
        if entry is None:
            return None
        key, value = entry
        kind = key.text
        if kind not in BRANCHES and kind not in LEAVES:
            kind = "subtree" if kind in self.file.subtrees or not _SKILL.fullmatch(kind) else "skill"
        node = TreeNode(kind, key, value, written)
        node.comment = self.comment(written.line)
        self.modifiers(node)
        if kind in BRANCHES:
            self.children(node)
        elif kind in ("skill", "subtree", "set", "fail"):
            node.ports = self.ports(node)
        elif kind == "succeed" and not _is_empty(value):
            self.findings.error(value, "shape", "'succeed' takes nothing", "write 'succeed: {}'")
        return node

    def type_of(self, written: YamlMapping) -> Entry | None:
        candidates = [e for name, e in written.entries.items() if name not in MODIFIERS and name not in _ALL_SPECIFIC]
        if not candidates:
            hint = "name a skill, a subtree or one of " + ", ".join(BRANCHES + LEAVES)
            self.findings.error(self.first_key(written), "no-type", "this node does not say what it does", hint)
            return None
        known = [e for e in candidates if self.is_type(e[0].text)] or candidates[:1]
        chosen = known[0]
        for key, _ in candidates:
            if key is chosen[0]:
                continue
            if any(key is other[0] for other in known):
                message = f"a node has one type; this one is '{chosen[0].text}' and '{key.text}'"
                self.findings.error(key, "two-types", message, "put both into a sequence")
            else:
                allowed = (*MODIFIERS, *SPECIFIC.get(chosen[0].text, ()))
                hint = did_you_mean(key.text, allowed) or "modifiers are " + ", ".join(allowed)
                self.findings.error(key, "unknown-key", f"no modifier named '{key.text}'", hint)
        return chosen

    def is_type(self, word: str) -> bool:
        return word in BRANCHES or word in LEAVES or word in self.file.subtrees or bool(_SKILL.fullmatch(word))

    def first_key(self, written: YamlMapping) -> YamlNode:
        return next((key for key, _ in written.entries.values()), written)

    def modifiers(self, node: TreeNode) -> None:
        for name, (key, value) in node.at.entries.items():
            if key is node.key:
                continue
            if name == "name":
                node.name = self.name(value)
            elif name == "description":
                described = self.shape.text(value)
                node.description = described.text if described is not None else ""
            elif name == "on_failure":
                node.on_failure = self.node(value)
                if node.on_failure is not None:
                    node.on_failure.comment = node.on_failure.comment or self.comment(key.line)
                node.modifiers[name] = (key, value)
            elif name in MODIFIERS:
                node.modifiers[name] = (key, value)
            elif name in _ALL_SPECIFIC:
                if name in SPECIFIC.get(node.kind, ()):
                    node.modifiers[name] = (key, value)
                else:
                    message = f"'{name}' belongs to {_ALL_SPECIFIC[name]}, not to {node.key.text}"
                    self.findings.error(key, "unknown-key", message)
        for name, needs in (("on_failure", "retry"), ("retry_if", "retry"), ("as", "for_each")):
            if name in node.modifiers and needs not in node.modifiers:
                message = f"'{name}' means nothing without '{needs}'"
                self.findings.error(node.modifiers[name][0], "missing-key", message, f"add '{needs}: …' beside it")

    def name(self, value: YamlNode) -> YamlScalar | None:
        name = self.shape.text(value)
        if name is not None and (_BAD_IN_NAMES.search(name.text) or not name.text.strip() or len(name.text) > 80):
            hint = "names make paths: no / : # { }, at most 80 characters"
            self.findings.error(name, "bad-name", f"'{name.text[:80]}' is no name for a node", hint)
            return None
        return name

    def children(self, node: TreeNode) -> None:
        if not isinstance(node.value, YamlList):
            message = f"'{node.kind}' takes a list of nodes, this is {shape_of(node.value)}"
            self.findings.error(node.value, "shape", message, "start each child with '- '")
            return
        if not node.value.items:
            self.findings.error(node.value, "shape", f"'{node.kind}' has no children")
        node.children = [child for item in node.value.items if (child := self.node(item)) is not None]
        if node.kind == "recovery" and len(node.value.items) != 2:
            message = f"'recovery' takes two nodes, here are {len(node.value.items)}"
            self.findings.error(node.key, "shape", message, "first what to do, then what to do when it failed")

    def ports(self, node: TreeNode) -> dict[str, Entry]:
        value = node.value
        if isinstance(value, YamlScalar) and value.is_null:
            return {}
        if not isinstance(value, YamlMapping):
            message = f"{node.key.text} takes its ports as a mapping, this is {shape_of(value)}"
            self.findings.error(value, "shape", message, f"write '{node.key.text}: {{port: value}}'")
            return {}
        return dict(value.entries)

    def comment(self, line: int) -> str:
        """The comment on the node's first line and the lines of comment above it, each given to one node only."""
        source = self.file.source
        lines = []
        above = line - 1
        while above in source.comment_lines and above not in self.commented:
            lines.append(above)
            above -= 1
        lines.reverse()
        if line in source.comments and line not in self.commented:
            lines.append(line)
        self.commented.update(lines)
        return " ".join(source.comments[number] for number in lines).strip()


def _is_empty(value: YamlNode) -> bool:
    return value.is_null if isinstance(value, YamlScalar) else isinstance(value, YamlMapping) and not value.entries
