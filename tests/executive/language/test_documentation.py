"""The first example of the page about the language is right."""

from __future__ import annotations

import re
from pathlib import Path

PAGE = (Path(__file__).parents[3] / "docs" / "tree_language.md").read_text("utf-8")


def test_the_first_example_is_right(findings_of):
    example = re.search(r"```yaml\n(.*?)```", PAGE, re.DOTALL)[1]
    assert findings_of(example) == []
