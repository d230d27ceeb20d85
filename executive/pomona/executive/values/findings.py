"""Errors and warnings in a file: the place, the problem, and the correction."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from difflib import SequenceMatcher, get_close_matches
from functools import lru_cache
from typing import Literal, NamedTuple, Protocol

from pomona.executive.errors import UsageError

Severity = Literal["error", "warning", "note"]


class Edit(NamedTuple):
    """Characters of one line to replace by a text; line and column count from 1."""

    line: int
    column: int
    length: int
    text: str


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that is wrong. Lines and columns count from 1; `length` characters of the excerpt are meant."""

    path: str
    line: int
    column: int
    severity: Severity
    code: str
    message: str
    hint: str = ""
    excerpt: str = ""
    length: int = 1
    # changes of the file that follow the hint; `pomona check --fix` and editors apply them
    edits: tuple[Edit, ...] = ()


class Instead(str):
    """A hint that names the text to write: `wrong`, which stands in the underlined part, becomes `right`."""

    __slots__ = ("right", "wrong")

    def __new__(cls, hint: str, wrong: str, right: str) -> Instead:
        """Make a hint of its sentence and the two texts."""
        made = super().__new__(cls, hint)
        made.wrong = wrong
        made.right = right
        return made

    wrong: str
    right: str


class TreeFileError(UsageError):
    """A tree file that cannot be run, with everything that was found in it."""

    def __init__(self, findings: Sequence[Finding]) -> None:
        self.findings = tuple(findings)
        super().__init__(format_findings(self.findings))


class Located(Protocol):
    """Anything that knows where it is written."""

    @property
    def source(self) -> Source:
        """The file that it stands in."""

    @property
    def line(self) -> int:
        """Line, from 1."""

    @property
    def column(self) -> int:
        """Column, from 1."""

    @property
    def length(self) -> int:
        """How many characters to underline."""


class LocatedText(Located, Protocol):
    """A text in a file."""

    @property
    def text_column(self) -> int:
        """Column of its first character."""


class Spot(NamedTuple):
    """A place in a file."""

    source: Source
    line: int
    column: int
    length: int = 1


class Within(NamedTuple):
    """Some characters of a text; the range moves with the text."""

    whole: LocatedText
    start: int
    length: int

    @property
    def source(self) -> Source:
        """The file."""
        return self.whole.source

    @property
    def line(self) -> int:
        """Line, from 1."""
        return self.whole.line

    @property
    def column(self) -> int:
        """Column, from 1."""
        return self.whole.text_column + self.start


class Source:
    """One file's text, for excerpts; `comments` maps a line to its comment, `comment_lines` hold nothing else."""

    def __init__(self, path: str, text: str) -> None:
        self.path = path
        self.text = text
        self.lines = text.splitlines()
        self.comments: dict[int, str] = {}
        self.comment_lines: set[int] = set()

    def excerpt(self, line: int) -> str:
        """Return the text of a line, from 1; empty beyond the file."""
        return self.lines[line - 1] if 0 < line <= len(self.lines) else ""


class Findings:
    """Collects findings; reports each only once."""

    def __init__(self) -> None:
        self._found: dict[tuple[str, int, int, str, str], Finding] = {}

    def error(
        self, where: Located, code: str, message: str, hint: str = "", edits: Sequence[Edit] = ()
    ) -> None:
        """Report an error: the file cannot be used."""
        self._add(where, "error", code, message, hint, edits)

    def warning(self, where: Located, code: str, message: str, hint: str = "") -> None:
        """Report a warning: the file can be used, but a mistake is likely."""
        self._add(where, "warning", code, message, hint)

    def note(self, where: Located, code: str, message: str, hint: str = "") -> None:
        """Report what the file cannot do; nothing is wrong."""
        self._add(where, "note", code, message, hint)

    def add(self, finding: Finding) -> None:
        """Keep a finding, once."""
        key = (finding.path, finding.line, finding.column, finding.code, finding.message)
        self._found.setdefault(key, finding)

    def extend(self, findings: Iterable[Finding]) -> None:
        """Keep all of these."""
        for finding in findings:
            self.add(finding)

    def _add(
        self,
        where: Located,
        severity: Severity,
        code: str,
        message: str,
        hint: str,
        edits: Sequence[Edit] = (),
    ) -> None:
        source = where.source
        line = where.line
        column = where.column
        length = max(where.length, 1)
        excerpt = source.excerpt(line)
        if isinstance(hint, Instead):
            at = excerpt.rfind(hint.wrong, column - 1, column - 1 + length)
            edits = [Edit(line, at + 1, len(hint.wrong), hint.right)] if at >= 0 else []
        self.add(
            Finding(
                source.path,
                line,
                column,
                severity,
                code,
                message,
                str(hint),
                excerpt,
                length,
                tuple(edits),
            )
        )

    def sorted(self) -> list[Finding]:
        """Errors, warnings, notes; each in reading order, without a line (a file that cannot be opened, `--set`) first."""
        return sorted(
            self._found.values(),
            key=lambda f: (f.severity == "note", f.severity, f.path, f.line, f.column, f.code),
        )

    @property
    def errors(self) -> bool:
        """Whether one of them is an error."""
        return any(finding.severity == "error" for finding in self._found.values())


