"""A campaign, planned from its file: which run, with which tree, cell, settings and seed; judged before the first."""

from __future__ import annotations

import hashlib
import itertools
import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from pomona.executive.cell.cell_file import CellFile, outline_cell
from pomona.executive.cell.services import Score
from pomona.executive.errors import UsageError
from pomona.executive.execute import RunOrder
from pomona.executive.files import default_name, find_cell, find_tree, read_text
from pomona.executive.judging import judge
from pomona.executive.language.check import read_document, usual_cell
from pomona.executive.language.model import Document
from pomona.executive.registry import Registry
from pomona.executive.values.documents import read_value_file, with_includes
from pomona.executive.values.findings import Findings, did_you_mean, few_hints, format_findings
from pomona.executive.values.kinds import Schema
from pomona.executive.values.plain_text import is_file
from pomona.executive.values.removed import report_removed
from pomona.executive.values.sections import Placed
from pomona.executive.values.yaml_nodes import Refused, YamlMapping, YamlNode, YamlScalar
from pomona.tools.library.campaign.file import CAMPAIGN, MAX_SEEDS, CampaignSection, keys_of

MAX_RUNS = 100_000
MAX_JUDGED = 1000  # values of `vary`, each for every arm: each is checked with tree and cell before the first run


@dataclass(frozen=True, slots=True)
class CampaignRun:
    """One run of a campaign."""

    name: str  # stable when the campaign is planned again
    arm: str  # arm, varied: its arm, and its values of the varied settings
    varied: Mapping[str, str]
    number: int  # of its seed within its combination, from 0
    order: RunOrder  # for `execute`
    fingerprint: str  # of tree, cell, seed and settings; a result belongs to this run only if its fingerprint is equal


@dataclass(frozen=True, slots=True)
class Campaign:
    """A campaign, planned: every run in its order, all combinations of a seed before the next seed."""

    name: str
    description: str
    vary: Mapping[str, tuple[str, ...]]
    arms: tuple[str, ...]
    runs: tuple[CampaignRun, ...]
    score: Score = field(default_factory=Score)

    def only(self, runs: Sequence[CampaignRun]) -> Campaign:
        """Return the same campaign with some of its runs."""
        return Campaign(self.name, self.description, self.vary, self.arms, tuple(runs), self.score)


@dataclass(frozen=True, slots=True)
class _Arm:
    name: str
    tree: Path
    cell: Path
    settings: Mapping[str, YamlScalar]
    seeds: int | tuple[int, ...]
    only: Mapping[str, tuple[str, ...]]

    def seed(self, number: int, combination: int) -> int | None:
        """Return the seed of a combination's run, or None beyond the last one."""
        if isinstance(self.seeds, int):
            return combination * MAX_SEEDS + number if number < self.seeds else None
        return self.seeds[number] if number < len(self.seeds) else None

    @property
    def count(self) -> int:
        return self.seeds if isinstance(self.seeds, int) else len(self.seeds)

    def takes(self, varied: Mapping[str, str]) -> bool:
        return all(varied[key] in values for key, values in self.only.items())


def read_campaign(path: Path) -> Campaign:
    """Read, plan and check a campaign file. Raises UsageError: lists all mistakes with line and column."""
    findings = Findings()
    campaign = judge_campaign(path, findings)
    if findings.errors or campaign is None:
        raise UsageError(f"{format_findings(findings.sorted())} Nothing was run.")
    return campaign


@few_hints()
def judge_campaign(path: Path, findings: Findings) -> Campaign | None:
    """As `read_campaign`; everything that is wrong goes to `findings`."""
    written = read_value_file(path, findings, "a campaign file")
    if written is None:
        return None
    names = _Names(path, findings)
    try:
        placed = CAMPAIGN.read_placed(written.root, written.reader)
    except Refused:
        names.check(
            written.root
        )  # beside a value that cannot be used, wrong names are reported in the same pass
        return None
    return _Planner(names, findings, placed).campaign()


