"""One node: a mapping with exactly one type key, and modifiers beside it."""

from __future__ import annotations

import re

from pomona.executive.language.model import Entry, TreeFile, TreeNode
from pomona.executive.nodes.catalogue import RESERVED, NodeTypes
from pomona.executive.nodes.leaves import SKILL, SUBTREE
from pomona.executive.nodes.node_type import NodeType
from pomona.executive.values.findings import Edit, Findings, Instead, did_you_mean
from pomona.executive.values.removed import report_removed
from pomona.executive.values.yaml_errors import moved
from pomona.executive.values.yaml_nodes import (
    ShapeCheck,
    YamlList,
    YamlMapping,
    YamlNode,
    YamlScalar,
    shape_of,
)

_SKILL = re.compile(r"[A-Z][A-Za-z0-9_]*")
_UNSPACED = re.compile(r"\w+:(?=\S)")
_BAD_IN_NAMES = re.compile(r"[/:#{}\x00-\x1f]")


class NodeReader:
    """Reads the nodes of one file (a `Reading`)."""

    def __init__(self, findings: Findings, file: TreeFile, types: NodeTypes) -> None:
        self.findings = findings
        self.file = file
        self.types = types
        self.known = dict(types)
        self.shape = ShapeCheck(findings)
        self.commented: set[int] = set()
        self.beside = ("name", "description", *types.beside)
        self.words = frozenset({*self.beside, *types.fields})

    def node(self, written: YamlNode) -> TreeNode | None:
        """Return the node, or None when it has no type that could be guessed."""
        if not isinstance(written, YamlMapping):
            hint = "write 'sequence:' above it, and the list two columns further right"
            if isinstance(written, YamlScalar):
                hint = (
                    f"write '{written.text}: {{}}'"
                    if _SKILL.fullmatch(written.text)
                    else "write 'Skill: {port: …}'"
                )
            self.findings.error(
                written, "shape", f"a node is a mapping, this is {shape_of(written)}", hint
            )
            return None
        entry = self.type_of(written)
        if entry is None:
            return None
        problem = self.types.problems.get(entry[0].text)
        if problem is not None:
            self.findings.error(
                entry[0], "broken-node", f"'{entry[0].text}' cannot be used: {problem}"
            )
            return None
        node = TreeNode(self.type_meant(*entry), *entry, written)
        node.comment = self.comment(written.line)
        if len(written.entries) > 1:
            self.modifiers(node)
        if node.modifiers:
            node.wrap(
                tuple(
                    modifier for modifier in self.types.modifiers if modifier.key in node.modifiers
                )
            )
        for modifier in node.wrapping:
            self.take(node, modifier)
        self.take(node, node.type)
        return node

    def take(self, node: TreeNode, layer: NodeType) -> None:
        """Let each part of a type or a modifier read its value."""
        for slot, taken in layer.slots.items():
            entry = node.entry(layer, slot)
            if entry is not None:
                taken.take(self, node, layer, slot, entry[1])
            elif taken.required:
                message = f"'{layer.key}' has no '{slot}'"
                hint = f"add '{slot}: …' beside it"
                self.findings.error(node.key, "missing-key", message, hint)

    def type_named(self, word: str) -> NodeType:
        """Return the node type that a word stands for: a registered one, a subtree, or a skill."""
        found = self.known.get(word)
        if found is not None:
            return found
        return SUBTREE if word in self.file.subtrees or not _SKILL.fullmatch(word) else SKILL

    def type_meant(self, key: YamlScalar, value: YamlNode) -> NodeType:
        """Return the node type of a key; reports `Sequence:` with a list below, which no skill or subtree takes."""
        found = self.type_named(key.text)
        is_list = isinstance(value, YamlList)
        if (
            found not in (SKILL, SUBTREE)
            or isinstance(value, YamlMapping)
            or key.text in self.file.subtrees
        ):
            return found
        if is_list and report_removed(self.findings, key, "node", key.text):
            return self.types["sequence"]  # so that its children are read
        meant = did_you_mean(key.text, self.types.composites) if is_list else ""
        foreign = self.types.known_elsewhere(key.text)
        if foreign is not None and foreign.role == ("composite" if is_list else "leaf"):
            meant = Instead(f"did you mean '{foreign.key}'?", key.text, foreign.key)
        if isinstance(meant, Instead):
            self.findings.error(
                key, "unknown-type-of-node", f"no node is named '{key.text}'", meant
            )
            return self.types[meant.right]
        return found

    def type_of(self, written: YamlMapping) -> Entry | None:
        """Return the entry with the node's type, or None; report keys that belong to no node."""
        candidates = [entry for name, entry in written.entries.items() if name not in self.words]
        if not candidates:
            first = self.first_key(written)
            message = "this node has no type"
            hint = "name a skill, a subtree, or a word such as sequence, check or wait"
            if isinstance(first, YamlScalar) and first.text in self.types.beside:
                message = f"'{first.text}' is a modifier and no node of its own"
                hint = "write it beside the node that it belongs to, at the same column"
            self.findings.error(first, "no-type", message, hint)
            return None
        first, value = candidates[0]
        if first.text == "type" and isinstance(value, YamlScalar) and self.is_type(value.text):
            message = f"the type is the node's first key: write '{value.text}:' and its children or ports below"
            self.findings.error(first, "no-type", message)
            return None
        unspaced = _UNSPACED.match(candidates[0][0].text)
        if unspaced is not None and candidates[0][0].plain:
            key = candidates[0][0]
            edits = [Edit(key.line, key.column + len(unspaced[0]), 0, " ")]
            self.findings.error(
                key, "yaml", f"a space is missing behind '{unspaced[0]}'", edits=edits
            )
            return None
        if len(candidates) == 1:
            return candidates[0]
        known = [e for e in candidates if self.is_type(e[0].text)] or candidates[:1]
        chosen = known[0]
        ports: dict[str, Entry] = {}
        for key, value in candidates:
            if key is chosen[0]:
                continue
            if any(key is other[0] for other in known):
                message = f"a node has one type; this one is '{chosen[0].text}' and '{key.text}'"
                self.findings.error(key, "two-types", message, "put both into a sequence")
            elif key.text in self.types.problems:
                message = f"'{key.text}' cannot be used: {self.types.problems[key.text]}"
                self.findings.error(key, "broken-node", message)
            elif not report_removed(self.findings, key, "node", key.text):
                own = self.types.get(chosen[0].text)
                allowed = (*self.beside, *(own.fields if own is not None else ()))
                meant = did_you_mean(key.text, allowed)
                if (
                    not meant
                    and own is None
                    and isinstance(chosen[1], YamlScalar)
                    and chosen[1].is_null
                ):
                    ports[key.text] = key, value
                    message = f"'{key.text}' is no modifier; a port of {chosen[0].text} starts at column {key.column + 2}"
                    self.findings.error(
                        key, "unknown-key", message, edits=[*moved(key.source, key.line, 2)]
                    )
                    continue
                hint = meant or "modifiers are " + ", ".join(allowed)
                self.findings.error(key, "unknown-key", f"no modifier named '{key.text}'", hint)
        if not ports:
            return chosen
        at = chosen[1]
        return chosen[0], YamlMapping(
            at.source, at.line, at.column, at.end_line, at.end_column, ports
        )

    def is_type(self, word: str) -> bool:
        """Return True if a word can stand for a node."""
        return word in self.known or word in self.file.subtrees or bool(_SKILL.fullmatch(word))

    def first_key(self, written: YamlMapping) -> YamlNode:
        """Return the first key of a mapping, to point at."""
        return next((key for key, _ in written.entries.values()), written)

    def modifiers(self, node: TreeNode) -> None:
        """Read the keys beside the node's type: name, description and modifiers."""
        for name, (key, value) in node.at.entries.items():
            if key is node.key or name not in self.words:
                continue
            if name == "name":
                node.name = self.name(value)
            elif name == "description":
                described = self.shape.text(value)
                node.description = described.text if described is not None else ""
            elif name in self.types or self.belongs(node, key):
                node.modifiers[name] = (key, value)

    def belongs(self, node: TreeNode, key: YamlScalar) -> bool:
        """Return True if something beside a field has such a field; reports when nothing has."""
        owners = self.types.owners(key.text)
        if node.type in owners or any(
            owner.role == "modifier" and owner.key in node.at.entries for owner in owners
        ):
            return True
        owner = owners[0]
        if owner.role == "modifier":
            message = f"'{key.text}' means nothing without '{owner.key}'"
            hint = f"add '{owner.key}: …' beside it"
            self.findings.error(key, "missing-key", message, hint)
        else:
            message = f"'{key.text}' belongs to {owner.key}, not to {node.key.text}"
            self.findings.error(key, "unknown-key", message)
        return False

    def name(self, value: YamlNode) -> YamlScalar | None:
        name = self.shape.text(value)
        if name is not None and (
            _BAD_IN_NAMES.search(name.text) or not name.text.strip() or len(name.text) > 80
        ):
            hint = "names make paths: no / : # { }, at most 80 characters"
            self.findings.error(
                name, "bad-name", f"'{name.text[:80]}' is not a valid name for a node", hint
            )
            return None
        return name

    def comment(self, line: int) -> str:
        """Return the comment on the node's first line and the comment lines above, each given to one node only."""
        source = self.file.source
        if line not in source.comments and line - 1 not in source.comment_lines:
            return ""
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


def is_word(types: NodeTypes, name: str) -> bool:
    """Return True if a name is a word of the language, which no subtree can have."""
    return name in types or name in types.fields or name in RESERVED
