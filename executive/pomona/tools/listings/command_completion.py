"""`pomona completion`: completion for shells, written by shtab from the parsers themselves."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import shtab

from pomona.executive.commands.command_line import children, command_names, make_parser
from pomona.executive.terminal.output import Filtered
from pomona.executive.values.installation import installed_trees

SHELLS = ("bash", "zsh", "fish")


def add(subparsers: Any) -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser("completion", help="completion for bash, zsh or fish")
    parser.add_argument("shell", choices=SHELLS, help="the shell that will read it")
    parser.set_defaults(main=main)


def main(options: argparse.Namespace) -> int:
    """Print the completion."""
    out = sys.stdout.unfiltered if isinstance(sys.stdout, Filtered) else sys.stdout
    out.write(
        script(make_parser(command_names()), options.shell)
    )  # no byte of a script may be changed
    return 0


def script(parser: argparse.ArgumentParser, shell: str) -> str:
    """Return a shell's script: commands and options with their choices, else files; installed trees and cells."""
    trees = installed_trees()
    names = {
        "tree": sorted(path.stem for path in trees.glob("*.yaml")),
        "cell": sorted(path.stem for path in (trees / "cells").glob("*.yaml")),
        "run": ["last"],
    }
    offered = {kind: names_or_files(kind, words) for kind, words in names.items()}
    for action in _actions(parser):
        if action.nargs != 0 and action.choices is None:
            action.complete = offered.get(action.dest, shtab.FILE)  # type: ignore[attr-defined]
    return shtab.complete(parser, shell)


def names_or_files(kind: str, names: Sequence[str]) -> Mapping[str, str | Mapping[str, str]]:
    """Return the completion of an argument that is one of these names, or a file."""
    words = " ".join(names)
    return {
        "bash": f"_pomona_{kind}",
        "zsh": f"{{_files; compadd -- {words}}}",
        "fish": f"{words} {shtab.FILE['fish']}",
        "preamble": {
            "bash": f'_pomona_{kind}() {{ compgen -W "{words}" -- "$1"; compgen -f -- "$1"; }}'
        },
    }


def _actions(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    """Yield the options and positionals of a parser and of all below it."""
    yield from parser._actions
    for _name, _help, below in children(parser):
        yield from _actions(below)
