"""`pomona run`: a tree file on a cell, watched, recorded and summed up."""

from __future__ import annotations

import argparse
import contextlib
import logging
import signal
import sys
from pathlib import Path
from typing import Any

from pomona.executive.commands.command_line import add_records_folder
from pomona.executive.errors import UsageError
from pomona.executive.execute import Executed, RunOrder, execute
from pomona.executive.files import find_cell, find_tree
from pomona.executive.language.check import read_document, usual_cell
from pomona.executive.language.interface import parse_settings
from pomona.executive.run_views import RunViews
from pomona.executive.running.runner import Runner
from pomona.executive.speed import SpeedRefusedError, speed_of
from pomona.executive.terminal.keys import Keys
from pomona.executive.terminal.live import LiveTree
from pomona.executive.terminal.output import write_json
from pomona.executive.terminal.screen import Screen

EXIT = {"success": 0, "failure": 1, "stopped": 3, "error": 3, "partial": 4}


def add(subparsers: Any) -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser("run", help="run a tree file on a cell")
    parser.add_argument("tree", help="a tree file, or the name of an installed tree")
    parser.add_argument(
        "--cell", help="a cell file, or the name of an installed cell (default: the simulated one)"
    )
    parser.add_argument(
        "--seed", type=int, default=0, help="seed of all random numbers (default: 0)"
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="a parameter of the tree or an option of the cell",
    )
    parser.add_argument(
        "--pace",
        choices=("fast", "real"),
        default="fast",
        help="a simulated cell as fast as possible, or in real time",
    )
    parser.add_argument(
        "--speed",
        default="100 %",
        metavar="SHARE",
        help="speed of the arm relative to the commanded one, 10 %% to 100 %%; the page and ROS 2 change it",
    )
    add_records_folder(parser)
    parser.add_argument("--no-record", action="store_true", help="leave no record")
    parser.add_argument(
        "--dry",
        nargs="?",
        const="",
        metavar="MOCKS",
        help="run without a cell: the mocks of a file replace all skills",
    )
    parser.add_argument(
        "--json", action="store_true", help="print one JSON object as the last line"
    )
    parser.add_argument("--quiet", action="store_true", help="print nothing but errors")
    parser.add_argument(
        "--simulated", action="store_true", help="refuse a cell that is not simulated"
    )
    _add_beginnings(parser)
    views = RunViews.installed()
    views.add(parser)
    parser.set_defaults(main=lambda options: main(options, views))


def _add_beginnings(parser: argparse.ArgumentParser) -> None:
    """Add the options for waiting at the start, and for a start after a run that was cut off."""
    for side in ("before", "after"):
        parser.add_argument(
            f"--break-{side}",
            action="append",
            default=[],
            metavar="NODE",
            help=f"pause {side} this node (its name, type or path); go on from the page, so it needs --dashboard",
        )
    parser.add_argument(
        "--recover",
        action="store_true",
        help="bring the arm home slowly first: after a run that was cut, or that has left something in the gripper",
    )
    parser.add_argument(
        "--cleared",
        action="store_true",
        help="the cell was checked: start although the last run was cut off, or something is in the gripper",
    )


def main(options: argparse.Namespace, views: RunViews) -> int:
    """Run the tree."""
    (shown := logging.StreamHandler()).setLevel(logging.WARNING)  # the record has more
    logging.basicConfig(format="%(name)s: %(message)s", handlers=[shown])
    console = Screen(stderr=options.json, quiet=options.quiet)
    attended = views.attend(options)
    here = (
        not attended
        and not (options.quiet or options.json)
        and console.is_terminal
        and sys.stdin.isatty()
    )
    order = _order(options, attended or here)
    with views.open(options, console, options.record):
        executed = _run(options, order, views, console, here)
        ends = executed.signal not in (
            None,
            signal.SIGINT,
        )  # it was meant for the whole process, not for this run
        if sys.stdin.isatty() and not options.quiet and not ends:
            views.stay()
    return 130 if executed.result.interrupted else EXIT[executed.result.outcome]


def _order(options: argparse.Namespace, attended: bool) -> RunOrder:
    """Raises UsageError: an option cannot be used, or a breakpoint has no operator."""
    try:
        speed = speed_of(options.speed)
    except SpeedRefusedError as error:
        raise UsageError(f"--speed: {error}") from None
    tree = find_tree(options.tree)
    order = RunOrder(
        tree=tree,
        cell=find_cell(options.cell) if options.cell else usual_cell(read_document(tree)),
        seed=options.seed,
        settings=parse_settings(options.set),
        real_time=options.pace == "real",
        record=None if options.no_record else options.record,
        past=options.record,
        dry=options.dry is not None,
        mocks=Path(options.dry) if options.dry else None,
        recover=options.recover,
        cleared=options.cleared,
        speed=speed,
        attended=attended,
        simulated=options.simulated,
        breaks=(
            *((name, "before") for name in options.break_before),
            *((name, "after") for name in options.break_after),
        ),
    )
    if order.breaks and not attended:
        raise UsageError("without an operator no run resumes after a breakpoint: add --dashboard")
    return order


def _run(
    options: argparse.Namespace, order: RunOrder, views: RunViews, console: Screen, here: bool
) -> Executed:
    """Run the order, with an operator at this terminal if `here`, and print its summary."""
    with contextlib.ExitStack() as stack:
        live = stack.enter_context(contextlib.closing(LiveTree(console)))
        keys = stack.enter_context(contextlib.closing(Keys(console, sys.stdin))) if here else None
        starting = stack.enter_context(views.run(order.tree.stem))

        def on_ready(runner: Runner) -> None:
            if keys is not None:
                keys.serve(runner)
            views.on_ready(runner)

        executed = execute(
            order,
            [live.on_event, *views.listeners, *([] if keys is None else [keys.on_event])],
            on_ready=on_ready,
            on_latched=views.on_latched,
            starting=live.starting() if starting is None else starting,
            readers=views.readers,
        )
    with contextlib.suppress(OSError):  # the reader is gone: the exit status still has the result
        _print(executed, options, console)
    return executed


def _print(executed: Executed, options: argparse.Namespace, console: Screen) -> None:
    executed.summary.print(console, executed.record)
    if executed.problem:
        console.print(executed.problem, style="red")
    if options.quiet:
        failed = executed.result.outcome != "success"
        for line in filter(None, (executed.summary.sentence() if failed else "", executed.problem)):
            Screen(stderr=True).print(line, soft_wrap=True)
    if options.json:
        write_json(executed.summary.as_json(executed.record))
        sys.stdout.flush()