_left: ContextVar[list[int] | None] = ContextVar("_left", default=None)
"""Words that may still be compared; nothing outside of `few_hints`."""


@contextmanager
def few_hints() -> Iterator[None]:
    """Search for similar words only while few words are wrong, so that a file full of mistakes is checked quickly."""
    if _left.get() is not None:
        yield
        return
    token = _left.set([MAX_COMPARED])
    try:
        yield
    finally:
        _left.reset(token)


def mended(text: str, findings: Iterable[Finding]) -> tuple[str, list[Finding]]:
    """Apply the edits of findings to the text; return the new text, and the findings whose edits were applied.

    If the edits of several findings touch one line, only the first is applied; the next check shows the remaining ones.
    """
    lines = text.splitlines(keepends=True)
    touched = set[int]()
    applied = list[Finding]()
    for finding in findings:
        at = {edit.line for edit in finding.edits}
        if not at or at & touched or max(at) > len(lines):
            continue
        for line, column, length, new in finding.edits:
            old = lines[line - 1]
            lines[line - 1] = old[: column - 1] + new + old[column - 1 + length :]
        touched |= at
        applied.append(finding)
    return "".join(lines), applied


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """`did you mean 'Refine'?`, or an empty text when nothing is close."""
    left = _left.get()
    # characters of a word for which one that was meant is looked for
    if len(word) > 60 or (left is not None and left[0] <= 0):
        return ""
    candidates = tuple(sorted(set(known)))
    if left is not None:
        left[0] -= len(candidates)
    return _close_to(word, candidates)


@lru_cache(maxsize=256)
def _close_to(word: str, candidates: tuple[str, ...]) -> str:
    close = get_close_matches(word, candidates, n=3, cutoff=0.6)
    if not close:
        lower = {candidate.lower(): candidate for candidate in candidates}
        close = [
            lower[match] for match in get_close_matches(word.lower(), list(lower), n=3, cutoff=0.6)
        ]
    if not close:
        return ""
    best = max(
        close, key=lambda one: (round(SequenceMatcher(None, one, word).ratio(), 2), -len(one))
    )
    return Instead(f"did you mean '{best}'?", word, best)


# words compared in one reading, about a second's work (30 000 took 20 s without it)
MAX_COMPARED = 20_000
MAX_EXCERPT = 160
MAX_SHOWN = 200  # findings that are written out; who has more mends the first ones first


def place_of(finding: Finding) -> str:
    """`file:line:column`, or the file alone when no place in it is meant."""
    return f"{finding.path}:{finding.line}:{finding.column}" if finding.line else finding.path


def said(finding: Finding) -> str:
    """Return the message of a finding with its hint."""
    return f"{finding.message}; {finding.hint}" if finding.hint else finding.message


def format_finding(finding: Finding) -> str:
    """Return the finding with its hint as a compiler would print it, with its line and a marker under the place."""
    lines = [f"{place_of(finding)}: {finding.severity}[{finding.code}]: {said(finding)}"]
    if finding.excerpt.strip() and len(finding.excerpt) <= MAX_EXCERPT:
        shown = "".join(c if c.isprintable() else "·" for c in finding.excerpt.replace("\t", " "))
        marker = "^" * max(1, min(finding.length, len(shown) - finding.column + 1))
        lines.append(f"{finding.line:>5} | {shown}")
        lines.append(f"      | {' ' * (finding.column - 1)}{marker}")
    return "\n".join(lines)


def format_findings(findings: Sequence[Finding]) -> str:
    """Return all findings and their count."""
    counts = [
        f"{n} {word}{'s' if n > 1 else ''}"
        for word in ("error", "warning")
        if (n := sum(f.severity == word for f in findings))
    ]
    shown = [*map(format_finding, findings[:MAX_SHOWN])]
    if len(findings) > MAX_SHOWN:
        shown.append(f"… and {len(findings) - MAX_SHOWN} more that are not shown")
    return "\n".join([*shown, *([" and ".join(counts) + "."] if counts else [])])
