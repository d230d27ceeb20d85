"""The README of the words follows `guard`: its attributes, outcomes and behaviour are as described."""

from __future__ import annotations

import re
from pathlib import Path

from pomona.executive import nodes
from pomona.executive.language import read
from pomona.executive.language.check import analyse
from pomona.executive.nodes.catalogue import NodeTypes
from pomona.executive.nodes.check import GuardType
from pomona.executive.registry import Registry

FOLDER = Path(nodes.__file__).parent
PAGE = (FOLDER / "README.md").read_text("utf-8")
EXAMPLE = re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL)[0]


def test_the_word_has_the_attributes_and_outcomes_that_are_listed() -> None:
    word = NodeTypes.installed()["guard"]
    assert type(word) is GuardType
    rows = re.findall(r"^\| `(\w+)` \| (\S+) \| [^|]+ \|$", PAGE, re.MULTILINE)
    assert [(name, getattr(word, name)) for name, _ in rows] == rows
    document = read(EXAMPLE, "watch.yaml")
    analysis = analyse(document, Registry({}))
    assert analysis.errors == []
    root = next(iter(document.definitions())).root
    assert root is not None
    assert analysis.outcomes is not None
    assert analysis.outcomes.layer(root.children[0], 0).codes == {"CONDITION_FALSE"}
