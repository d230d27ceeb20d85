"""Check of everything that a run needs, before any connection: tree, cell, and the requirements of skills."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pomona.executive.cell.cell_file import CellFile, judge_cell_file, outline_cell
from pomona.executive.errors import UsageError
from pomona.executive.language.check import Analysis, analyse
from pomona.executive.language.expression import Reference
from pomona.executive.language.model import Definition, Document, TreeNode
from pomona.executive.language.scope import ComputedValue, Given, Value
from pomona.executive.lease import BLOCKED, commands_of
from pomona.executive.ports import Ports
from pomona.executive.registry import Registry
from pomona.executive.skill import Skill
from pomona.executive.values.documents import set_scalar
from pomona.executive.values.findings import (
    Finding,
    Findings,
    Located,
    TreeFileError,
    did_you_mean,
    format_findings,
)
from pomona.executive.values.sections import Problem
from pomona.executive.values.yaml_nodes import YamlScalar

UNDECLARED = (
    "write `success: held` or `success: put_away`; unmeasured it ends with status 4, since 0.2"
)


@dataclass(frozen=True, slots=True)
class Known:
    """A value that an input has in every run, and where it is written (the node, for a default)."""

    value: Any
    where: Located


@dataclass(frozen=True, slots=True)
class Use:
    """One skill in the tree, as one call of its subtree gives it its inputs."""

    node: TreeNode
    skill: type[Skill]
    known: Mapping[str, Known]


def uses_of_skills(analysis: Analysis) -> Iterator[Use]:
    """Yield every skill of the main tree and of the subtrees that it calls, once for each call.

    Errors in other parts of the tree do not matter, unless the tree has no end. Unreadable inputs are unknown.
    """
    main = analysis.document.main.main
    if main is not None and analysis.finite:
        yield from _uses(analysis, main, {})


def _uses(analysis: Analysis, definition: Definition, names: Mapping[str, Known]) -> Iterator[Use]:
    for node in definition.root.walk() if definition.root is not None else ():
        found = analysis.resolved.get((id(node), node.type.key))
        if found is None:
            continue
        if found.skill is not None:
            ports = found.skill.inputs
        elif found.subtree is not None:
            ports = Ports(**analysis.interfaces[id(found.subtree)].inputs)
        else:
            continue
        given = {n: _known(value, names) for n, value in found.inputs.items() if n in ports}
        known = {n: v for n, v in given.items() if v is not None and ports[n].accepts(v.value)}
        defaults = {
            n: Known(port.default_value, node.key)
            for n, port in ports.items()
            if n not in node.ports
        }
        if found.skill is not None:
            yield Use(node, found.skill, {**defaults, **known})
        elif found.subtree is not None:
            yield from _uses(analysis, found.subtree, {**defaults, **known})


def _known(value: Value, names: Mapping[str, Known]) -> Known | None:
    if isinstance(value, Given):
        return Known(value.value, value.where)
    if isinstance(value, ComputedValue) and isinstance(value.expression, Reference):
        found = names.get(value.expression.name)
        return None if found is None else Known(found.value, value.where)
    return None


@dataclass(frozen=True, slots=True)
class Judged:
    """Result of the check: the cell's file if it has no errors, all findings, and the resolved tree."""

    cell: CellFile | None
    findings: Findings
    analysis: Analysis

    def refuse_errors(self) -> None:
        """Raise when something is wrong. Raises UsageError: with every finding."""
        if self.findings.errors:
            findings = self.findings.sorted()
            raise UsageError(f"{format_findings(findings)} Nothing was run.") from TreeFileError(
                findings
            )


def judge(
    document: Document,
    registry: Registry,
    settings: Mapping[str, str | YamlScalar],
    cell: Path | None,
    texts: Mapping[str, str] | None = None,
) -> Judged:
    """Check a tree, and the cell on which it shall run.

    Args:
        settings: parameters of the tree; names that it does not declare are options of the cell.
        cell: its file, or None to check a tree alone.
        texts: contents of files, by path, that are not to be read from the disk.
    """
    findings = Findings()
    file = None
    interfaces = None
    for_tree, for_cell = split_settings(document, settings)
    if cell is not None:
        _name_unknown(document, cell, for_cell, findings)
        file = judge_cell_file(cell, findings, for_cell, texts or {})
        interfaces = None if file is None else file.interfaces()
    overrides = (
        for_tree if cell is not None else {key: _text(value) for key, value in settings.items()}
    )
    analysis = analyse(document, registry, overrides=overrides, interfaces=interfaces)
    findings.extend(_placed(found, settings) for found in analysis.findings)
    said: dict[tuple[type[Skill], str], list[Problem]] = {}
    uses = list(uses_of_skills(analysis))
    watched = any(BLOCKED in use.skill.failures for use in uses)
    for use in uses:
        known = {name: value.value for name, value in use.known.items()}
        alike = use.skill, repr(known)
        if alike not in said:
            said[alike] = list(use.skill.judge(known, file))
        for problem in said[alike]:
            where: Located = (
                use.known[problem.key].where if problem.key in use.known else use.node.key
            )
            where = problem.where or where
            report = findings.warning if problem.warning else findings.error
            report(where, "unfit", f"{use.node.label}: {problem.message}", problem.hint)
        moves = [one.__name__ for one in use.skill.claims() if commands_of(one, "__is_motion__")]
        if watched and moves and BLOCKED not in use.skill.failures:
            words = f"{use.node.label}: moves the {moves[0]} unwatched: once a person was noticed the run refuses it"
            findings.warning(use.node.key, "unwatched", words, "move it by `MovingSkill.travel`")
        if use.skill.measures and document.main.success is None:
            words = f"{use.node.label}: measures a success, and the tree declares none: its end counts as one"
            findings.warning(use.node.key, "no-success", words, UNDECLARED)
    return Judged(file, findings, analysis)


def split_settings(
    document: Document, settings: Mapping[str, str | YamlScalar]
) -> tuple[dict[str, str], dict[str, str | YamlScalar]]:
    """Return settings of the tree's parameters, and the others: options of the cell."""
    declared = document.main.parameters
    for_tree = {key: _text(value) for key, value in settings.items() if key in declared}
    return for_tree, {key: value for key, value in settings.items() if key not in declared}


def _name_unknown(
    document: Document, cell: Path, for_cell: dict[str, str | YamlScalar], findings: Findings
) -> None:
    """Remove settings that neither the tree nor the cell declares, with a finding for each."""
    outline = outline_cell(cell, Findings())
    options = [option.name for option in outline.options] if outline is not None else list(for_cell)
    known = [*document.main.parameters, *options]
    for name in [name for name in for_cell if name not in options]:
        given = for_cell.pop(name)
        where = given if isinstance(given, YamlScalar) else set_scalar(name, given)
        message = f"neither the tree '{document.main.name}' nor the cell '{cell.stem}' has a setting '{name}'"
        hint = did_you_mean(name, known) or f"known: {', '.join(sorted(known)) or 'none'}"
        findings.error(where, "unknown-setting", message, hint)


def _placed(found: Finding, settings: Mapping[str, str | YamlScalar]) -> Finding:
    """Return a finding about a setting, at the place where it is written in a file."""
    name = found.path.removeprefix("--set ").partition("=")[0]
    where = settings.get(name) if found.path.startswith("--set ") else None
    if not isinstance(where, YamlScalar):
        return found
    place = Findings()
    place.error(where, found.code, found.message, found.hint)
    return place.sorted()[0]


def _text(value: str | YamlScalar) -> str:
    return value.text if isinstance(value, YamlScalar) else value
