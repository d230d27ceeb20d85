"""`pomona schema`: the JSON Schema of tree files, from the installed skills; editors complete and check with it."""

from __future__ import annotations

import argparse
from typing import Any

from executive.language.documents import with_declarations
from executive.language.schema import schema
from executive.terminal.filtered import write_json


def add(subparsers: Any) -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser("schema", help="print the JSON Schema of tree files, for editors")
    parser.set_defaults(main=main)


def main(_options: argparse.Namespace) -> int:
    """Print it.

    Returns:
        the exit status.
    """
    write_json(with_declarations(schema), indent=2)
    return 0
