"""`pomona rerun`: repeat a simulated run from its own record, unchanged or with changes."""

from __future__ import annotations

import argparse
import contextlib
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pomona.executive.commands.command_line import RUN, add_records_folder
from pomona.executive.commands.run import EXIT
from pomona.executive.errors import UsageError
from pomona.executive.execute import RunOrder, execute, versions
from pomona.executive.recording.digest import trusted
from pomona.executive.recording.folder import find_record
from pomona.executive.recording.read import read_events
from pomona.executive.running.events import OperatorActed, RunStarted
from pomona.executive.terminal.live import LiveTree
from pomona.executive.terminal.screen import Screen
from pomona.executive.terminal.words import seconds
from pomona.tools.library.cures.asked import asked_change
from pomona.tools.library.cures.evidence import gather
from pomona.tools.library.cures.repetition import REPEATABLE, judged_order, order_of
from pomona.tools.library.difference import describe, first_difference


def add(subparsers: Any) -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser(
        "rerun",
        help="repeat a simulated run from its own record and confirm the same events",
        description="Repeats a simulated run with the tree and the cell of its record, not with the present files, "
        "and compares every event. Exit status: 0 the same, 1 different. With --set the run is repeated with changes: "
        "0 it succeeded, 1 it did not. The tree file stays as it is.",
    )
    parser.add_argument("run", help=RUN)
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="a change: of a parameter, an option of the cell, or NODE.port",
    )
    add_records_folder(parser)
    parser.set_defaults(main=main)


def main(options: argparse.Namespace) -> int:
    """Repeat the run."""
    record = find_record(options.run, options.record)
    trusted(record)
    console = Screen()
    started, acts, remarks = _beginning(record)
    if options.set:
        return _changed(order_of(started, acts, None), options.set, console)
    with tempfile.TemporaryDirectory(prefix="pomona-rerun-") as folder:
        order = order_of(started, acts, Path(folder))
        if not order.dry:
            judged_order(order).refuse_errors()
        with contextlib.closing(LiveTree(console)) as live:
            executed = execute(order, [live.on_event])
        if executed.problem or executed.record is None:
            raise UsageError(f"the repetition could not be compared: {executed.problem}")
        count, difference = first_difference(record, executed.record)
    if difference is None:
        console.print(
            f"[green]✓[/] the same {count} events, {seconds(executed.result.time)} of the run, "
            f"{seconds(executed.result.wall)} here",
            markup=True,
        )
        return 0
    console.print(f"[red]✗[/] {count} events are the same, then", markup=True)
    for line in [*describe(difference, "recorded", "now"), *remarks, *_versions_differ(started)]:
        console.print(f"  {line}", soft_wrap=True)
    return 1


def _changed(order: RunOrder, texts: Sequence[str], console: Screen) -> int:
    """Repeat the run with changes, and print how it ends now; it leaves no record."""
    changes = []
    for text in texts:
        judged = judged_order(order)
        judged.refuse_errors()
        changes.append(asked_change(text, order, judged))
        order = changes[-1].applied(order)
    judged_order(order).refuse_errors()
    for change in changes:
        console.print(change.sentence, soft_wrap=True)
    with contextlib.closing(LiveTree(console)) as live:
        executed = execute(order, [live.on_event])
    executed.summary.print(console, None)
    return EXIT[executed.result.outcome]


def _beginning(record: Path) -> tuple[RunStarted, list[OperatorActed], list[str]]:
    """Return the start of the recorded run, the operator's acts, and the parts that cannot be repeated."""
    found = gather(read_events(record))
    started = found.started
    if started is None:
        raise UsageError(f"{record}: the record does not hold the start of the run")
    kind = started.cell_kind
    if kind not in REPEATABLE:
        raise UsageError(
            f"{record}: only a simulated run can be repeated, this one was on a cell of kind {kind}"
        )
    remarks = [
        f"{act.who} did {act.action} at {act.t:.2f} s: a repetition has no operator"
        for act in found.acts
        if act.action != "speed"
    ]
    if found.ended is None:
        remarks.append("the record was cut off: the repetition goes on where it ends")
    return started, found.acts, remarks


def _versions_differ(started: RunStarted) -> list[str]:
    now = versions()
    return [
        f"{name} was {then}, is {now.get(name, 'missing')}"
        for name, then in started.versions.items()
        if now.get(name) != then
    ]
