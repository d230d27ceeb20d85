"""`pomona`: the command line.

Exit status: 0 the task succeeded, 1 the tree failed, 2 unusable input, 3 stopped in the safe state, 130 interrupted.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from importlib.metadata import entry_points, version

from executive.errors import UsageError
from executive.terminal.screen import Screen, filtered_output

COMMANDS = "pomona.commands"
"""Entry point group of subcommands: functions that add one parser to argparse's subparsers and set its `main`.

An entry point with its subcommand's name is loaded alone when that is asked for: the others' imports cost seconds."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one subcommand.

    Returns:
        the exit status.
    """
    with filtered_output():
        return _main(list(sys.argv[1:] if arguments is None else arguments))


def _main(words: list[str]) -> int:
    options = _parser(words[:1]).parse_args(words)
    try:
        status: int = options.main(options)
    except UsageError as error:
        Screen(stderr=True).print(str(error), style="red", soft_wrap=True)
        return 2
    except BrokenPipeError:  # `pomona … | head`
        sys.stderr.close()
        return 1
    except OSError as error:  # a folder that is not there, a disk that is full: which file, and what is wrong with it
        if error.filename is None:
            raise
        Screen(stderr=True).print(f"{error.filename}: {error.strerror}", style="red", soft_wrap=True)
        return 2
    except KeyboardInterrupt:
        return 130
    return status


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
