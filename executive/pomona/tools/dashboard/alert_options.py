"""Command-line options for alerts: call a program when the success rate of runs is too low."""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from itertools import islice
from pathlib import Path

from pomona.executive.recording.index import RunIndex
from pomona.executive.values.kinds import Measure
from pomona.executive.values.units import RATIO
from pomona.tools.dashboard.alerts import AlertRule, Alerts

SHARE = Measure(RATIO, low="0 %", high="100 %")


def add_alerts(parser: argparse.ArgumentParser) -> None:
    """Register the options."""
    parser.add_argument(
        "--alert-to",
        metavar="URL",
        help="post a JSON object to URL when the success rate is below --alert-below",
    )
    parser.add_argument(
        "--alert-below",
        type=SHARE.option,
        default=0.8,
        metavar="SHARE",
        help="minimum success rate of the last runs (default: 80%%)",
    )
    parser.add_argument(
        "--alert-over",
        type=int,
        default=20,
        metavar="N",
        help="number of last runs for the success rate (default: 20)",
    )


def alerts_of(
    options: argparse.Namespace, before: Iterable[tuple[bool, str]] = ()
) -> Alerts | None:
    """Return the alerts that the options request, or None. Raises UsageError: the options are inconsistent."""
    if options.alert_to is None:
        return None
    return Alerts(AlertRule(options.alert_to, options.alert_below, options.alert_over), before)


def outcomes_in(records: Path, most: int) -> list[tuple[bool, str]]:
    """Of the newest recorded runs that have ended, oldest first: whether each succeeded, and its code if not."""
    ended = (run for run in RunIndex(records).read() if run.outcome is not None)
    return [(run.outcome == "success", run.code or "") for run in islice(ended, max(most, 0))][::-1]
