"""The page about the language names tests that exist, and shows files that are right."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from pomona.executive.nodes import NodeTypes

HERE = Path(__file__).parent
PAGE = (HERE.parents[2] / "docs" / "tree_language.md").read_text()
NAMED = sorted(set(re.findall(r"`(test_\w+\.py)::(\w+)`", PAGE)))


@pytest.mark.parametrize(("file", "name"), NAMED, ids=lambda value: value)
def test_a_named_test_exists(file, name):
    assert re.search(rf"(def|class) {name}\b", next(HERE.parent.rglob(file)).read_text())


def test_every_row_of_a_table_with_proofs_has_one():
    rows = []
    for table in re.findall(r"(?:^\|[^\n]*\n)+", PAGE, re.MULTILINE):
        header, _, *lines = table.splitlines()
        rows += lines if header.endswith("| Proof |") else []
    assert len(rows) > 25
    assert [row for row in rows if "`test_" not in row] == []


def test_every_rule_names_its_proof():
    """Paragraphs, points and rows; but not headings, examples and the text before a table or an example."""
    rules = re.split(r"\n\n|\n(?=- |\|)", re.sub(r"```.*?```", "", PAGE.partition("\n## ")[2], flags=re.DOTALL))
    rows = re.compile(r"\||#|$")
    bare = [rule for rule in rules if "test_" not in rule and not rows.match(rule) and not rule.endswith(":")]
    tables = [row for row in rules if re.match(r"\| `|\| an? |\| any ", row) and "test_" not in row]
    assert bare + tables == ["Nodes"]  # what is left of the first heading


@pytest.mark.parametrize("found", NodeTypes().values(), ids=lambda found: found.key)
def test_the_page_has_the_text_of_every_type(found):
    row = rf"^\| (?:`[^|]*`, )?`{found.key}\b[^|]*\| {re.escape(found.summary)}[^|]*\|"
    assert re.search(row, PAGE, re.MULTILINE), f"no row of a table reads `{found.key}: …` | {found.summary}"
    for word in found.fields:
        assert re.search(rf"`{word}\b", PAGE), word


def test_the_first_example_is_right(findings_of):
    example = re.search(r"```yaml\n(.*?)```", PAGE, re.DOTALL)[1]
    assert findings_of(example) == []
