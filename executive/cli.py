"""`pomona`: the command line.

Exit status: 0 the task succeeded, 1 the tree failed, 2 unusable input, 3 stopped in the safe state (also by SIGTERM and
SIGHUP), 130 interrupted; 129 and 143 ended by SIGHUP and SIGTERM before anything moved.
"""

from __future__ import annotations

import argparse
import os
import re
import signal
import sys
from collections.abc import Sequence
from importlib.metadata import EntryPoint, entry_points, version
from importlib.util import find_spec
from pathlib import Path

from executive.errors import UsageError
from executive.running.signals import WORDS, raising, signalled, status_of

COMMANDS = "pomona.commands"
"""Entry point group of subcommands: functions that add one parser to argparse's subparsers and set its `main`.

An entry point has its subcommand's name and is loaded alone when that is asked for: the others' imports cost seconds.
Its help is read from its source, where the module says `add_parser("name", help="…")`."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one subcommand.

    Returns:
        the exit status.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    try:
        with raising():
            status = _run(words)
    except KeyboardInterrupt as ended:
        status = status_of(ended)
    except Exception as error:
        ended_by = signalled(error)
        if ended_by is None:
            raise
        status = status_of(ended_by)
    if arguments is None:
        _leave_quietly()
    return status


def _run(words: Sequence[str]) -> int:
    from executive.terminal.filtered import filtered_output  # loading it takes a while: signals are handled before

    with filtered_output():
        return _run_filtered(words)


def _run_filtered(words: Sequence[str]) -> int:
    options = _parser(words[:1]).parse_args(words)
    try:
        status: int = options.main(options)
    except UsageError as error:
        _say(str(error))
        return 2
    except BrokenPipeError:  # `pomona … | head`
        return 1
    except OSError as error:  # a folder that is not there, a disk that is full: which file, and what is wrong with it
        if error.filename is None:
            raise
        _say(f"{error.filename}: {error.strerror}")
        return 2
    return status


def _say(text: str) -> None:
    from executive.terminal.screen import Screen

    Screen(stderr=True).print(text, style="red", soft_wrap=True)


def _leave_quietly() -> None:
    """The work is done: a signal, or a reader that is gone, must not make a traceback out of the process's end."""
    for number in WORDS:
        signal.signal(number, signal.SIG_IGN)
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except (OSError, ValueError):  # what is left has no reader
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


class _Version(argparse.Action):
    """Looks the version up when it is asked for."""

    def __call__(self, *_arguments: object, **_options: object) -> None:
        sys.stdout.write(f"pomona {version('pomona')}\n")
        sys.exit(0)


def _parser(first: Sequence[str]) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="pomona",
        description="Run tasks that are written as behaviour trees in YAML.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog=__doc__.split("\n", 2)[2] if __doc__ else None,
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="show the version and exit")
    subparsers = parser.add_subparsers(metavar="COMMAND", required=True)
    for entry in sorted(entry_points(group=COMMANDS), key=lambda entry: entry.name):
        if entry.name in first:
            entry.load()(subparsers)
        else:
            subparsers.add_parser(entry.name, help=_help_of(entry), add_help=False)
    return parser


def _help_of(entry: EntryPoint) -> str:
    """What a subcommand's source gives as its help, without importing it."""
    spec = find_spec(entry.module.rpartition(".")[0])
    places = spec.submodule_search_locations if spec is not None else None
    for place in places or ():
        source = Path(place) / f"{entry.module.rpartition('.')[2]}.py"
        if source.is_file():
            found = re.search(rf"""add_parser\(\s*"{entry.name}",\s*help="([^"]*)\"""", source.read_text("utf-8"))
            return found[1] if found is not None else ""
    return ""


if __name__ == "__main__":
    sys.exit(main())
