"""`pomona lsp`: a language server for editors, over standard input and output."""

from __future__ import annotations

import argparse
from typing import Any

from pomona.executive.files import find_cell
from pomona.executive.values.installation import need


def add(subparsers: Any) -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser("lsp", help="language server; started by editors")
    parser.add_argument("--cell", help="complete and check the names that this cell knows")
    parser.set_defaults(main=main)


def main(options: argparse.Namespace) -> int:
    """Serve until the editor ends the session."""
    need("pygls", "lsp", "pomona lsp")
    from pomona.tools.editor.server import serve

    serve(find_cell(options.cell) if options.cell else None).start_io()
    return 0
