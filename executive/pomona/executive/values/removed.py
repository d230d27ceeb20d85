"""Words that a release took away or renamed: one table for the checks, `pomona migrate` and docs/stability.md.

A row holds words and no values, so that nothing here chooses a force, a friction or a pose. A word that an installed
package offers again is never looked up.
"""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Iterator
from itertools import accumulate
from typing import Literal, NamedTuple

from pomona.executive.values.findings import Findings, Instead, Located, Source, Spot


class Removal(NamedTuple):
    """Words that are gone for one reason."""

    kind: Literal["skill", "port", "node", "driver", "cell", "tree", "command", "module", "extra"]
    old: str  # words, parted by commas; a port with its skill, as `Lift.keep`: one that got another name has a `was`
    new: str  # the word to write instead; several, of which the user chooses one; or nothing. * is the old one's end
    why: str  # a sentence: the reason, and without a new word the remedy
    release: str = "0.2"

    @property
    def words(self) -> list[str]:
        """The old words."""
        return self.old.split(", ")

    def instead_of(self, word: str) -> list[str]:
        """Return the new words for an old one."""
        return [new.replace("*", word.split(".")[-1]) for new in self.new.split(", ") if new]


REMOVED: tuple[Removal, ...] = (
    Removal(
        "module",
        "pomona.drivers.emulators, pomona.drivers.frames, pomona.drivers.motoman, "
        "pomona.drivers.realsense, pomona.drivers.suntouch, pomona.drivers.wsg",
        "pomona.devices.*",
        "`pomona.drivers` holds what all drivers share",
    ),
    Removal("module", "pomona.drivers.mock", "pomona.tools.mock", "mock devices are a tool"),
    Removal(
        "module", "pomona.drivers.sim", "pomona.tools.simulation", "a simulated cell is a tool"
    ),
    Removal("command", "bench", "", "`python -m benchmarks.bench_problems` runs planning problems"),
    Removal("command", "completion man", "", "shtab writes the completion of three shells"),
    Removal("command", "export --groot", "", "it had no effect"),
    Removal("command", "run --rerun", "", "Foxglove opens the record of a run"),
    Removal("command", "run --watch", "", "editors check a tree when it is saved"),
    Removal("command", "runs failures", "", "`pomona explain RUN` lists a run's failures"),
    Removal("command", "runs frames, runs page", "", "`pomona runs export` writes both"),
    Removal("extra", "rerun", "", "Foxglove opens the record of a run"),
)


def removal(kind: str, word: str) -> Removal | None:
    """Return the row of a word that an earlier version had."""
    return next((row for row in REMOVED if row.kind == kind and word in row.words), None)


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
    old = word.split(".")[-1] if kind == "port" else word
    written = where.source.excerpt(where.line)[where.column - 1 :][: where.length]
    new = row.instead_of(word)
    hint = f"'pomona migrate {where.source.path}' asks which" if len(new) > 1 else ""
    if len(new) == 1 and old in written:
        hint = Instead(f"'pomona migrate {where.source.path}' writes it", old, new[0])
    findings.error(where, "removed", removed(kind, word), hint)
    return True


def report_in_text(findings: Findings, source: Source) -> None:
    """Report modules and extras that an earlier version had, in a text that is no YAML: code, or pyproject.toml."""
    starts = [0, *accumulate(map(len, source.text.splitlines(keepends=True)))]
    for kind, word, found in _named(source.text):
        line = bisect_right(starts, found.start(1))
        spot = Spot(source, line, found.start(1) - starts[line - 1] + 1, len(found[1]))
        report_removed(findings, spot, kind, word)


def _named(text: str) -> Iterator[tuple[str, str, re.Match[str]]]:
    """Yield kind, word and place of modules and extras in a text; of two modules the longer one."""
    words = {kind: _words(kind) for kind in ("module", "extra")}
    for found in re.finditer(rf"(?<![\w.])({'|'.join(words['module'])})(?!\w)", text):
        yield "module", found[1], found
    for word in words["module"]:
        package, _, name = word.rpartition(".")
        imported = rf"from\s+{package}\s+import\s*(?:\([^)]*?|[^\n(]*?)\b({name})\b"
        for found in re.finditer(imported, text):
            yield "module", word, found
    for word in words["extra"]:
        for found in re.finditer(rf"pomona\[(?:[^]\n]*\W)?({word})\b", text):
            yield "extra", word, found


def _words(kind: str) -> list[str]:
    words = [word for row in REMOVED if row.kind == kind for word in row.words]
    return sorted(words, key=len, reverse=True)
