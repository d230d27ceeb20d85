"""`pomona fmt`: tree files, cells and other YAML written in one way; comments and columns stay."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from pomona.executive.errors import UsageError
from pomona.executive.files import read_text
from pomona.executive.nodes.catalogue import NodeTypes
from pomona.executive.values.findings import Findings, Source, format_findings
from pomona.executive.values.yaml_nodes import read_yaml
from pomona.tools.editor.format import FormatError, formatted


def add(subparsers: Any) -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser("fmt", help="format YAML files; comments stay")
    parser.add_argument(
        "files",
        nargs="+",
        type=Path,
        metavar="FILE",
        help="YAML files; - reads and writes the streams",
    )
    parser.add_argument(
        "--check",
        action="store_true",
        help="change nothing; exit with 1 when something would be changed",
    )
    parser.set_defaults(main=main)


def main(options: argparse.Namespace) -> int:
    """Format them.

    Returns:
        1 when `--check` finds something to change, else 0.
    """
    if options.files == [Path("-")]:
        sys.stdout.write(_formatted("standard input", sys.stdin.read()))
        return 0
    texts = {path: read_text(path) for path in options.files}
    found = {path: _formatted(str(path), text) for path, text in texts.items()}
    changed = [path for path in texts if found[path] != texts[path]]
    for path in changed:
        if not options.check:
            path.write_text(found[path], encoding="utf-8")
        sys.stdout.write(f"{path} {'would be' if options.check else 'is'} formatted\n")
    return 1 if changed and options.check else 0


def _formatted(path: str, text: str) -> str:
    try:
        return formatted(text)
    except FormatError as error:
        findings = Findings()
        read_yaml(Source(path, text), findings, "this file", NodeTypes.installed().beside)
        reason = format_findings(findings.sorted()) or f"{path}: {error}."
        raise UsageError(f"{reason} Nothing was changed.") from error
