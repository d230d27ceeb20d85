"""Every failure code that a shipped skill declares is named by a test that drives it."""

import re
from importlib.metadata import entry_points
from pathlib import Path

import pytest

HERE = Path(__file__).resolve().parent
SHIPPED = sorted(
    (
        entry
        for entry in entry_points(group="pomona.skills")
        if entry.value.startswith("pomona.skills.")
    ),
    key=lambda entry: entry.name,
)


@pytest.mark.parametrize("entry", SHIPPED, ids=lambda entry: entry.name)
def test_every_declared_code_appears_in_a_test_of_the_skill(entry):
    texts = [
        text
        for path in HERE.rglob("test_*.py")
        if re.search(rf"\b{entry.name}\(", text := path.read_text())
    ]
    named = {code for text in texts for code in re.findall(r'"([A-Z][A-Z_]+)"', text)}
    assert sorted(set(entry.load().failures) - named) == []
    assert texts, f"no test drives {entry.name}"
