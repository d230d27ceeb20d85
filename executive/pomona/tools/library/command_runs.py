"""`pomona runs`: list, show, compare, export, prune and repair recorded runs, and extract their contents."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pomona.executive.commands.command_line import RUN, add_records_folder
from pomona.executive.errors import UsageError
from pomona.executive.recording.digest import Digest, trusted
from pomona.executive.recording.folder import (
    events_file,
    find_record,
    is_being_written,
    records_in,
)
from pomona.executive.recording.index import RunIndex
from pomona.executive.recording.scan import is_whole
from pomona.executive.terminal.output import write_json
from pomona.executive.terminal.screen import Screen
from pomona.executive.values.kinds import Whole
from pomona.tools.library import prune as pruning
from pomona.tools.library.export import FORMATS, export
from pomona.tools.library.run_list import how, print_comparison, print_list, size, wide_console

if (
    TYPE_CHECKING
):  # readers of whole records are imported on use, so that a list does not wait for them
    from pomona.executive.run_views import Export
    from pomona.executive.terminal.summary import Summary


def add(subparsers: Any) -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser(
        "runs", help="list, show, compare, export, prune, repair recorded runs"
    )
    commands = parser.add_subparsers(metavar="ACTION", required=True)

    listing = _command(commands, "list", _list, "the recorded runs, newest first")
    listing.add_argument(
        "words", nargs="*", help="only runs with all of these words in name, cell, settings or code"
    )
    listing.add_argument("--failed", action="store_true", help="only runs that did not succeed")
    listing.add_argument(
        "--limit",
        type=Whole(1).option,
        default=30,
        metavar="N",
        help="maximum number (default: 30)",
    )
    listing.add_argument("--all", action="store_true", help="no limit")
    listing.add_argument("--json", action="store_true", help="one JSON object a line")

    show = _command(commands, "show", _show, "one run: settings, result, contents of its record")
    show.add_argument("run", help=RUN)
    show.add_argument("--json", action="store_true", help="one JSON object")

    compare = _command(commands, "compare", _compare, "runs side by side, with their differences")
    compare.add_argument("runs", nargs="+", metavar="RUN", help=RUN)

    exporting = _command(
        commands, "export", _export, "a run as one portable file, or in the format of another tool"
    )
    exporting.add_argument("run", help=RUN)
    exporting.add_argument(
        "file",
        nargs="?",
        type=Path,
        help="default: RUN.zip here. The ending selects the format: "
        + ", ".join(f"{ending} {what}" for ending, (_write, what) in FORMATS.items())
        + ", .html a page that can be sent",
    )
    exporting.add_argument(
        "--to",
        metavar="FORMAT",
        help="a folder: images and tables (frames), or of another tool: rosbag2, lerobot",
    )
    exporting.add_argument(
        "--with", nargs="+", default=[], metavar="RUN", dest="more", help="lerobot: more episodes"
    )
    exporting.add_argument(
        "--rate", type=Whole(1).option, metavar="HZ", help="lerobot: steps a second (default: 10)"
    )
    exporting.add_argument(
        "--task", default="", metavar="WORDS", help="lerobot: the task (default: the tree)"
    )

    prune = _command(
        commands, "prune", _prune, "remove old records after confirmation; runs in progress stay"
    )
    prune.add_argument(
        "--older",
        type=pruning.AGE.option,
        metavar="AGE",
        help="older than this age: 30 d, 12 h, 4 w",
    )
    prune.add_argument(
        "--keep", type=Whole(1).option, metavar="N", help="keep the newest N records"
    )
    prune.add_argument(
        "--total",
        type=pruning.SIZE.option,
        metavar="SIZE",
        help="remove the oldest until the rest fits into 20 GB …",
    )
    prune.add_argument("--dry", action="store_true", help="only list the records to delete")
    prune.add_argument("--yes", action="store_true", help="do not ask")

    repairing = _command(
        commands, "repair", _repair, "complete records that are cut off or damaged"
    )
    repairing.add_argument(
        "runs", nargs="*", metavar="RUN", help=f"{RUN}; default: all that need it"
    )


def _command(commands: Any, name: str, main: Any, text: str) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = commands.add_parser(
        name, help=text, description=text.capitalize()
    )
    add_records_folder(parser)
    parser.set_defaults(main=main)
    return parser


# --------------------------------------------------------------------------------------------------- list


def _list(options: argparse.Namespace) -> int:
    if not options.record.is_dir():
        raise UsageError(
            f"no folder {options.record}: `pomona run` makes it, --record names another"
        )
    index = RunIndex(options.record)
    runs = index.read()
    if index.problem:
        Screen(stderr=True).print(index.problem, style="yellow", soft_wrap=True)
    chosen = [run for run in runs if _wanted(run, options)]
    shown = chosen if options.all else chosen[: options.limit]
    if options.json:
        for run in shown:
            write_json(run.as_json())
        return 0
    console = wide_console()
    print_list(console, shown, len(runs), sum(run.bytes for run in runs))
    cut = sum(
        run.state == "cut off" and _needs_repair(events_file(options.record / run.run))
        for run in shown
    )
    if cut:
        console.print(f"`pomona runs repair` completes the files of {cut}", style="dim")
    return 0


def _wanted(run: Digest, options: argparse.Namespace) -> bool:
    if options.failed and how(run) in ("success", "running"):
        return False
    settings = (f"{key}={value}" for key, value in run.settings.items())
    text = " ".join(map(str, (how(run), *run.as_json().values(), *settings)))
    return all(word.lower() in text.lower() for word in options.words)


# ------------------------------------------------------------------------------------------- show, compare


def _show(options: argparse.Namespace) -> int:
    from pomona.tools.library.run_sheet import print_sheet

    record = find_record(options.run, options.record)
    if options.json:
        write_json(trusted(record).as_json())
        return 0
    run = trusted(record)
    print_sheet(wide_console(), record, run, _summary(record))
    return 0


def _compare(options: argparse.Namespace) -> int:
    from pomona.tools.library.difference import explain_parting

    if len(options.runs) < 2:
        raise UsageError("compare at least two runs: pomona runs compare RUN RUN")
    records = [find_record(name, options.record) for name in options.runs]
    console = wide_console()
    digests = [trusted(record) for record in records]
    summaries = [_summary(record) for record in records]
    print_comparison(console, digests, [summary.robot_time for summary in summaries])
    if len(records) == 2 and _same_start(digests[0]) == _same_start(digests[1]):
        for line in explain_parting(records[0], records[1]):
            console.print(line, soft_wrap=True)
    return 0


def _same_start(run: Digest) -> tuple[Any, ...]:
    """Return the values that two runs must share to be expected to be equal."""
    return run.tree_hash, run.cell_hash, run.seed, dict(run.settings)


def _summary(record: Path) -> Summary:
    from pomona.executive.recording.read import read_events
    from pomona.executive.terminal.summary import Summary

    summary = Summary()
    for event in read_events(record):
        summary.on_event(event)
    return summary


# ------------------------------------------------------------------------------------------------ export


def _export(options: argparse.Namespace) -> int:
    record = find_record(options.run, options.record)
    if options.to != "lerobot" and (options.more or options.rate or options.task):
        raise UsageError("--with, --rate and --task belong to --to lerobot")
    target = options.file or Path(f"{_name(record)}{f'_{options.to}' if options.to else '.zip'}")
    name = options.to or target.suffix
    if name in FORMATS:
        export(record, target)
        Screen().print(f"{target}  {size(target.stat().st_size)}")
        return 0
    offered = _exports()
    if name not in offered:
        kind = "the suffix" if options.to is None else "--to"
        formats = [f"{ending} {what}" for ending, (_write, what) in FORMATS.items()]
        raise UsageError(f"{target}: {kind} selects the format: {', '.join([*formats, *offered])}")
    records = [record, *(find_record(more, options.record) for more in options.more)]
    written = offered[name](records, target, options)
    console = Screen()
    console.print(f"{target}", style="bold", soft_wrap=True)
    for thing, what in written.items():
        console.print(f"  {thing:<40} {what}", soft_wrap=True)
    return 0


def _exports() -> dict[str, Export]:
    """Return the exports to folders, and those of other packages, by name or suffix."""
    from pomona.executive.run_views import RunViews
    from pomona.tools.library.extract import extract

    found: dict[str, Export] = {"frames": lambda records, folder, _: extract(records[0], folder)}
    for view in RunViews.installed():
        found |= view.exports()
    return found


def _name(record: Path) -> str:
    return record.stem if record.is_file() else record.resolve().name


# ------------------------------------------------------------------------------------------- prune, repair


def _prune(options: argparse.Namespace) -> int:
    if options.older is None and options.keep is None and options.total is None:
        raise UsageError("no limit is given: use --older 30d, --keep 100 or --total 20GB")
    runs = RunIndex(options.record).read()
    chosen = pruning.choose(runs, older=options.older, keep=options.keep, total=options.total)
    console = wide_console()
    sizes = {run.run: run.bytes for run in runs}
    for run, why in chosen.items():
        console.print(f"  {run:<44} {size(sizes[run]):>9}   {why}")
    amount = f"{len(chosen)} of {len(runs)} records, {size(sum(sizes[run] for run in chosen))}"
    if options.dry or not chosen:
        console.print(f"{amount} would be removed" if chosen else "no record to remove")
        return 0
    if not options.yes and not _agreed(f"remove {amount}? [y/N] "):
        console.print("nothing was removed")
        return 1
    for stays in filter(None, [pruning.remove(options.record / run) for run in chosen]):
        console.print(stays, soft_wrap=True)
    console.print(
        f"removed {sum(not events_file(options.record / run).exists() for run in chosen)} records"
    )
    return 0


def _agreed(question: str) -> bool:
    if not sys.stdin.isatty():
        raise UsageError(
            "there is no terminal to ask on: --yes deletes them without asking, --dry only lists them"
        )
    return input(question).strip().lower() in ("y", "yes")


def _repair(options: argparse.Namespace) -> int:
    from pomona.tools.library.repair import repair  # importing its drawing library takes a second

    console = Screen()
    if options.runs:
        records: Iterable[Path] = [find_record(name, options.record) for name in options.runs]
    else:
        records = sorted(path.parent for path in records_in(options.record) if _needs_repair(path))
    status = 0
    count = 0
    for record in records:
        count += 1
        try:
            done = repair(record)
        except UsageError as error:
            console.print(f"✗ {error}", style="red", soft_wrap=True)
            status = 2
            continue
        if done is None:
            console.print(f"· {record}: needs no repair", soft_wrap=True)
            continue
        copied = done.copied
        parts = [
            done.why,
            f"{copied.messages} messages saved, up to {copied.seconds:.2f} s of the run",
        ]
        parts += [f"lost {copied.lost}"] if copied.gaps else []
        parts += [f"no complete chunk in the last {size(copied.cut)}"] if copied.cut else []
        parts += [f"the original bytes are in {done.kept}"] if done.kept else []
        if done.made:
            parts.append(f"made {', '.join(done.made)}")
        console.print(f"✓ {record}: {'; '.join(parts)}", soft_wrap=True)
    if not count:
        console.print("no record needs a repair")
    return status


def _needs_repair(path: Path) -> bool:
    try:
        return not is_whole(path) and not is_being_written(path)
    except UsageError:
        return True  # the repair reports the error
