"""The order of records, independent of the wall clock: clocks are set back, and repairs change old files.

Every record has a number in its `ending.json`, one above the largest in its folder when it began.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TypeVar

from pomona.executive.recording.ending import read_ending

T = TypeVar("T", str, int)

MOST = 2**53  # limit of valid numbers


def next_number(root: Path) -> int:
    """Return the number of the record that begins now in a folder of records."""
    return 1 + max((_number(record) for record in root.iterdir()), default=0)


def in_order(records: Iterable[Path], moment: Callable[[Path], T]) -> list[Path]:
    """Return folders of records, the oldest first.

    `moment` estimates the time of a record without a number (of an earlier version, or with a damaged file). Such a
    record comes after the numbered ones with an earlier estimate.
    """
    places: dict[Path, tuple[int, bool, T]] = {}
    greatest = 0
    for seems, record in sorted((moment(record), record) for record in records):
        number = _number(record)
        greatest = max(greatest, number)
        places[record] = (number or greatest, not number, seems)
    return sorted(places, key=lambda record: places[record])


def _number(record: Path) -> int:
    """Return a record's number; 0 without a valid one."""
    number = read_ending(record).get("number")
    return number if isinstance(number, int) and not isinstance(number, bool) and 0 < number < MOST else 0
