"""docs/api.md: its snippets run, one after the other, as a reader would paste them."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "api.md"
SNIPPET = re.compile(r"^```python\n(.*?)^```", re.MULTILINE | re.DOTALL)


def test_the_snippets_run_as_they_stand_anywhere(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    text = PAGE.read_text("utf-8")
    pasted: dict[str, object] = {"__name__": "pasted"}
    snippets = list(SNIPPET.finditer(text))
    assert len(snippets) >= 5
    for snippet in snippets:
        line = text.count("\n", 0, snippet.start(1))
        exec(
            compile("\n" * line + snippet[1], str(PAGE), "exec"), pasted
        )  # tracebacks show the page's own lines
