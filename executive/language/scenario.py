"""Scenario files: a tree, mocks, and what is to happen.

pomona: 1
tree: pick_apple.yaml
mocks: {Refine: {after: 200 ms}}                 # for every case
cases:
  - name: the second plan is tried when there is no path
    set: {attempts: 2}
    mocks: {Plan: [NO_PATH]}
    expect: failure                              # or {status: failure, code: NO_PATH, node: Attempt/Plan}
    visits: [Plan closer and longer]
    never: [Lift]
    calls: {Plan: 2}
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from executive.language.literals import LiteralError, literal
from executive.language.mocks import MockPlan, MockReader, MockResult
from executive.language.model import Document
from executive.language.names_of_nodes import skills_by_node
from executive.language.read import read_file
from executive.ports import TIME
from executive.registry import Registry
from executive.values.findings import Finding, Findings, Source, did_you_mean
from executive.values.shape import ShapeCheck
from executive.values.yaml_nodes import YamlList, YamlMapping, YamlNode, YamlScalar, read_yaml

_TOP = ("pomona", "tree", "description", "mocks", "set", "cases")
_CASE = ("name", "mocks", "set", "expect", "visits", "never", "calls", "limit")
_EXPECT = ("status", "code", "node")
LIMIT = 600.0
"""Seconds on the simulated clock after which a case is given up."""


@dataclass(frozen=True, slots=True)
class Case:
    """One run of the tree and what is expected of it."""

    name: str
    line: int
    mocks: MockPlan
    settings: Mapping[str, str] = field(default_factory=dict)
    status: str = "success"
    code: str = ""
    failing_node: str = ""
    visits: tuple[str, ...] = ()
    never: tuple[str, ...] = ()
    calls: Mapping[str, int] = field(default_factory=dict)
    limit: float = LIMIT


@dataclass(frozen=True, slots=True)
class Scenario:
    """A scenario file: the tree's document, its cases, and what is wrong with it."""

    path: str
    document: Document | None
    cases: tuple[Case, ...]
    findings: tuple[Finding, ...]


def is_scenario(text: str) -> bool:
    """Whether a file's text looks like a scenario and not like a tree."""
    lines = text.splitlines()
    return any(line.startswith("cases:") for line in lines) and not any(line.startswith("root:") for line in lines)


def read_scenario(text: str, path: str | Path, skills: Registry, *, tree_folders: Sequence[Path] = ()) -> Scenario:
    """Read a scenario and the tree that it tests. Raises nothing: what is wrong is in the findings."""
    findings = Findings()
    document, cases = None, []
    reader = _Reader(findings, skills, Path(path), tree_folders)
    top = reader.top(Source(str(path), text))
    if top is not None:
        document = reader.tree(top)
        if document is not None:
            cases = reader.cases(top, document)
    return Scenario(str(path), document, tuple(cases), tuple(findings.sorted()))


def read_mocks(text: str, path: str | Path, document: Document, skills: Registry) -> tuple[MockPlan, list[Finding]]:
    """The `mocks` of a file alone, for a dry run of `document`: a mapping `mocks:`, or a scenario's common ones."""
    findings = Findings()
    root = read_yaml(Source(str(path), text), findings)
    results: dict[str, tuple[MockResult, ...]] = {}
    if isinstance(root, YamlMapping):
        shape = ShapeCheck(findings)
        known = ("pomona", "mocks", *(_TOP if "cases" in root.entries else ()))
        shape.known_keys(root, known, "a file of mocks")
        if "mocks" not in root.entries and "cases" not in root.entries:
            findings.error(root, "missing-key", "the file holds no mocks", "write 'mocks: {Skill: result}'")
        results = MockReader(findings, skills, skills_by_node(document)).read(root.get("mocks"))
    elif root is not None:
        ShapeCheck(findings).mapping(root, "a file of mocks")
    return MockPlan(results), findings.sorted()


