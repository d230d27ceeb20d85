"""Scenario files: a tree, mocks, answers, and the expected events.

pomona: 1
tree: pick_apple.yaml
mocks: {Refine: {after: 200 ms}}                 # for every case
cases:
  - name: the second plan is tried when there is no path
    set: {attempts: 2}
    mocks: {Plan: [NO_PATH]}
    answers: {Is it ripe: [no, yes]}             # of nodes that ask; the last one stays
    expect: failure                              # or {status: failure, code: NO_PATH, node: Attempt/Plan}
    visits: [Plan closer and longer]
    never: [Lift]
    calls: {Plan: 2}
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from pomona.executive.files import read_text
from pomona.executive.language.mocks import (
    MockedSkills,
    MockPlan,
    MocksReader,
    OneOrSeveral,
    Results,
    Tested,
    root_of,
)
from pomona.executive.language.model import Document
from pomona.executive.language.read import read, read_file
from pomona.executive.ports import TIME
from pomona.executive.registry import Registry
from pomona.executive.values.findings import Finding, Findings, few_hints
from pomona.executive.values.installation import installed_trees
from pomona.executive.values.kinds import AsWritten, Kind, ListOf, Measure, Schema, Text, Whole
from pomona.executive.values.plain_text import is_file
from pomona.executive.values.removed import report_removed
from pomona.executive.values.sections import Placed, Section, value
from pomona.executive.values.yaml_nodes import Reader, Refused, YamlMapping, YamlNode, YamlScalar
from pomona.tools.scenarios.scenario_kinds import (
    Answers,
    ByNode,
    End,
    Expected,
    NodeName,
    ParameterValues,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class CaseSection:
    """One run of the tree and its expected end."""

    name: str = value(Text(), "", "purpose of the case; its number if omitted")
    mocks: Results = value(MockedSkills(), {}, "how skills end; overrides the mocks of all cases")
    set: Mapping[str, YamlScalar] = value(ParameterValues(), {}, "parameters of the tree")
    answers: Mapping[str, tuple[str, ...]] = value(
        Answers(), {}, "by question; the others get no answer"
    )
    expect: Expected = value(
        End(), Expected(status="success"), "how the tree ends: success if omitted"
    )
    visits: tuple[str, ...] = value(OneOrSeveral(NodeName()), (), "nodes that are reached")
    never: tuple[str, ...] = value(OneOrSeveral(NodeName()), (), "nodes that are not")
    calls: Mapping[str, int] = value(ByNode(Whole(0)), {}, "how often nodes start")
    limit: float = value(
        Measure(TIME, "0 s"), "600 s", "on the simulated clock, after which the case is given up"
    )


class PlacedCase(Kind[Placed[CaseSection]]):
    """A case that knows where it stands."""

    of = Section(CaseSection)
    words = of.words

    def read(self, node: YamlNode, reader: Reader) -> Placed[CaseSection]:
        return self.of.read_placed(node, reader)

    def schema(self, options: bool = False) -> Schema:
        return self.of.schema()


class ScenarioCases(ListOf[Placed[CaseSection]]):
    """The cases; without one, a scenario would pass and test nothing."""

    def read(self, node: YamlNode, reader: Reader) -> tuple[Placed[CaseSection], ...]:
        """Return them. Raises Refused: there is none."""
        cases = super().read(node, reader)
        if not cases:
            raise reader.refuse(
                node, "a scenario needs at least one case: write '- name: …'", code="shape"
            )
        return cases

    def schema(self, options: bool = False) -> Schema:
        """Return a list's schema, with its least length."""
        return super().schema(options) | {"minItems": 1}


@dataclass(frozen=True, slots=True, kw_only=True)
class ScenarioSection:
    """A tree's logic, tested without any cell."""

    pomona: str = value(Text("1"), "1", "version of the language")
    tree: YamlScalar = value(
        AsWritten(), help="a tree file beside this one, or the name of an installed one"
    )
    description: str = value(Text(), "", "description for readers")
    mocks: Results = value(
        MockedSkills(), {}, "how skills end in every case; the others succeed at once"
    )
    set: Mapping[str, YamlScalar] = value(
        ParameterValues(), {}, "parameters of the tree in every case"
    )
    cases: tuple[Placed[CaseSection], ...] = value(
        ScenarioCases(PlacedCase()), help="write 'cases:' and '- name: …'"
    )


