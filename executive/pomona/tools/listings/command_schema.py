"""`pomona schema`: the JSON Schema of a kind of file; editors complete and check with it."""

from __future__ import annotations

import argparse
from typing import Any

from pomona.executive.files import file_kind, kind_names
from pomona.executive.registry import Registry
from pomona.executive.terminal.output import write_json
from pomona.tools.listings.schema import schema

TREE = "tree"


def add(subparsers: Any) -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser(
        "schema", help="print the JSON Schema of a kind of file, for editors"
    )
    parser.add_argument(
        "kind",
        nargs="?",
        default=TREE,
        choices=(TREE, *kind_names()),
        help="tree (the default), cell, campaign and installed extensions",
    )
    parser.set_defaults(main=main)


def main(options: argparse.Namespace) -> int:
    """Print the schema."""
    if options.kind == TREE:
        found = schema(Registry.installed())
    else:
        found = {
            "$schema": "https://json-schema.org/draft/2020-12/schema",
            **file_kind(options.kind).schema(),
        }
    write_json(found, indent=2)
    return 0
