"""Every decision has a number of its own, the day on which it was taken, and its status."""

from __future__ import annotations

import re
from datetime import date
from pathlib import Path

LINE = re.compile(r"^# .+\n\n\*Decision (\d+) · (\d{4}-\d\d-\d\d) · ([^*\n]+)\*\n")
STATUS = re.compile(r"in force|tried, .+|superseded by \d+")


def test_every_decision_is_numbered_dated_and_has_a_status() -> None:
    pages = sorted((Path(__file__).parents[1] / "docs" / "decisions").glob("*.md"))
    numbers = set()
    for page in pages:
        found = LINE.match(page.read_text("utf-8"))
        assert found, f"{page.name}: below its title stands no '*Decision N · YYYY-MM-DD · in force*'"
        numbers.add(int(found[1]))
        date.fromisoformat(found[2])
        assert STATUS.fullmatch(found[3]), f"{page.name}: {found[3]!r} is no status"
    assert numbers == set(range(1, len(pages) + 1))
