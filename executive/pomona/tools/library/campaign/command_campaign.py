"""`pomona campaign`: many runs from one file, resumable, with a report."""

from __future__ import annotations

import argparse
import contextlib
import re
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from pomona.executive.errors import UsageError
from pomona.executive.images import EXTRA
from pomona.executive.terminal.screen import Screen
from pomona.executive.values.installation import need
from pomona.executive.values.kinds import Whole
from pomona.tools.library.campaign.run import RESULTS, finished_runs, run_campaign, succeeded
from pomona.tools.library.campaign.spec import Campaign, CampaignRun, read_campaign
from pomona.tools.library.pool import WorkerPool


def add(subparsers: Any) -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser("campaign", help="run a campaign file: many runs, a report")
    parser.add_argument("file", type=Path)
    parser.add_argument(
        "--out",
        type=Path,
        help="folder of results (default: runs/campaign_NAME); a campaign that was stopped goes on there",
    )
    parser.add_argument(
        "--workers",
        type=Whole(1).option,
        metavar="N",
        help="processes at once (default: one per core)",
    )
    parser.add_argument(
        "--seeds",
        type=Whole(1).option,
        metavar="N",
        help="run only the first N seeds of every combination",
    )
    parser.add_argument(
        "--only",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="only runs with this value of a key under `vary`, or arm=NAME; may be repeated",
    )
    parser.add_argument("--record", action="store_true", help="also keep a record of every run")
    parser.add_argument(
        "--report", action="store_true", help="run nothing; write the report of the present results"
    )
    parser.add_argument(
        "--report-to",
        type=Path,
        metavar="DIR",
        help="folder of the report (default: that of results)",
    )
    parser.set_defaults(main=main)


def main(options: argparse.Namespace) -> int:
    """Run the campaign; runs with a result are not repeated."""
    need("scipy", EXTRA, "pomona campaign")
    from pomona.tools.library.campaign.report import report

    console = Screen()
    planned = read_campaign(options.file)
    campaign = planned.only(subset(planned, options.seeds, options.only))
    out: Path = options.out or Path("runs") / f"campaign_{campaign.name}"
    interrupted = False
    if not options.report:
        try:
            with (
                contextlib.closing(WorkerPool(options.workers)) as pool,
                _Shown(campaign, console) as shown,
            ):
                run_campaign(campaign, out, pool, shown.ended, options.record)
        except KeyboardInterrupt:
            interrupted = True
            console.print("interrupted; the same command goes on from here")
    results = list(
        finished_runs(
            campaign, out, lambda problem: console.print(problem, style="yellow")
        ).values()
    )
    if not results:
        raise UsageError(f"{out / RESULTS} holds no results of this campaign yet")
    folder = options.report_to or out
    name = report_name(options.seeds, options.only)
    markdown, page = report(campaign, results, str(options.file)).write(folder, name)
    console.print(markdown.read_text(encoding="utf-8"))
    console.print(f"written to {page} and {markdown}", soft_wrap=True)
    return 130 if interrupted else 0


def report_name(seeds: int | None, only: Sequence[str]) -> str:
    """Return the name of a report's files: one of some runs stands beside that of all, and does not replace it."""
    parts = [f"seeds_{seeds}"] if seeds is not None else []
    words = [
        f"{'only_' if not parts and not n else ''}{text.replace('=', '_')}"
        for n, text in enumerate(only)
    ]
    return re.sub(r"[^\w.-]", "_", "_".join(["report", *parts, *words]))


def subset(campaign: Campaign, seeds: int | None, only: Sequence[str]) -> list[CampaignRun]:
    """Return the runs that `--seeds` and `--only` leave. Raises UsageError: an option is malformed, or leaves none."""
    wanted: dict[str, set[str]] = {}
    for text in only:
        key, equals, value = text.partition("=")
        known = {"arm": campaign.arms, **campaign.vary}
        if not equals or key not in known:
            raise UsageError(f"--only {text}: write KEY=VALUE with a key of {', '.join(known)}")
        if value not in known[key]:
            raise UsageError(f"--only {text}: {key} is one of {', '.join(known[key])}")
        wanted.setdefault(key, set()).add(value)
    runs = [
        run
        for run in campaign.runs
        if (seeds is None or run.number < seeds)
        and all({"arm": run.arm, **run.varied}[key] in values for key, values in wanted.items())
    ]
    if not runs:
        raise UsageError("--only and --seeds leave no run of this campaign")
    return runs


class _Shown:
    """Progress: a bar in a terminal, else a line a run."""

    def __init__(self, campaign: Campaign, console: Screen) -> None:
        self._campaign = campaign
        self._console = console
        columns = (BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn())
        self._bar = Progress(
            TextColumn("{task.description}", markup=False),
            *columns,
            console=console,
            disable=not console.is_terminal,
        )
        self._task = self._bar.add_task(campaign.name, total=len(campaign.runs))
        self._good = self._ended = 0

    def __enter__(self) -> _Shown:
        self._bar.start()
        self._started = time.monotonic()
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()

    def ended(self, result: dict[str, Any], done: int, of: int) -> None:
        from pomona.tools.library.campaign.report import (
            failure_code,
            failure_message,
        )  # over scipy

        good = succeeded(result)
        self._good += good
        self._ended += 1
        self._bar.update(
            self._task,
            completed=done,
            description=f"{self._campaign.name} {self._good}/{self._ended} ✓",
        )
        left = (time.monotonic() - self._started) / self._ended * (of - done) / 60.0
        line = f"{'✓' if good else '✗'} {result['name']}"
        if not good:
            line += f"  {failure_code(result)}: {failure_message(result)}"
        if not self._console.is_terminal:
            line = (
                f"[{done}/{of}] {line}   {self._good}/{self._ended} succeeded, {left:.0f} min left"
            )
        if not good or not self._console.is_terminal:
            self._bar.console.print(line, soft_wrap=True)
