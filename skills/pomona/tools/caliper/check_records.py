"""The line of `pomona evidence` and `pomona doctor` about the camera of each cell, from the picks of many records."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from pathlib import Path

from pomona.executive.errors import UsageError
from pomona.executive.recording.folder import in_order
from pomona.executive.values.sentences import ReportLine
from pomona.tools.caliper.estimate import estimate
from pomona.tools.caliper.findings import CameraFinding, find_error, next_picks
from pomona.tools.caliper.records import Picks, read_back

ADVICE = "pomona calibrate from-picks proposes another pose; runs that have it end this line"


def check(records: Sequence[Path], cell: str = "") -> Iterator[ReportLine]:
    """Yield a line for each camera that is off; for one cell alone, and where none is off, one line.

    Args:
        records: folders of records of any cells.
        cell: name of a cell, whose newest calibration counts; empty: all cells with all their calibrations.
    """
    ordered = in_order(records, lambda record: record.name)
    groups = [read_back(ordered, cell=cell)] if cell else read_groups(ordered)
    for group in groups:
        if group.refused and not group.picks:
            words = (
                f"not known: none of {len(group.refused)} picks can be used: {group.refused[-1]}"
            )
            yield ReportLine(f"camera of {group.cell}", True, words, absent=True)
    groups = [group for group in groups if group.picks]
    lines = [_line(group) for group in groups]
    off = [line for line in lines if not line.ok]
    if off or len(lines) == 1:
        yield from off or lines
    elif lines:
        picks = sum(len(group.picks) for group in groups)
        words = f"{picks} picks show none that is beside the place of its cell file"
        yield ReportLine(f"cameras, {len(lines)} calibrations", True, words)


def _line(group: Picks) -> ReportLine:
    found = estimate(group.picks)
    finding: CameraFinding = find_error(found)
    sentence = " ".join(filter(None, (finding.sentence, next_picks(found))))
    return ReportLine(f"camera of {group.cell}", not finding.is_off, sentence, ADVICE)


def read_groups(records: Sequence[Path]) -> list[Picks]:
    """Return the picks of many records, those of one cell and calibration together; others than these are left out."""
    groups: list[Picks] = []
    rest = list(records)
    while rest:
        group = read_back(rest[-1:])
        for record in reversed(rest[:-1]):
            with contextlib.suppress(UsageError):
                group.merge(Picks.of_record(record))
        rest = [record for record in rest[:-1] if record.name not in group.runs]
        groups.insert(0, group)
    return groups
