"""`pomona rerun`: repeat a simulated run from its own record and confirm that the same happens."""

from __future__ import annotations

import argparse
import contextlib
import tempfile
from pathlib import Path
from typing import Any

from pomona.executive.commands.command_line import RUN, add_records_folder
from pomona.executive.errors import UsageError
from pomona.executive.execute import RunOrder, execute, versions
from pomona.executive.judging import judge
from pomona.executive.language.check import read_document
from pomona.executive.recording.difference import first_difference
from pomona.executive.recording.digest import trusted
from pomona.executive.recording.folder import find_record
from pomona.executive.recording.read import read_events
from pomona.executive.registry import Registry
from pomona.executive.running.events import OperatorActed, RunEnded, RunStarted
from pomona.executive.speed import SpeedRefusedError, checked_speed, speed_of
from pomona.executive.terminal.explain import describe
from pomona.executive.terminal.live import LiveTree
from pomona.executive.terminal.screen import Screen
from pomona.executive.terminal.words import seconds
from pomona.executive.values.installation import installed_trees

REPEATABLE = ("simulated", "frames", "mock")


def add(subparsers: Any) -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser(
        "rerun",
        help="repeat a simulated run from its own record and confirm the same events",
        description="Repeats a simulated run with the tree and the cell of its record, not with the present files, "
        "and compares every event. Exit status: 0 the same, 1 different.",
    )
    parser.add_argument("run", help=RUN)
    add_records_folder(parser)
    parser.set_defaults(main=main)


def main(options: argparse.Namespace) -> int:
    """Repeat the run."""
    record = find_record(options.run, options.record)
    trusted(record)
    console = Screen()
    started, speeds, remarks = _beginning(record)
    with tempfile.TemporaryDirectory(prefix="pomona-rerun-") as folder:
        order = _order(started, speeds, Path(folder))
        _refuse_devices(order)
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


def _beginning(record: Path) -> tuple[RunStarted, tuple[OperatorActed, ...], list[str]]:
    """Return the start of the recorded run, its changes of speed, and the parts that cannot be repeated."""
    started: RunStarted | None = None
    ended = False
    acts: list[OperatorActed] = []
    for event in read_events(record):
        if isinstance(event, RunStarted):
            started = event
        elif isinstance(event, OperatorActed):
            acts.append(event)
        elif isinstance(event, RunEnded):
            ended = True
    if started is None:
        raise UsageError(f"{record}: the record does not hold the start of the run")
    kind = started.cell_kind
    if kind not in REPEATABLE:
        raise UsageError(f"{record}: only a simulated run can be repeated, this one was on a cell of kind {kind}")
    speeds = tuple(act for act in acts if act.action == "speed")
    remarks = [
        f"{act.who} did {act.action} at {act.t:.2f} s: a repetition has no operator"
        for act in acts
        if act.action != "speed"
    ]
    if not ended:
        remarks.append("the record was cut off: the repetition goes on where it ends")
    return started, speeds, remarks


def _refuse_devices(order: RunOrder) -> None:
    """Refuse a record whose cell is a real one, independent of its header.

    Raises UsageError: the cell that it holds is none that can be repeated, or cannot be read.
    """
    if order.dry:
        return
    document = read_document(order.tree, order.texts)
    judged = judge(document, Registry.installed(), order.settings, order.cell, order.texts)
    judged.refuse_errors()
    if judged.cell is not None and judged.cell.kind not in REPEATABLE:
        raise UsageError(
            f"the cell in the record is of kind {judged.cell.kind}, the record's header names another kind"
        )


def _order(started: RunStarted, speeds: tuple[OperatorActed, ...], folder: Path) -> RunOrder:
    """Return the order of the recorded run, with the file contents of that time.

    Raises UsageError: the record names an impossible speed, or a folder that does not exist here.
    """
    try:
        speed = checked_speed(started.speed)
        for act in speeds:
            speed_of(act.detail)
    except SpeedRefusedError as error:
        raise UsageError(f"the record is none of a run: {error}") from None
    dry = started.cell == "dry" and started.cell_kind == "mock"
    cell = Path(started.cell_path)
    if not dry and not cell.parent.is_dir():  # recorded on another machine: its files are found beside the cell
        cell = installed_trees() / "cells" / cell.name
        if not cell.parent.is_dir():
            raise UsageError(f"{started.cell_path}: its folder holds files that it names, and does not exist here")
    texts = {started.tree_path: started.tree_text, str(cell): started.cell_text, **started.tree_files}
    texts |= {str(cell.parent / name): text for name, text in started.cell_files.items()}
    return RunOrder(
        tree=Path(started.tree_path),
        cell=cell,
        seed=started.seed,
        speed=speed,
        speeds=speeds,
        settings=dict(started.settings),
        record=folder,
        dry=dry,
        mocks=cell if dry and started.cell_path else None,
        texts=texts,
    )


def _versions_differ(started: RunStarted) -> list[str]:
    now = versions()
    return [
        f"{name} was {then}, is {now.get(name, 'missing')}"
        for name, then in started.versions.items()
        if now.get(name) != then
    ]
