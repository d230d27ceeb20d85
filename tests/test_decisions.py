"""Every decision has a number, the day on which it was taken, and its status; the site has few and short ones."""

from __future__ import annotations

import re
from datetime import date
from pathlib import Path

import pytest

DOCS = Path(__file__).resolve().parents[1] / "docs"
LINE = re.compile(r"^# .+\n\n(\*Decision (\d+) · (\d{4}-\d\d-\d\d) · ([^*\n]+)\*)\n")
STATUS = re.compile(r"in force|tried, .+|superseded by \d+")
KEPT = sorted((DOCS / "decisions").glob("*.md"))
EVIDENCE = sorted((DOCS / "evidence").glob("*.md"))
PARTS = ("**Context.**", "**Decision.**", "**Consequence.**")


def test_every_decision_is_numbered_dated_and_has_a_status() -> None:
    heads: dict[str, str] = {}
    for page in (*EVIDENCE, *KEPT):
        found = LINE.match(page.read_text("utf-8"))
        assert found, (
            f"{page.name}: below its title stands no '*Decision N · YYYY-MM-DD · in force*'"
        )
        date.fromisoformat(found[3])
        assert STATUS.fullmatch(found[4]), f"{page.name}: {found[4]!r} is no status"
        assert heads.setdefault(page.name, found[1]) == found[1], (
            f"{page.name}: another head than its evidence"
        )
    numbers = [int(head.split()[1]) for head in heads.values()]
    assert sorted(numbers) == list(range(1, len(numbers) + 1))


@pytest.mark.parametrize("page", KEPT, ids=lambda page: page.stem)
def test_a_decision_of_the_site_is_short_and_in_force(page: Path) -> None:
    text = page.read_text("utf-8")
    assert "· in force*" in text
    assert len(text.split()) <= 250, "move the measurements to docs/evidence"
    assert [part for part in PARTS if part not in text] == []


def test_the_site_has_at_most_thirty_decisions() -> None:
    assert 0 < len(KEPT) <= 30, "move one to docs/evidence"
