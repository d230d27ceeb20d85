"""The language's README follows one node: each step of it is as described."""

from __future__ import annotations

import re
from pathlib import Path

from pomona.executive import language
from pomona.executive.language import read
from pomona.executive.language.check import analyse
from pomona.executive.registry import Registry

FOLDER = Path(language.__file__).parent
PAGE = (FOLDER / "README.md").read_text("utf-8")
EXAMPLE = re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL)[0]


def test_the_example_has_the_layers_outcomes_and_values_that_are_described() -> None:
    document = read(EXAMPLE, "look.yaml")
    skills = Registry.installed()
    analysis = analyse(document, skills)
    assert analysis.errors == []
    root = next(iter(document.definitions())).root
    assert root is not None
    node = root.children[0]
    rows = re.findall(r"^\| (\d) \| `(\w+)` \| `(\w+)` \|$", PAGE, re.MULTILINE)
    assert [
        (str(n), layer.key, type(layer).__name__) for n, layer in enumerate(node.layers)
    ] == rows
    assert analysis.outcomes is not None
    outer, timed, called = (analysis.outcomes.layer(node, index).codes for index in range(3))
    assert called == set(skills["Detect"].failures)
    assert timed == called | {"TIMEOUT"} == outer
    settings = [analysis.resolved[id(node), word].settings[word] for word in ("retry", "timeout")]
    assert [getattr(setting, "value", None) for setting in settings] == [3, 5.0]
    assert analysis.resolved[id(node), "skill"].outputs == {"detection": "detection"}


def test_a_name_that_is_not_written_on_every_path_is_found() -> None:
    lines = EXAMPLE.replace("    - Detect", "    - fallback:\n        - Detect").splitlines()
    text = "\n".join(
        f"    {line}" if line.startswith(("      retry", "      timeout")) else line
        for line in lines
    )
    text = text.replace("    - Refine", "        - wait: 1 s\n    - Refine")
    assert [
        finding.code for finding in analyse(read(text, "look.yaml"), Registry.installed()).errors
    ] == ["unset"]
