"""`pomona check`: everything that is wrong with files, before anything runs."""

from __future__ import annotations

import argparse
import dataclasses
import re
import sys
from pathlib import Path
from typing import Any

from pomona.executive.files import (
    FileKind,
    file_kind,
    find_cell,
    find_tree,
    kind_names,
    read_text,
)
from pomona.executive.judging import judge
from pomona.executive.language.check import read_document, usual_cell
from pomona.executive.language.interface import parse_settings
from pomona.executive.registry import Registry
from pomona.executive.terminal.output import write_json
from pomona.executive.values.findings import (
    Finding,
    Findings,
    Source,
    TreeFileError,
    format_findings,
    place_of,
    said,
)
from pomona.executive.values.yaml_nodes import YamlMapping, read_yaml
from pomona.tools.editor.replacing import write_edits

_ROOT = re.compile(r"^root\s*:", re.MULTILINE)


def add(subparsers: Any) -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser(
        "check", help="check trees, scenarios, cells and campaigns for errors"
    )
    about = "a tree, a scenario, a cell, a campaign … or the name of an installed tree"
    parser.add_argument("files", nargs="+", metavar="FILE", help=about)
    about = "check trees against this cell: its devices, and the poses and fruit that it has (default: the one of `run`)"
    parser.add_argument("--cell", help=about)
    about = "a parameter of the tree, or an option of the cell"
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help=about)
    about = "apply the hints that name a correction, and write the files"
    parser.add_argument("--fix", action="store_true", help=about)
    parser.add_argument(
        "--json", action="store_true", help="print the findings as JSON, for editors"
    )
    parser.set_defaults(main=main)


def main(options: argparse.Namespace) -> int:
    """Check them.

    Returns:
        2 when there are errors, else 0.
    """
    settings = parse_settings(options.set)
    cell = find_cell(options.cell) if options.cell else None
    found: list[Finding] = []
    for name in options.files:
        path = find_tree(name)
        found += _fix(path, cell, settings) if options.fix else check_file(path, cell, settings)
    found = list(dict.fromkeys(found))  # those of a cell that several trees name
    if options.json:
        write_json([dataclasses.asdict(finding) for finding in found])
        return 2 if any(finding.severity == "error" for finding in found) else 0
    if found:
        sys.stdout.write(format_findings(found) + "\n")
    if all(finding.severity == "note" for finding in found):
        sys.stdout.write(
            f"{len(options.files)} file{'s' if len(options.files) > 1 else ''}: nothing is wrong\n"
        )
    return 2 if any(finding.severity == "error" for finding in found) else 0


def _fix(path: Path, cell: Path | None, settings: dict[str, str]) -> list[Finding]:
    """Apply the hints that name a correction to a file; return the remaining findings."""
    found = check_file(path, cell, settings)
    for _ in range(20):  # times that a file is checked again: one mistake may hide the next
        applied = write_edits(path, found)
        if not applied:
            break
        for finding in applied:
            sys.stderr.write(f"{place_of(finding)}: mended: {said(finding)}\n")
        found = check_file(path, cell, settings)
    return found


def _kind(path: Path) -> FileKind | None:
    """Return the kind of a file other than a tree. Trees are recognized by `root`, so that large ones are read once."""
    text = read_text(path)
    if _ROOT.search(text):
        return None
    root = read_yaml(Source(str(path), text), Findings())
    keys = tuple(root.entries) if isinstance(root, YamlMapping) else ()
    kinds = () if "root" in keys else map(file_kind, kind_names())
    return next((kind for kind in kinds if kind.recognises(keys)), None)


def check_file(path: Path, cell: Path | None, settings: dict[str, str]) -> list[Finding]:
    """Return the findings of a file; a file of unknown kind is checked as a tree."""
    kind = _kind(path)
    if kind is None:
        document = read_document(path)
        skills = Registry.installed()
        try:
            usual = cell or usual_cell(document)
        except TreeFileError as error:
            return [*error.findings, *judge(document, skills, settings, None).findings.sorted()]
        found = judge(document, skills, settings, usual).findings.sorted()
        lacking = next((finding for finding in found if finding.code == "no-device"), None)
        if cell is not None or lacking is None:
            return found
        found = judge(document, skills, settings, None).findings.sorted()
        message = f"poses and fruit are not checked on the cell '{usual.stem}': {lacking.message}"
        return [
            *found,
            dataclasses.replace(
                lacking, severity="warning", message=message, hint="name another: --cell …"
            ),
        ]
    findings = Findings()
    kind.check(path, findings)
    return findings.sorted()
