"""Words that a release took away or renamed, from removed.toml: what the checks, the command line and migrations say.

A word that an installed package offers again is never looked up.
"""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

from pomona.executive.values.findings import Findings, Instead, Located


class Removal(NamedTuple):
    """Words that are gone for one reason; removed.toml explains its fields."""

    kind: str
    old: list[str]
    why: str
    new: Sequence[str] = ()
    release: str = "0.2"

    def instead_of(self, word: str) -> list[str]:
        """Return the new words for an old one."""
        return [new.replace("*", word.rpartition(".")[2]) for new in self.new]


@cache
def removals() -> tuple[Removal, ...]:
    """Return the table."""
    content = tomllib.loads(Path(__file__).with_suffix(".toml").read_text("utf-8"))
    return tuple(Removal(**row) for row in content["removed"])


def removal(kind: str, word: str) -> Removal | None:
    """Return the row of a word that an earlier version had."""
    return next((row for row in removals() if row.kind == kind and word in row.old), None)


def removed(kind: str, word: str) -> str:
    """Return the sentence about a word that an earlier version had; an empty text for any other word."""
    row = removal(kind, word)
    if row is None:
        return ""
    became = " or ".join(f"'{new}'" for new in row.instead_of(word))
    change = f"became {became}" if became else "was removed"
    return f"the {kind} '{word}' {change} in {row.release}: {row.why}"


def import_problem(error: Exception) -> str:
    """Return why a package cannot be imported, with the sentence about a module that an earlier version had."""
    gone = removed("module", error.name or "") if isinstance(error, ImportError) else ""
    return f"{type(error).__name__}: {error}{gone and '; '}{gone}"


def report_removed(findings: Findings, where: Located, kind: str, word: str) -> bool:
    """Report a word that an earlier version had, with the edit that renames it; return False for any other word."""
    row = removal(kind, word)
    if row is None:
        return False
    new = row.instead_of(word)
    command = f"'pomona migrate {where.source.path}'"
    hint = f"{command} asks which" if len(new) > 1 else ""
    written = where.source.excerpt(where.line)[where.column - 1 :][: where.length]
    if len(new) == 1 and word in written:
        hint = Instead(f"{command} writes it", word, new[0])
    findings.error(where, "removed", removed(kind, word), hint)
    return True
