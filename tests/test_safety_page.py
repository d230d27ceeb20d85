"""Each promise of docs/safety.md names its test."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PAGE = (ROOT / "docs" / "safety.md").read_text("utf-8")
PROSE = {"Stops of the robot", "Situations without a stop", "After a stop", "Test runs"}
PROSE |= {"Limits of the simulated and emulated cells"}
SECTIONS = re.findall(r"^##+ (.+)\n((?:(?!##).*\n?)*)", PAGE, re.MULTILINE)


@pytest.mark.parametrize(("title", "text"), SECTIONS, ids=[title for title, _ in SECTIONS])
def test_a_section_names_tests_that_exist(title: str, text: str) -> None:
    named = re.findall(r"`(tests/[\w/.]+)`", text)
    assert named or title in PROSE
    assert all((ROOT / name).exists() for name in named)
