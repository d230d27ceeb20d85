"""A campaign file: which tree and cell, what varies, what is compared, what is scored, how often.

pomona: 1
campaign: paper
tree: pick_apple
cell: sim
seeds: 3                          # a count: each combination has seeds of its own, all arms the same; or a list: these
vary:                             # every combination; keys as for --set: parameters of the tree, options of the cell
  fruit: [apple_1, apple_2]
  place: [1, 2, 3]
set: {others: 0}                  # the same for every run
arms:                             # what is compared
  refined:   {}
  unrefined: {set: {refine: none}, seeds: 1, only: {fruit: [apple_2]}}
  the paper: {tree: pick_apple_paper}
score:
  success: [lifted]               # what the simulated world must say, beside the tree's success
  figures: [slip_mm]              # of the world's truth, in the report beside the usual ones
"""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import yaml

from executive.campaign.file_shape import CampaignShape
from executive.errors import UsageError
from executive.execute import RunOrder
from executive.files import find_cell, find_tree, read_text
from executive.language import format_findings
from executive.language.documents import read_document
from executive.values.findings import Findings, Source, did_you_mean
from executive.values.yaml_nodes import YamlMapping, YamlNode, YamlScalar, read_yaml

KEYS = ("pomona", "campaign", "description", "tree", "cell", "seeds", "vary", "set", "arms", "score")
ARM_KEYS = ("tree", "cell", "set", "seeds", "only")
SCORE_KEYS = ("success", "figures")
MAX_SEEDS = 1000
"""Most seeds of a combination: the next combination's begin after so many."""
MAX_RUNS = 100_000


@dataclass(frozen=True, slots=True)
class CampaignRun:
    """One run of a campaign.

    Attributes:
        name: the same whenever the campaign is planned again.
        arm, varied: what it compares, and the values of what varies.
        number: of its seed among those of its combination, from 0.
        order: for `execute`.
        fingerprint: of tree, cell, seed and settings; a result counts for this run only when it has the same.
    """

    name: str
    arm: str
    varied: Mapping[str, str]
    number: int
    order: RunOrder
    fingerprint: str


@dataclass(frozen=True, slots=True)
class Score:
    """What counts: names of the world's truth that must hold for a success, and figures for the report."""

    success: tuple[str, ...] = ("lifted",)
    figures: tuple[str, ...] = ()


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
        """The same campaign with some of its runs."""
        return Campaign(self.name, self.description, self.vary, self.arms, tuple(runs), self.score)


@dataclass(frozen=True, slots=True)
class _Arm:
    name: str
    tree: Path
    cell: Path
    settings: Mapping[str, str]
    seeds: int | tuple[int, ...]
    only: Mapping[str, tuple[str, ...]]

    def seed(self, number: int, combination: int) -> int | None:
        """The seed of a combination's run, or None when there are not so many."""
        if isinstance(self.seeds, int):
            return combination * MAX_SEEDS + number if number < self.seeds else None
        return self.seeds[number] if number < len(self.seeds) else None

    @property
    def count(self) -> int:
        return self.seeds if isinstance(self.seeds, int) else len(self.seeds)

    def takes(self, varied: Mapping[str, str]) -> bool:
        return all(varied[key] in values for key, values in self.only.items())


def read_campaign(path: Path) -> Campaign:
    """Read and plan a campaign file.

    Raises:
        UsageError: everything that is wrong, with line and column.
    """
    findings = Findings()
    campaign = _Reader(path, findings).read(Source(str(path), read_text(path)))
    if findings.errors or campaign is None:
        raise UsageError(f"{format_findings(findings.sorted())} Nothing was run.")
    return campaign


