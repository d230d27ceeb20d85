"""Texts for the operator: of limited length, since the tick waits while they are printed and encoded."""

from __future__ import annotations

from dataclasses import dataclass

LONGEST = 10_000  # characters of a text that are kept


def shortened(text: str) -> str:
    """Return the beginning of a text that is too long, with its length; any other text as it is."""
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 40]} … ({len(text)} characters)"


def sentence_of(error: BaseException) -> str:
    """Return the text of an exception, or its name if it has none; for Python's own exceptions, both."""
    name = type(error).__name__
    try:
        text = shortened(str(error))
    except BaseException as second:  # a defect in the exception's own text must not prevent a stop
        return f"{name}, which cannot be shown: {type(second).__name__}"
    if isinstance(error, MemoryError) and not text:
        return "MemoryError: there is no memory left"
    if not text or isinstance(
        error, (LookupError, SystemExit)
    ):  # 'mesh', list index out of range, 0
        return f"{name}: {text}" if text else name
    return text


@dataclass(frozen=True, slots=True)
class ReportLine:
    """One line of the report: subject, state, finding, and remedy."""

    name: str
    ok: bool
    found: str
    advice: str = ""
    absent: bool = False  # optional and not there

    def __str__(self) -> str:
        line = f"{'–' if self.absent else '✓' if self.ok else '✗'} {self.name:24} {self.found}"
        return line if self.ok or not self.advice else f"{line}\n  → {self.advice}"