class _Reader:
    def __init__(self, findings: Findings, skills: Registry, path: Path, tree_folders: Sequence[Path]) -> None:
        self.findings, self.skills, self.path, self.tree_folders = findings, skills, path, tree_folders
        self.shape = ShapeCheck(findings)

    def top(self, source: Source) -> YamlMapping | None:
        root = read_yaml(source, self.findings)
        top = None if root is None else self.shape.mapping(root, "a scenario file")
        if top is not None:
            self.shape.known_keys(top, _TOP, "a scenario file")
        return top

    def tree(self, top: YamlMapping) -> Document | None:
        written = self.shape.text(top.get("tree"))
        if written is None:
            if "tree" not in top.entries:
                self.findings.error(top, "missing-key", "the scenario names no tree", "write 'tree: my_tree.yaml'")
            return None
        folder = self.path.parent
        for base in (folder, *self.tree_folders):
            if (base / written.text).is_file():
                return read_file(base / written.text, tree_folders=self.tree_folders)
        self.findings.error(written, "file", f"there is no tree '{written.text}' beside the scenario")
        return None

    def cases(self, top: YamlMapping, document: Document) -> list[Case]:
        self.nodes = skills_by_node(document)
        self.names = {node.label for d in document.definitions() if d.root for node in d.root.walk()} | set(self.nodes)
        common = MockReader(self.findings, self.skills, self.nodes).read(top.get("mocks"))
        common_settings = self.settings(top.get("set"))
        written = top.get("cases")
        if not isinstance(written, YamlList):
            self.findings.error(
                written or top, "shape", "a scenario has a list of cases", "write 'cases:' and '- name: …'"
            )
            return []
        found = [self.case(item, common, common_settings, i) for i, item in enumerate(written.items, start=1)]
        return [case for case in found if case is not None]

    def case(
        self,
        item: YamlNode,
        common: Mapping[str, tuple[MockResult, ...]],
        common_settings: Mapping[str, str],
        number: int,
    ) -> Case | None:
        at = self.shape.mapping(item, "a case")
        if at is None:
            return None
        self.shape.known_keys(at, _CASE, "a case")
        name = self.shape.text(at.get("name"))
        mocks = {**common, **MockReader(self.findings, self.skills, self.nodes).read(at.get("mocks"))}
        status, code, failing = self.expected(at.get("expect"))
        return Case(
            name.text if name is not None else f"case {number}",
            at.line,
            MockPlan(mocks),
            {**common_settings, **self.settings(at.get("set"))},
            status,
            code,
            failing,
            self.node_names(at.get("visits")),
            self.node_names(at.get("never")),
            self.calls(at.get("calls")),
            self.limit(at.get("limit")),
        )

    def settings(self, node: YamlNode | None) -> dict[str, str]:
        entries = self.shape.entries(node, "settings", "'parameter: value' for each")
        return {key.text: value.text for key, value in entries if isinstance(value, YamlScalar)}

    def expected(self, node: YamlNode | None) -> tuple[str, str, str]:
        if node is None:
            return "success", "", ""
        status, code, failing = "", "", ""
        if isinstance(node, YamlScalar):
            status = node.text
        elif (at := self.shape.mapping(node, "'expect'")) is not None:
            self.shape.known_keys(at, _EXPECT, "'expect'")
            words = [self.shape.text(at.get(name)) for name in _EXPECT]
            status, code, failing = ("" if word is None else word.text for word in words)
            status = status or "failure"
        if status not in ("success", "failure"):
            self.findings.error(node, "value", "a tree ends with success or failure")
        return status, code, failing

    def node_names(self, node: YamlNode | None) -> tuple[str, ...]:
        if node is None:
            return ()
        items = node.items if isinstance(node, YamlList) else [node]
        words = [word for item in items if (word := self.shape.text(item)) is not None]
        for word in words:
            self.known(word)
        return tuple(word.text for word in words)

    def known(self, word: YamlScalar) -> None:
        last = word.text.rsplit("/", 1)[-1].partition("#")[0].partition(":")[0]
        if word.text not in self.names and last not in self.names:
            hint = did_you_mean(word.text, self.names)
            self.findings.error(word, "unknown-node", f"the tree has no node '{word.text}'", hint)

    def calls(self, node: YamlNode | None) -> dict[str, int]:
        found: dict[str, int] = {}
        for key, value in self.shape.entries(node, "calls", "'Node: number' for each"):
            self.known(key)
            try:
                found[key.text] = literal(value, int)
            except LiteralError as error:
                self.findings.error(error.where, "value", error.message, error.hint)
        return found

    def limit(self, node: YamlNode | None) -> float:
        if node is None:
            return LIMIT
        try:
            return float(literal(node, TIME))
        except LiteralError as error:
            self.findings.error(error.where, "value", error.message, error.hint)
            return LIMIT