class _Reader:
    def __init__(self, path: Path, findings: Findings) -> None:
        self.path, self.findings, self.shape = path, findings, CampaignShape(findings)

    def read(self, source: Source) -> Campaign | None:
        root = read_yaml(source, self.findings)
        top = None if root is None else self.shape.mapping(root, "a campaign file")
        if top is None:
            return None
        self.shape.known_keys(top, KEYS, "a campaign file")
        name = self.shape.needed_word(top, "campaign")
        tree = self.file(top, "tree", self.shape.needed_word(top, "tree"))
        cell = self.file(top, "cell", self.shape.word(top.get("cell"), "sim"))
        seeds = self.shape.seeds(top.get("seeds"), 1, MAX_SEEDS)
        vary = self.shape.lists(top.get("vary"), "'vary'", "vary: {fruit: [apple_1, apple_2]}")
        if tree is None or cell is None:
            return None
        self.check_keys(top.get("vary"), tree, cell, among_arms=top.get("arms"))
        common = self.settings(top.get("set"), tree, cell)
        arms = self.arms(top.get("arms"), _Arm("all", tree, cell, common, seeds, {}), vary)
        score = self.score(top.get("score"))
        if self.findings.errors:
            return None
        runs = tuple(_plan(arms, vary))
        if len(runs) > MAX_RUNS:
            self.findings.error(top, "too-many", f"{len(runs)} runs; a campaign has at most {MAX_RUNS}")
        description = self.shape.word(top.get("description"), "")
        return Campaign(name, description, vary, tuple(arm.name for arm in arms), runs, score)

    def arms(self, node: YamlNode | None, default: _Arm, vary: Mapping[str, tuple[str, ...]]) -> list[_Arm]:
        arms = []
        for key, written in self.shape.entries(node, "'arms'", "arms: {refined: {}, unrefined: {set: {…}}}"):
            if isinstance(written, YamlScalar) and written.is_null:
                arms.append(_Arm(key.text, default.tree, default.cell, default.settings, default.seeds, {}))
                continue
            arm = self.shape.mapping(written, f"the arm '{key.text}'")
            if arm is None:
                continue
            self.shape.known_keys(arm, ARM_KEYS, "an arm")
            tree = self.file(arm, "tree", self.shape.word(arm.get("tree"), "")) or default.tree
            cell = self.file(arm, "cell", self.shape.word(arm.get("cell"), "")) or default.cell
            only = self.shape.lists(arm.get("only"), "'only'", "only: {fruit: [apple_1]}")
            self.check_only(arm.get("only"), vary)
            arms.append(
                _Arm(
                    key.text,
                    tree,
                    cell,
                    {**default.settings, **self.settings(arm.get("set"), tree, cell)},
                    self.shape.seeds(arm.get("seeds"), default.seeds, MAX_SEEDS),
                    only,
                )
            )
        return arms or [default]

    def settings(self, node: YamlNode | None, tree: Path, cell: Path) -> dict[str, str]:
        entries = self.shape.entries(node, "settings", "set: {others: 0}")
        self.check_keys(node, tree, cell)
        values = {key.text: self.shape.text(value) for key, value in entries}
        return {name: value.text for name, value in values.items() if value is not None}

    def score(self, node: YamlNode | None) -> Score:
        if node is None:
            return Score()
        mapping = self.shape.mapping(node, "'score'")
        if mapping is None:
            return Score()
        self.shape.known_keys(mapping, SCORE_KEYS, "'score'")
        success, figures = mapping.get("success"), mapping.get("figures")
        return Score(
            Score().success if success is None else self.shape.words(success, "'success'", allow_empty=True),
            () if figures is None else self.shape.words(figures, "'figures'", allow_empty=True),
        )

    def file(self, owner: YamlMapping, key: str, name: str) -> Path | None:
        """A tree or cell: beside the campaign file, by path, or by name from those installed."""
        if not name:
            return None
        beside = self.path.parent / name
        if beside.is_file():
            return beside
        try:
            return find_tree(name) if key == "tree" else find_cell(name)
        except UsageError as error:
            self.findings.error(owner.get(key) or owner, "file", str(error))
            return None

    def check_keys(self, node: YamlNode | None, tree: Path, cell: Path, among_arms: YamlNode | None = None) -> None:
        """Every key must be a parameter of the tree or an option of the cell."""
        if not isinstance(node, YamlMapping) or (among_arms is not None and _has_own_files(among_arms)):
            return
        known = _parameters(tree) | _options(cell)
        for key, _value in node.entries.values():
            if key.text not in known:
                hint = did_you_mean(key.text, known) or f"known: {', '.join(sorted(known))}"
                message = f"neither the tree '{tree.stem}' nor the cell '{cell.stem}' has a setting '{key.text}'"
                self.findings.error(key, "unknown-setting", message, hint)

    def check_only(self, node: YamlNode | None, vary: Mapping[str, tuple[str, ...]]) -> None:
        for key, value in self.shape.entries(node, "'only'", "only: {fruit: [apple_1]}"):
            if key.text not in vary:
                self.findings.error(key, "unknown-key", f"'{key.text}' does not vary", did_you_mean(key.text, vary))
                continue
            for word in self.shape.scalars(value):
                if word.text not in vary[key.text]:
                    hint = did_you_mean(word.text, vary[key.text])
                    self.findings.error(word, "unknown-value", f"'{key.text}' is never '{word.text}'", hint)


def _has_own_files(arms: YamlNode) -> bool:
    """Whether an arm has a tree or a cell of its own, which may know other settings."""
    mappings = [value for _key, value in arms.entries.values()] if isinstance(arms, YamlMapping) else []
    return any(isinstance(m, YamlMapping) and {"tree", "cell"} & set(m.entries) for m in mappings)


def _parameters(tree: Path) -> set[str]:
    return set(read_document(tree).main.parameters)


def _options(cell: Path) -> set[str]:
    content = yaml.safe_load(read_text(cell))
    return set(map(str, content.get("options") or ())) if isinstance(content, dict) else set()


def _plan(arms: Sequence[_Arm], vary: Mapping[str, tuple[str, ...]]) -> Iterator[CampaignRun]:
    """Seed by seed, so that a campaign that is stopped has as many runs of every combination."""
    texts = {path: read_text(path) for arm in arms for path in (arm.tree, arm.cell)}
    combinations = list(itertools.product(*vary.values()))
    for number in range(max(arm.count for arm in arms)):
        for index, values in enumerate(combinations):
            varied = dict(zip(vary, values, strict=True))
            for arm in arms:
                seed = arm.seed(number, index)
                if seed is None or not arm.takes(varied):
                    continue
                order = RunOrder(arm.tree, arm.cell, seed, {**arm.settings, **varied})
                parts = (texts[arm.tree], texts[arm.cell], str(seed), repr(sorted(order.settings.items())))
                fingerprint = hashlib.sha256("\0".join(parts).encode()).hexdigest()[:16]
                name = "/".join([arm.name, *(f"{key}={value}" for key, value in varied.items()), f"seed={seed}"])
                yield CampaignRun(name, arm.name, varied, number, order, fingerprint)
