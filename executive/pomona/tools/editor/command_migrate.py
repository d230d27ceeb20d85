"""`pomona migrate`: files of an earlier version with the words of this one; everything else stays byte for byte."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from pomona.executive.errors import UsageError
from pomona.executive.files import read_text
from pomona.executive.values.findings import (
    Finding,
    Findings,
    Source,
    format_findings,
    place_of,
)
from pomona.executive.values.yaml_nodes import read_yaml
from pomona.tools.editor.command_check import check_file
from pomona.tools.editor.old_names import report_old_names
from pomona.tools.editor.replacing import write_edits

NEW = ("removed", "no-success")
"""Codes of findings that a file of an earlier version has, and one of this version has not."""


def add(subparsers: Any) -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser(
        "migrate",
        help="change files of an earlier version to this one; comments stay",
        description="Write the new words of this version into trees, cells, campaigns, scenarios, Python files and "
        "pyproject.toml. A word without a new one, or with several, is listed: its place stays as it is. So is "
        "a tree that grips and declares no success.",
    )
    parser.add_argument("files", nargs="+", type=Path, metavar="FILE", help="the files to change")
    parser.add_argument("--check", action="store_true", help="show the changes, and write nothing")
    parser.set_defaults(main=main)


def main(options: argparse.Namespace) -> int:
    """Change them; nothing is written when one of them cannot be used.

    Returns:
        1 when something is left to change, else 0.
    """
    for path in options.files:
        _refuse_unusable(path, options.check)
    named = {path.resolve() for path in options.files}
    left = Findings()
    for path in options.files:
        found = _removed(path)
        while not options.check and _print_changes(write_edits(path, found)):
            found = _removed(path)
        left.extend(f for f in found if f.path == str(path) or Path(f.path).resolve() not in named)
    rest = left.sorted()
    if options.check:
        _print_changes(rest)
        rest = [finding for finding in rest if not finding.edits]
    sys.stdout.write(f"{format_findings(rest) or 'nothing else is left to change'}\n")
    return 1 if left.errors else 0


def _refuse_unusable(path: Path, check: bool) -> None:
    """Raises UsageError: the file cannot be read or written."""
    findings = Findings()
    text = read_text(path)
    if _is_yaml(path) and read_yaml(Source(str(path), text), findings, "a YAML file") is None:
        raise UsageError(f"{format_findings(findings.sorted())} Nothing was changed.")
    writable = path.stat().st_mode & 0o222 and os.access(path, os.W_OK)
    if not check and not (writable and os.access(path.resolve().parent, os.W_OK)):
        raise UsageError(f"{path}: the file or its folder is read-only. Nothing was changed.")


def _is_yaml(path: Path) -> bool:
    return path.suffix in (".yaml", ".yml")


def _removed(path: Path) -> list[Finding]:
    """Return the words in a file that this version no longer has."""
    if _is_yaml(path):
        return [finding for finding in check_file(path, None, {}) if finding.code in NEW]
    findings = Findings()
    report_old_names(findings, Source(str(path), read_text(path)))
    return findings.sorted()


def _print_changes(changed: Iterable[Finding]) -> bool:
    """Print the edits of findings; return False if there is none."""
    edits = [(finding, *edit) for finding in changed for edit in finding.edits]
    for finding, _, column, length, new in edits:
        old = finding.excerpt[column - 1 :][:length]
        sys.stdout.write(f"{place_of(finding)}: {old} → {new} ({finding.message})\n")
    return bool(edits)
