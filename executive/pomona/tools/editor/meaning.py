"""The content of a tree file as plain values: the measure of an edit of the text."""

from __future__ import annotations

import re
from typing import Any

from pomona.executive.values.yaml_nodes import YamlList, YamlMapping, YamlNode, YamlScalar

_QUOTED = re.compile(r"[,\[\]{}\n]")  # a plain text with these is written in quotes inside braces
Content = Any


def content_of(at: YamlNode | None, known: dict[int, Content] | None = None) -> Content:
    """Return a value without its places: a mapping, a list, a text with True when it stands without quotes, or None.

    `known` gets the content of each part, by the id of its YAML.
    """
    found: Content = None
    if isinstance(at, YamlScalar):
        if not at.is_null:
            found = (at.text, at.plain and not _QUOTED.search(at.text))
    elif isinstance(at, YamlList):
        found = [content_of(item, known) for item in at.items]
    elif isinstance(at, YamlMapping):
        found = {word: content_of(value, known) for word, (_, value) in at.entries.items()}
    if known is not None:
        known[id(at)] = found
    return found
