"""`pomona explain`: the events of a run, their causes, and a remedy."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pomona.executive.commands.command_line import RUN, add_records_folder
from pomona.executive.recording.digest import trusted
from pomona.executive.recording.folder import events_file, find_record, is_being_written
from pomona.executive.recording.read import read_events
from pomona.executive.run_views import RunViews
from pomona.executive.terminal.screen import Screen
from pomona.executive.terminal.words import UNCHECKED
from pomona.tools.dashboard.explain import explain


def add(subparsers: Any) -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser("explain", help="explain a recorded run: events, causes, remedy")
    parser.add_argument("run", nargs="?", default="last", help=f"{RUN} (default: last)")
    about = "also every moment, in the order of time, with values, times, the score and tracebacks"
    parser.add_argument("--all", action="store_true", help=about)
    add_records_folder(parser)
    parser.set_defaults(main=main)


def main(options: argparse.Namespace) -> int:
    """Explain the run."""
    record = find_record(options.run, options.record)
    console = Screen()
    run = trusted(record)
    why_cut = run.message or "the reason is unknown"
    going_on = is_being_written(events_file(record))
    for paragraph in explain(read_events(record), going_on, why_cut, whole=options.all):
        console.print(paragraph, soft_wrap="\n" in paragraph)
    for paragraph in _further(record):
        console.print(paragraph)
    if run.lost:
        console.print(f"The record was damaged and repaired; lost: {run.lost}.", style="yellow")
    if not run.checked:
        console.print(UNCHECKED, style="yellow")
    return 0


def _further(record: Path) -> Iterator[str]:
    """Yield the sentences of other packages about a record."""
    for view in RunViews.installed():
        try:
            if sentence := view.explain(record):
                yield sentence
        except Exception as error:  # a package of a third party, or one that lacks another
            yield f"{type(view).__name__}: nothing can be added: {error}"
