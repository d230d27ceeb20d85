"""Checks of many records by others: lines of a report, by entry point `pomona.record_checks`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from pomona.executive.values.installation import entry_points
from pomona.executive.values.sentences import ReportLine


def check_records(records: Sequence[Path], cell: str = "") -> Iterator[ReportLine]:
    """Yield the lines of functions (records, cell) -> iterable of ReportLine.

    Args:
        records: their folders, of any cells.
        cell: name of the only cell to look at, as its newest record has it; empty: all of them.
    """
    for point in sorted(entry_points(group="pomona.record_checks"), key=lambda point: point.name):
        try:
            yield from point.load()(records, cell)
        except Exception as error:  # a package of a third party, or one that lacks another
            yield ReportLine(point.name, False, f"{point.value} cannot be asked: {error}")
