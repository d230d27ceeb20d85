"""Modules, extras and groups of entry points of an earlier version in a text that is no YAML: code, or pyproject.toml."""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Iterator
from itertools import accumulate

from pomona.executive.values.findings import Findings, Source, Spot
from pomona.executive.values.removed import removals, report_removed


def report_old_names(findings: Findings, source: Source) -> None:
    """Report each, with the edit that renames it."""
    starts = [0, *accumulate(map(len, source.text.splitlines(keepends=True)))]
    for kind, word, found in _named(source.text):
        line = bisect_right(starts, found.start(1))
        spot = Spot(source, line, found.start(1) - starts[line - 1] + 1, len(found[1]))
        report_removed(findings, spot, kind, word)


def _named(text: str) -> Iterator[tuple[str, str, re.Match[str]]]:
    """Yield kind, word and place of each; of two modules at one place the longer one."""
    modules = _words("module")
    for found in re.finditer(rf"(?<![\w.])({'|'.join(modules)})(?!\w)", text):
        yield "module", found[1], found
    for word in modules:
        package, _, name = word.rpartition(".")
        imported = rf"from\s+{package}\s+import\s*(?:\([^)]*?|[^\n(]*?)\b({name})\b"
        for found in re.finditer(imported, text):
            yield "module", word, found
    for word in _words("extra"):
        for found in re.finditer(rf"pomona\[(?:[^]\n]*\W)?({word})\b", text):
            yield "extra", word, found
    for word in _words("group"):
        for found in re.finditer(rf"entry-points\.[\"']({word})[\"']", text):
            yield "group", word, found


def _words(kind: str) -> list[str]:
    words = [word for row in removals() if row.kind == kind for word in row.old]
    return sorted(words, key=len, reverse=True)
