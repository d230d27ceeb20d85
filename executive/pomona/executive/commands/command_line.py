"""The parser of the command line, made of the installed subcommands; help, examples and completion come from it.

The tree, the setting and the campaign in them are the installed trees' own (`trees/defaults.toml`).
"""

from __future__ import annotations

import argparse
import os
import re
import sys
import textwrap
import tomllib
from collections.abc import Iterable, Iterator, Sequence
from importlib.metadata import EntryPoint
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from pomona.executive.errors import UsageError
from pomona.executive.values.installation import (
    ALONE,
    WHOLE,
    distribution,
    elsewhere,
    entry_points,
    installed_version,
    pip,
    reinstall,
)

_EXAMPLES = Path(__file__).with_name("examples.toml")


def examples(command: str) -> tuple[tuple[str, str], ...]:
    """Return the examples of a subcommand with their descriptions; nothing for one without examples."""
    rows = tomllib.loads(_EXAMPLES.read_text("utf-8")).get(command, {})
    if not rows:
        return ()
    # takes an eighth of `pomona --help`, which shows none
    from pomona.executive.files import default_name

    names = {name: default_name(name) for name in ("tree", "task", "setting", "campaign")}
    return tuple((line.format(**names), about.format(**names)) for line, about in rows.items())


RUN = "a record's folder or MCAP file, its name (or the beginning of it) below --record, or 'last'"

COMMANDS = "pomona.commands"
"""Entry point group of subcommands: functions that add one parser to argparse's subparsers and set its `main`.

An entry point has its subcommand's name and is loaded only for that command, since the imports of all take seconds. Its
help is read from its source, from the call `add_parser("name", help="…")`."""

ELSEWHERE = (
    "calibrate",
    "data",
    "detect",
    "doctor",
    "emulate",
    "evidence",
    "measure",
    "train",
)
"""Subcommands of the distribution `pomona` that the executive alone lacks."""

EPILOG = """Exit status: 0 the task succeeded, 1 the tree failed, 2 unusable input, 3 stopped
in the safe state (also by SIGTERM and SIGHUP), 4 done in part or unverified,
130 interrupted; 129 and 143 ended by SIGHUP and SIGTERM before anything moved.

`pomona COMMAND --help` has examples; `pomona completion` completes commands in
bash, zsh and fish."""


class _Version(argparse.Action):
    """Looks the version up when it is asked for."""

    def __call__(self, *_arguments: object, **_options: object) -> None:
        sys.stdout.write(f"{distribution()} {installed_version()}\n")
        sys.exit(0)


class _Choose(argparse.Action):
    """Keeps the choice where all processes of a run find it."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        _namespace: argparse.Namespace,
        values: str | Sequence[Any] | None,
        _option: str | None = None,
    ) -> None:
        from pomona.executive.registry import CHOSEN  # loading it takes a while, and few ask for it

        name, _, package = str(values).partition("=")
        if not (name and package) or " " in str(values):
            parser.error(
                f"argument --skill: '{values}' is not NAME=PACKAGE, such as Detect=my_package"
            )
        os.environ[CHOSEN] = f"{os.environ.get(CHOSEN, '')} {values}".strip()


def add_records_folder(parser: argparse.ArgumentParser) -> None:
    """`--record DIR`, the same for every subcommand that writes or reads records."""
    parser.add_argument(
        "--record",
        type=_folder,
        default=Path("runs"),
        metavar="DIR",
        help="folder of records (default: runs)",
    )


def _folder(text: str) -> Path:
    if not text.strip():  # Path("") is the working folder
        raise argparse.ArgumentTypeError(
            "the name of the folder is empty; write '.' for the working folder"
        )
    return Path(text)


def command_names() -> list[str]:
    """Return every installed subcommand."""
    return [entry.name for entry in _commands()]


def _commands() -> list[EntryPoint]:
    """Return the installed subcommands, by name. Raises UsageError: both distributions of Pomona are installed here."""
    entries = sorted(entry_points(group=COMMANDS), key=lambda entry: entry.name)
    owners = {
        dist.name for dist in {entry.dist for entry in entries} if dist is not None
    }  # each name is a file
    if {WHOLE, ALONE} <= owners:
        raise UsageError(
            f"{WHOLE} and {ALONE} are both installed here and hold the same files: {pip()} uninstall {ALONE}, then "
            f"{reinstall(WHOLE)}"
        )
    return entries


def make_parser(wanted: Iterable[str]) -> argparse.ArgumentParser:
    """Return the parser. Only the wanted subcommands are loaded; the help of the others comes from their sources.

    Raises UsageError: both distributions are installed, or the other one has a subcommand that is wanted.
    """
    entries = _commands()
    wanted = tuple(wanted)
    for name in set(wanted).intersection(ELSEWHERE).difference(entry.name for entry in entries):
        raise UsageError(f"pomona {name}: {elsewhere('this command')}")
    parser = argparse.ArgumentParser(
        prog="pomona",
        description="Run tasks that are written as behaviour trees in YAML.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog=EPILOG,
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="show the version and exit")
    parser.add_argument(
        "--skill",
        action=_Choose,
        metavar="NAME=PACKAGE",
        help="the package of skill NAME, when several packages offer one",
    )
    subparsers = parser.add_subparsers(metavar="COMMAND", required=True)
    for entry in entries:
        if entry.name in wanted:
            entry.load()(subparsers)
            _add_examples(subparsers.choices[entry.name], entry.name)
        else:
            subparsers.add_parser(entry.name, help=_help_of(entry), add_help=False)
    return parser


def children(parser: argparse.ArgumentParser) -> Iterator[tuple[str, str, argparse.ArgumentParser]]:
    """Yield each subcommand's name, help and parser."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            helps = {choice.dest: choice.help or "" for choice in action._choices_actions}
            for name, child in action.choices.items():
                yield name, helps.get(name, ""), child


def _add_examples(parser: argparse.ArgumentParser, name: str) -> None:
    rows = examples(name)
    if not rows:
        return
    lines = [f"  {line}\n      {about}" for line, about in rows]
    parser.epilog = "\n".join(
        [*([parser.epilog, ""] if parser.epilog else []), "examples:", *lines]
    )
    if (
        parser.description
    ):  # raw: the lines of the examples stay as they are, the description must be wrapped here
        blocks = parser.description.strip().split("\n")
        parser.description = "\n".join(textwrap.fill(block, 78) for block in blocks)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter


def _help_of(entry: EntryPoint) -> str:
    """Return the help text in a subcommand's source, without an import."""
    package, *way = entry.module.split(".")
    spec = find_spec(package)  # of a package within it, the outer one would be imported
    for place in (spec.submodule_search_locations if spec is not None else None) or ():
        source = Path(place, *way).with_suffix(".py")
        if source.is_file():
            found = re.search(
                rf"""add_parser\(\s*"{entry.name}",\s*help="([^"]*)\"""", source.read_text("utf-8")
            )
            return found[1] if found is not None else ""
    return ""
