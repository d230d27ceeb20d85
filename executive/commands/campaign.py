"""`pomona campaign`: many runs from one file, on local processes, resumable."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from executive.campaign.report import report, succeeded
from executive.campaign.run import run_campaign
from executive.campaign.spec import read_campaign


def add(subparsers: Any) -> None:
    """Register the subcommand."""
    parser = subparsers.add_parser("campaign", help="run a campaign file: many runs, a report")
    parser.add_argument("file", type=Path)
    parser.add_argument("--out", type=Path, help="folder of results (default: runs/campaign_NAME)")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1, help="processes (default: one per core)")
    parser.add_argument("--record", action="store_true", help="keep a record of every run, too")
    parser.set_defaults(main=main)


def main(options: argparse.Namespace) -> int:
    """Run it; what is already in the results is not repeated.

    Returns:
        the exit status.
    """
    console = Console()
    planned = read_campaign(options.file, None)
    out = options.out or Path("runs") / f"campaign_{planned.name}"
    campaign = read_campaign(options.file, out / "records") if options.record else planned
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console) as bar:
        task = bar.add_task(campaign.name, total=len(campaign.runs))

        def progress(result: dict[str, Any], done: int, of: int) -> None:
            bar.update(task, completed=done, total=of)
            if not succeeded(result):
                reason = result.get("reason") or {}
                bar.console.print(f"✗ {result['name']}  {reason.get('code')}: {reason.get('message')}", markup=False)

        results = run_campaign(campaign, out, options.workers, progress)
    text = report(campaign, list(results.values()))
    (out / "report.md").write_text(text, encoding="utf-8")
    console.print(text, markup=False, highlight=False)
    console.print(f"written to {out / 'report.md'}", markup=False, highlight=False)
    return 0