@dataclass(slots=True)
class _Names:
    """Trees and cells that a campaign names, and the settings that they have."""

    path: Path
    findings: Findings
    documents: dict[Path, Document] = field(default_factory=dict)
    options: dict[Path, frozenset[str]] = field(default_factory=dict)

    def check(self, root: YamlNode) -> None:
        """Report a tree and a cell that do not exist, and settings that they do not have."""
        if not isinstance(root, YamlMapping):
            return
        tree, cell = (
            node if isinstance(node := root.get(name), YamlScalar) else None
            for name in ("tree", "cell")
        )
        if tree is not None and (pair := self.pair(tree, cell, root)):
            for name in ("set", "vary"):
                self.check_keys(*pair, keys_of(root, name))

    def file(
        self,
        written: YamlScalar | None,
        find: Callable[[str], Path],
        node: YamlNode,
        default: str = "",
    ) -> Path | None:
        """Return a tree or cell: beside the campaign file, by path, or by name; None with a finding without one."""
        name = default if written is None else written.text
        beside = self.path.parent / name
        if is_file(beside):
            return beside
        try:
            return find(name)
        except UsageError as error:
            kind = "tree" if find is find_tree else "cell"
            if not report_removed(self.findings, written or node, kind, Path(name).stem):
                self.findings.error(written or node, "file", str(error))
            return None

    def pair(
        self, tree: YamlScalar, cell: YamlScalar | None, node: YamlNode
    ) -> tuple[Path, Path] | None:
        """Return the tree and the cell, by default the tree's; None with a finding without one."""
        found = self.file(tree, find_tree, node)
        usual = default_name("cell") if found is None else str(usual_cell(self.document(found)))
        where = self.file(cell, find_cell, node, usual)
        return None if found is None or where is None else (found, where)

    def check_keys(self, tree: Path, cell: Path, keys: Mapping[str, YamlScalar]) -> None:
        """Every key must be a parameter of the tree or an option of the cell."""
        known = self.known(tree, cell)
        for name, key in keys.items():
            if name not in known:
                hint = did_you_mean(name, known) or f"known: {', '.join(sorted(known))}"
                message = f"neither the tree '{tree.stem}' nor the cell '{cell.stem}' has a setting '{name}'"
                self.findings.error(key, "unknown-setting", message, hint)

    def known(self, tree: Path, cell: Path) -> frozenset[str]:
        return frozenset(self.document(tree).main.parameters) | self.options_of(cell)

    def document(self, tree: Path) -> Document:
        if tree not in self.documents:
            self.documents[tree] = read_document(tree)
        return self.documents[tree]

    def options_of(self, cell: Path) -> frozenset[str]:
        if cell not in self.options:
            outline = outline_cell(cell, self.findings)
            self.options[cell] = (
                frozenset(option.name for option in outline.options) if outline else frozenset()
            )
        return self.options[cell]


