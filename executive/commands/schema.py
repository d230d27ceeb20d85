"""`pomona schema`: the JSON Schema of tree files, from the installed skills; editors complete and check with it."""

from __future__ import annotations

import argparse
import json
import sys
from typing import Any

from executive.language.schema import schema
from executive.registry import Registry


def add(subparsers: Any) -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser("schema", help="print the JSON Schema of tree files, for editors")
    parser.set_defaults(main=main)


def main(_options: argparse.Namespace) -> int:
    """Print it.

    Returns:
        the exit status.
    """
    sys.stdout.write(json.dumps(schema(Registry.installed()), ensure_ascii=False, indent=2) + "\n")
    return 0