SCENARIO = Section(ScenarioSection)


@dataclass(frozen=True, slots=True)
class ScenarioCase:
    """One run of the tree and its expected end."""

    name: str
    line: int
    mocks: MockPlan
    settings: Mapping[str, str] = field(default_factory=dict)
    answers: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    expect: Expected = field(default_factory=Expected)
    visits: tuple[str, ...] = ()
    never: tuple[str, ...] = ()
    calls: Mapping[str, int] = field(default_factory=dict)
    limit: float = 600.0


@dataclass(frozen=True, slots=True)
class Scenario:
    """A scenario file: the tree's document, its cases, and its findings."""

    path: str
    document: Document | None
    cases: tuple[ScenarioCase, ...]
    findings: tuple[Finding, ...]


def is_scenario(text: str) -> bool:
    """Return True if a file's text looks like a scenario and not like a tree."""
    lines = text.splitlines()
    return any(line.startswith("cases:") for line in lines) and not any(
        line.startswith("root:") for line in lines
    )


@few_hints()
def read_scenario(
    text: str,
    path: str | Path,
    skills: Registry,
    *,
    tree_folders: Sequence[Path] = (),
    texts: Mapping[Path, str] | None = None,
) -> Scenario:
    """Read a scenario and the tree that it tests. Raises nothing: the findings hold the errors.

    Args:
        texts: a tree's text by its resolved path, instead of that on the disk.
    """
    findings = Findings()
    document = None
    cases = tuple[ScenarioCase, ...]()
    root = root_of(text, path, findings, "a scenario file")
    if root is not None:
        document = _tree(root, Path(path), tree_folders, findings, texts or {})
        tested = Tested.of(document, skills) if document is not None else None
        try:
            said = SCENARIO.read(root, MocksReader(findings, tree=tested))
            cases = tuple(
                _case(said, placed, number) for number, placed in enumerate(said.cases, start=1)
            )
        except Refused:
            pass
    return Scenario(str(path), document, cases, tuple(findings.sorted()))


def _tree(
    root: YamlMapping,
    path: Path,
    tree_folders: Sequence[Path],
    findings: Findings,
    texts: Mapping[Path, str],
) -> Document | None:
    written = root.get("tree")
    if not isinstance(written, YamlScalar) or written.is_null:
        return None
    for base in (path.parent, *tree_folders):
        if is_file(base / written.text):
            tree = base / written.text
            unsaved = texts.get(tree.resolve()) if texts else None
            if unsaved is not None:
                return read(unsaved, tree, tree_folders=tree_folders)
            return read_file(tree, tree_folders=tree_folders)
    if not report_removed(findings, written, "tree", Path(written.text).stem):
        message = f"there is no tree '{written.text}' beside the scenario"
        findings.error(written, "file", message)
    return None


def _case(said: ScenarioSection, placed: Placed[CaseSection], number: int) -> ScenarioCase:
    own = placed.values
    settings = {name: given.text for name, given in {**said.set, **own.set}.items()}
    expect = replace(own.expect, status=own.expect.status or "failure")
    plan = MockPlan({**said.mocks, **own.mocks})
    return ScenarioCase(
        own.name or f"case {number}",
        placed.node.line,
        plan,
        settings,
        own.answers,
        expect,
        own.visits,
        own.never,
        own.calls,
        own.limit,
    )


class ScenarioKind:
    """Scenario files, for `pomona check` and `pomona schema`."""

    def recognises(self, keys: Collection[str]) -> bool:
        """Return True if a file with these keys at its top is one."""
        return "cases" in keys and "root" not in keys

    def check(self, path: Path, findings: Findings) -> None:
        """Everything that is wrong with a file."""
        skills = Registry.installed()
        folders = [installed_trees()]
        findings.extend(read_scenario(read_text(path), path, skills, tree_folders=folders).findings)

    def schema(self) -> Schema:
        """Return the JSON Schema of scenario files."""
        return {"title": "Pomona scenario file", **SCENARIO.schema()}


SCENARIO_FILES = ScenarioKind()