@dataclass(slots=True)
class _Planner:
    names: _Names
    findings: Findings
    placed: Placed[CampaignSection]
    cells: dict[Path, CellFile] = field(default_factory=dict)

    def campaign(self) -> Campaign | None:
        said = self.placed.values
        node = self.placed.node
        pair = self.names.pair(said.tree, said.cell, node)
        if pair is None:
            return None
        tree, cell = pair
        whole = _Arm("all", tree, cell, said.set, said.seeds, {})
        vary = {key: tuple(value.text for value in values) for key, values in said.vary.items()}
        arms = self.arms(whole) or [whole]
        for arm in (whole, *arms):
            self.names.check_keys(arm.tree, arm.cell, keys_of(node, "set"))
        alone = all(arm.tree == tree and arm.cell == cell for arm in arms)
        if alone:
            self.names.check_keys(tree, cell, keys_of(node, "vary"))
        if not self.has_size(arms, vary):
            return None
        good = [self.judge(arm) for arm in arms]  # all of them, for all findings
        if self.findings.errors or not all(good):
            return None
        texts = {path: read_text(path) for arm in arms for path in (arm.tree, arm.cell)}
        texts |= {path: "".join(file.files.values()) for path, file in self.cells.items()}
        runs = tuple(_plan(arms, vary, texts))
        score = said.score.over(self.cells[arms[0].cell].score)
        return Campaign(
            said.campaign, said.description, vary, tuple(arm.name for arm in arms), runs, score
        )

    def has_size(self, arms: Sequence[_Arm], vary: Mapping[str, tuple[str, ...]]) -> bool:
        """Report more runs than a campaign has, or more values than are judged, before either is listed."""
        combinations = math.prod(map(len, vary.values()))
        runs = sum(
            arm.count * math.prod(len(arm.only.get(key, values)) for key, values in vary.items())
            for arm in arms
        )
        judged = len(arms) * max(1, sum(map(len, vary.values())))
        message = ""
        if runs > MAX_RUNS:
            message = f"{runs} runs; a campaign has at most {MAX_RUNS}"
        elif combinations > MAX_RUNS:
            message = f"'vary' has {combinations} combinations; a campaign has at most {MAX_RUNS}"
        elif judged > MAX_JUDGED:
            message = f"{judged} settings to check, each value of 'vary' for each arm; at most {MAX_JUDGED} are checked"
        if message:
            self.findings.error(
                self.placed.node, "too-many", message, "make several campaigns of it"
            )
        return not message

    def arms(self, whole: _Arm) -> list[_Arm]:
        written = self.placed.node.get("arms")
        arms = []
        for name, said in self.placed.values.arms.items():
            tree = self.names.file(said.tree, find_tree, self.placed.node, str(whole.tree))
            cell = self.names.file(said.cell, find_cell, self.placed.node, str(whole.cell))
            if tree is None or cell is None:
                continue
            seeds = whole.seeds if said.seeds is None else said.seeds
            only = {key: tuple(value.text for value in values) for key, values in said.only.items()}
            arm = _Arm(name, tree, cell, {**whole.settings, **said.set}, seeds, only)
            node = written.get(name) if isinstance(written, YamlMapping) else None
            if isinstance(node, YamlMapping):
                self.names.check_keys(tree, cell, keys_of(node, "set"))
                self.check_only(said.only, keys_of(node, "only"))
            arms.append(arm)
        return arms

    def check_only(
        self, only: Mapping[str, tuple[YamlScalar, ...]], keys: Mapping[str, YamlScalar]
    ) -> None:
        vary = {
            key: [value.text for value in values] for key, values in self.placed.values.vary.items()
        }
        for name, values in only.items():
            given = vary.get(name)
            if given is None:
                self.findings.error(
                    keys[name],
                    "unknown-key",
                    f"'vary' has no key '{name}'",
                    did_you_mean(name, vary),
                )
                continue
            for value in values:
                if value.text not in given:
                    hint = did_you_mean(value.text, given)
                    self.findings.error(
                        value,
                        "unknown-value",
                        f"'vary' gives '{name}' no value '{value.text}'",
                        hint,
                    )

    def judge(self, arm: _Arm) -> bool:
        """Yield each varied value with the first values of the others, as each run will be checked again.

        Unknown settings have a finding already and are left out.
        """
        known = self.names.known(arm.tree, arm.cell)
        skills = Registry.installed()
        vary = {
            key: [value for value in values if key not in arm.only or value.text in arm.only[key]]
            or [*values]
            for key, values in self.placed.values.vary.items()
            if key in known
        }
        good = True
        settings = {key: value for key, value in arm.settings.items() if key in known}
        first = settings | {key: values[0] for key, values in vary.items()}
        others = (first | {key: v} for key, values in vary.items() for v in values[1:])
        for settings in (first, *others):
            judged = judge(self.names.document(arm.tree), skills, settings, arm.cell)
            self.findings.extend(
                found for found in judged.findings.sorted() if found.severity == "error"
            )
            if judged.cell is None or judged.findings.errors:
                good = False
            else:
                self.cells[arm.cell] = judged.cell
        if good and self.cells[arm.cell].kind == "real":
            self.findings.error(
                self.placed.node,
                "real-cell",
                f"'{arm.cell.stem}' is a real cell: between runs an operator must acknowledge the safe state",
                "campaigns are for simulated and emulated cells",
            )
            return False
        return good


class CampaignKind:
    """Campaign files, for `pomona check` and `pomona schema`."""

    def recognises(self, keys: Collection[str]) -> bool:
        """Return True if a file with these keys at its top is one."""
        return "campaign" in keys

    def check(self, path: Path, findings: Findings) -> None:
        """Everything that is wrong with a file."""
        judge_campaign(path, findings)

    def schema(self) -> Schema:
        """Return the JSON Schema of campaign files."""
        return {"title": "Pomona campaign file", **with_includes(CAMPAIGN.schema())}


CAMPAIGN_FILES = CampaignKind()


def _plan(
    arms: Sequence[_Arm], vary: Mapping[str, tuple[str, ...]], texts: Mapping[Path, str]
) -> Iterator[CampaignRun]:
    """Seed by seed, so that a campaign that is stopped has as many runs of every combination."""
    combinations = list(itertools.product(*vary.values()))
    for number in range(max(arm.count for arm in arms)):
        for index, values in enumerate(combinations):
            varied = dict(zip(vary, values, strict=True))
            for arm in arms:
                seed = arm.seed(number, index)
                if seed is None or not arm.takes(varied):
                    continue
                settings = {key: value.text for key, value in arm.settings.items()}
                order = RunOrder(arm.tree, arm.cell, seed, {**settings, **varied})
                parts = (
                    texts[arm.tree],
                    texts[arm.cell],
                    str(seed),
                    repr(sorted(order.settings.items())),
                )
                fingerprint = hashlib.sha256("\0".join(parts).encode()).hexdigest()[:16]
                name = "/".join(
                    [arm.name, *(f"{key}={value}" for key, value in varied.items()), f"seed={seed}"]
                )
                yield CampaignRun(name, arm.name, varied, number, order, fingerprint)
