"""Records to remove, by age, number and size; never one that is being written, and no file that no run wrote."""

from __future__ import annotations

import time
from collections.abc import Sequence
from itertools import chain
from pathlib import Path

from pomona.executive.errors import UsageError
from pomona.executive.recording.digest import Digest
from pomona.executive.recording.folder import ENDING_FILE, EVENTS_FILE, is_being_written
from pomona.executive.run_views import RunViews
from pomona.executive.running.supervise import REPORT
from pomona.executive.values.kinds import Measure
from pomona.executive.values.units import Quantity

AGE = Measure(
    Quantity("age", {"s": 1.0, "min": 60.0, "h": 3600.0, "d": 86400.0, "w": 7 * 86400.0}), low="0 d"
)
SIZE = Measure(Quantity("size", {"B": 1.0, "kB": 1e3, "MB": 1e6, "GB": 1e9, "TB": 1e12}), low="0 B")

WRITTEN = (
    f"{EVENTS_FILE} {EVENTS_FILE}.damaged {EVENTS_FILE}.tail {ENDING_FILE} {REPORT} "
    "summary.json tree.yaml cell.yaml picture.png"
).split()


def choose(
    runs: Sequence[Digest],
    *,
    older: float | None = None,
    keep: int | None = None,
    total: float | None = None,
    now: float | None = None,
) -> dict[str, str]:
    """Return the records to remove, each with its reason.

    Args:
        runs: newest first.
        older: those that began longer ago than this [s].
        keep: all but this many newest ones.
        total: the oldest ones, until the rest is within this many bytes.
        now: seconds since 1970.
    """
    now = now or time.time()
    chosen: dict[str, str] = {}
    size = 0
    for number, run in enumerate((run for run in runs if run.state != "running"), start=1):
        size += run.bytes
        if older is not None and 0.0 < run.wall_time < now - older:
            chosen[run.run] = f"{(now - run.wall_time) / 86400.0:.0f} days old"
        elif keep is not None and number > keep:
            chosen[run.run] = f"beyond the newest {keep}"
        elif total is not None and size > total:
            chosen[run.run] = f"beyond {total / 1e6:g} MB in all"
    return chosen


def remove(folder: Path) -> str:
    """Remove the files of one record, and its folder; return why it stays, or an empty text.

    A view of a run names in `files` what it leaves in the folder. Raises UsageError: it cannot be removed.
    """
    if is_being_written(folder / EVENTS_FILE):
        return f"{folder} stays: a run writes it"
    try:
        if folder.is_symlink():
            folder.unlink()
            return ""
        for name in chain(WRITTEN, *(view.files for view in RunViews.installed())):
            (folder / name).unlink(missing_ok=True)
        if any(folder.iterdir()):
            return (
                f"{folder}: its record is removed; it stays, since it holds files that no run wrote"
            )
        folder.rmdir()
    except OSError as error:
        raise UsageError(f"{folder} cannot be removed: {error.strerror}") from error
    return ""
