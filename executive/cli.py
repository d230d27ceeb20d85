"""`pomona`: the command line.

Exit status: 0 the task succeeded, 1 the tree failed, 2 unusable input, 3 stopped in the safe state (also by SIGTERM and
SIGHUP), 130 interrupted; 129 and 143 ended by SIGHUP and SIGTERM before anything moved.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
from collections.abc import Sequence
from importlib.metadata import entry_points, version

from executive.errors import UsageError
from executive.running.signals import WORDS, raising, status_of

COMMANDS = "pomona.commands"
"""Entry point group of subcommands: functions that add one parser to argparse's subparsers and set its `main`.

An entry point with its subcommand's name is loaded alone when that is asked for: the others' imports cost seconds."""


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
    if arguments is None:
        _leave_quietly()
    return status


def _run(words: Sequence[str]) -> int:
    from executive.terminal.screen import filtered_output  # loading it takes a while: signals are heard before

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


def _parser(first: Sequence[str]) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="pomona",
        description="Run fruit-picking tasks that are written as behaviour trees in YAML.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog=__doc__.split("\n", 2)[2] if __doc__ else None,
    )
    parser.add_argument("--version", action="version", version=f"pomona {version('pomona')}")
    subparsers = parser.add_subparsers(metavar="COMMAND", required=True)
    entries = sorted(entry_points(group=COMMANDS), key=lambda entry: entry.name)
    for entry in [entry for entry in entries if entry.name in first] or entries:
        entry.load()(subparsers)
    return parser


if __name__ == "__main__":
    sys.exit(main())
