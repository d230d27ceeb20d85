"""`pomona replay`: a recorded run, shown again in the terminal."""

from __future__ import annotations

import argparse
import time
from typing import Any

from pomona.executive.commands.command_line import add_records_folder
from pomona.executive.recording.digest import trusted
from pomona.executive.recording.folder import find_record
from pomona.executive.recording.read import read_events
from pomona.executive.terminal.live import LiveTree
from pomona.executive.terminal.screen import Screen
from pomona.executive.terminal.summary import Summary
from pomona.executive.terminal.words import UNCHECKED, ending, how
from pomona.executive.values.kinds import Number

SLOWEST, FASTEST = 1e-3, 1e3  # range of `--speed`: seconds of the run per second of the clock


def add(subparsers: Any) -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser("replay", help="show a recorded run again as it happened")
    parser.add_argument("run", help="a record's folder, its name below --record, or 'last'")
    add_records_folder(parser)
    parser.add_argument(
        "--speed",
        type=Number(SLOWEST, FASTEST).option,
        metavar="FACTOR",
        help="1 is real time (default: as fast as possible)",
    )
    parser.set_defaults(main=main)


def main(options: argparse.Namespace) -> int:
    """Replay the run."""
    folder = find_record(options.run, options.record)
    run = trusted(folder)
    console = Screen()
    live, summary = LiveTree(console), Summary()
    shown = 0.0
    try:
        for event in read_events(folder):
            if options.speed is not None and event.t > shown:
                time.sleep((event.t - shown) / options.speed)
                shown = event.t
            live.on_event(event)
            summary.on_event(event)
    finally:
        live.close()
    if summary.started is None or summary.ended is None:
        rest = "" if how(run) == "empty" else "; the readable part is shown above"
        console.print(f"{folder}: {ending(run)}{rest}")
        return 0
    summary.print(console, folder)
    if run.lost:
        console.print(f"the record was damaged and repaired; lost: {run.lost}", style="yellow")
    if not run.checked:
        console.print(UNCHECKED, style="yellow")
    return 0
