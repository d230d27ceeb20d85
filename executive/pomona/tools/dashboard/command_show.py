"""`pomona show`: a tree drawn as text or SVG."""

from __future__ import annotations

import argparse
import shutil
from pathlib import Path
from typing import Any

from pomona.executive.errors import UsageError
from pomona.executive.files import find_tree, write_text
from pomona.executive.language.check import read_document
from pomona.executive.values.findings import format_findings
from pomona.tools.dashboard.drawing import show_svg, show_text


def add(subparsers: Any) -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser("show", help="draw a tree as text or SVG")
    parser.add_argument("tree", help="a tree file, or the name of an installed tree")
    parser.add_argument("--svg", type=Path, metavar="FILE", help="write an SVG instead")
    parser.set_defaults(main=main)


def main(options: argparse.Namespace) -> int:
    """Draw the tree."""
    document = read_document(find_tree(options.tree))
    errors = [finding for finding in document.findings if finding.severity == "error"]
    if document.main.main is None or errors:
        raise UsageError(format_findings(document.findings))
    if options.svg is None:
        write_text(show_text(document, width=shutil.get_terminal_size((120, 40)).columns), None)
    else:
        write_text(show_svg(document), options.svg, replaces="<svg")
    return 0
