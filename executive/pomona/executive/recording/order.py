"""Which record came after which, whatever the wall's clock said: clocks are set back, and repairs touch old files.

Every record has a number of its own, one above the greatest in its folder when it began, kept in its `ending.json`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TypeVar

from pomona.executive.recording.ending import read_ending

T = TypeVar("T", str, int)

MOST = 2**53
"""Greater numbers were not written by a recorder."""


def next_number(root: Path) -> int:
    """The number of the record that begins now in a folder of records."""
    return 1 + max((_number(record) for record in root.iterdir()), default=0)


def in_order(records: Iterable[Path], moment: Callable[[Path], T]) -> list[Path]:
    """Folders of records, those that began first first.

    Args:
        records: in any order.
        moment: when a record was made, as far as that can be told without its number: a record without one (an older
            Pomona's, one whose file is damaged) comes after the numbered ones that seem older.
    """
    places: dict[Path, tuple[int, bool, T]] = {}
    greatest = 0
    for seems, record in sorted((moment(record), record) for record in records):
        number = _number(record)
        greatest = max(greatest, number)
        places[record] = (number or greatest, not number, seems)
    return sorted(places, key=lambda record: places[record])


def _number(record: Path) -> int:
    """A record's number; 0 when it has none that can be believed."""
    number = read_ending(record).get("number")
    return number if isinstance(number, int) and not isinstance(number, bool) and 0 < number < MOST else 0
