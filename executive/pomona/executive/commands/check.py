"""`pomona check`: everything that is wrong with files, before anything runs."""

from __future__ import annotations

import argparse
import dataclasses
import re
import sys
from pathlib import Path
from typing import Any

from pomona.executive.file_kinds import FileKind, file_kind, kind_names
from pomona.executive.files import find_cell, find_tree, read_text
from pomona.executive.judging import judge
from pomona.executive.language.documents import read_document, with_declarations
from pomona.executive.registry import Registry
from pomona.executive.settings import parse_settings
from pomona.executive.terminal.filtered import write_json
from pomona.executive.values.findings import Finding, Findings, Source, format_findings
from pomona.executive.values.yaml_nodes import YamlMapping, read_yaml

_ROOT = re.compile(r"^root\s*:", re.MULTILINE)


def add(subparsers: Any) -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser(
        "check", help="find everything that is wrong with trees, scenarios, cells, campaigns"
    )
    about = "a tree, a scenario, a cell, a campaign … or the name of an installed tree"
    parser.add_argument("files", nargs="+", metavar="FILE", help=about)
    parser.add_argument("--cell", help="also check that trees can run on this cell: its devices and what it names")
    about = "a parameter of the tree, or an option of the cell"
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help=about)
    parser.add_argument("--json", action="store_true", help="print the findings as JSON, for editors")
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
        found += _check(find_tree(name), cell, settings)
    if options.json:
        write_json([dataclasses.asdict(finding) for finding in found])
    elif found:
        sys.stdout.write(format_findings(found) + "\n")
    else:
        sys.stdout.write(f"{len(options.files)} file{'s' if len(options.files) > 1 else ''}: nothing is wrong\n")
    return 2 if any(finding.severity == "error" for finding in found) else 0


def _kind(path: Path) -> FileKind | None:
    """What a file is, if it is no tree. A tree is known by its `root`, so that large ones are read once."""
    text = read_text(path)
    if _ROOT.search(text):
        return None
    root = read_yaml(Source(str(path), text), Findings())
    keys = tuple(root.entries) if isinstance(root, YamlMapping) else ()
    kinds = () if "root" in keys else map(file_kind, kind_names())
    return next((kind for kind in kinds if kind.recognises(keys)), None)


def _check(path: Path, cell: Path | None, settings: dict[str, str]) -> list[Finding]:
    """What is wrong with a file; one of which cannot be told what it is, is taken for a tree."""
    kind = _kind(path)
    if kind is None:
        document = read_document(path)
        if cell is not None:
            return judge(document, Registry.installed(), settings, cell).findings.sorted()
        return with_declarations(lambda registry: judge(document, registry, settings, None).findings.sorted())
    findings = Findings()
    kind.check(path, findings)
    return findings.sorted()
