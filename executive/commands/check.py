"""`pomona check`: everything that is wrong with tree files, before anything runs."""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import sys
from collections.abc import Mapping
from typing import Any

from executive.files import find_cell, find_tree
from executive.language.check import check
from executive.language.documents import read_document, with_declarations
from executive.registry import Registry
from executive.settings import parse_settings
from executive.terminal.filtered import write_json
from executive.values.findings import Finding, format_findings


def add(subparsers: Any) -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser("check", help="find everything that is wrong with tree files")
    parser.add_argument("trees", nargs="+", metavar="TREE", help="a tree file, or the name of an installed tree")
    parser.add_argument("--cell", help="also check that this cell has the devices")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="a parameter of the tree")
    parser.add_argument("--json", action="store_true", help="print the findings as JSON, for editors")
    parser.set_defaults(main=main)


def main(options: argparse.Namespace) -> int:
    """Check them.

    Returns:
        2 when there are errors, else 0.
    """
    settings = parse_settings(options.set)
    if options.cell:
        findings = _on_cell(options, settings)
    else:
        findings = with_declarations(lambda registry: _check(options, settings, registry))
    if options.json:
        write_json([dataclasses.asdict(finding) for finding in findings])
    elif findings:
        sys.stdout.write(format_findings(findings) + "\n")
    else:
        sys.stdout.write(f"{len(options.trees)} file{'s' if len(options.trees) > 1 else ''}: nothing is wrong\n")
    return 2 if any(finding.severity == "error" for finding in findings) else 0


def _check(
    options: argparse.Namespace,
    settings: Mapping[str, str],
    registry: Registry,
    interfaces: tuple[type, ...] | None = None,
) -> list[Finding]:
    findings: list[Finding] = []
    for name in options.trees:
        document = read_document(find_tree(name))
        findings += check(document, registry, overrides=settings, interfaces=interfaces)
    return findings


def _on_cell(options: argparse.Namespace, settings: Mapping[str, str]) -> list[Finding]:
    """With the devices of a cell, which has to be connected to know them."""
    from executive.execute import load_cell  # imports all that a run needs

    with contextlib.closing(load_cell(find_cell(options.cell), 0, {})) as cell:
        interfaces = cell.interfaces()
    return _check(options, settings, Registry.installed(), interfaces)
